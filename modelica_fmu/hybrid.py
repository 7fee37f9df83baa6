"""Hybrid semantics: the flat model as residuals, event relations, when-branches, sampled ticks and
delays.

Between events every relation is a frozen symbol (0 or 1). Its indicator, left minus right side,
tells the solver when to look again. A relation makes no event inside noEvent(), in a function, or
between values that only change at events.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from modelica_fmu.expressions import Translator, Value, compare, flatten
from modelica_fmu.frontend import FlatModel, Tree
from modelica_fmu.functions import FunctionLibrary
from modelica_fmu.symbols import TIME, Scalar, Table, build_table, names_under_pre

DEEPEST = 1_000_000  # operations down to which two indicators are compared


@dataclass
class Relation:
    symbol: ca.SX  # frozen value, 0 or 1
    indicator: ca.SX  # true where > 0 (or >= 0)
    inclusive: bool  # >= 0


@dataclass
class Sample:
    symbol: ca.SX  # 1 during the event iteration of its tick
    start: ca.SX
    interval: ca.SX


@dataclass
class Delay:
    symbol: ca.SX  # the delayed value
    expression: ca.SX
    time: ca.SX  # delay time, s
    maximum: ca.SX


@dataclass
class Branch:
    """One branch of a when chain; it fires where its condition rises and no earlier branch of its
    chain fires.
    """

    chain: int
    condition: ca.SX
    fired: ca.SX
    assigns: dict[str, ca.SX] = field(default_factory=dict)
    reinits: dict[str, ca.SX] = field(default_factory=dict)


@dataclass
class Assertion:
    condition: ca.SX
    message: str
    warning: bool


@dataclass
class HybridSystem:
    table: Table
    residuals: list[tuple[ca.SX, Tree]] = field(default_factory=list)
    relations: list[Relation] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)
    delays: list[Delay] = field(default_factory=list)
    branches: list[Branch] = field(default_factory=list)
    assertions: list[Assertion] = field(default_factory=list)
    memories: list[Scalar] = field(
        default_factory=list
    )  # discrete and Boolean scalars that pre() remembers
    derivatives: dict[str, ca.SX] = field(default_factory=dict)  # state -> symbol of its derivative
    pre: dict[str, ca.SX] = field(
        default_factory=dict
    )  # memory -> symbol of its value before the event
    initial: ca.SX = field(default_factory=lambda: ca.SX.sym("initial"))


class HybridScope:
    """Names and hybrid operators in equations and when-clauses."""

    def __init__(self, system: HybridSystem, functions: FunctionLibrary) -> None:
        self.system, self.table, self.functions = system, system.table, functions
        self.source = system.table.model.source
        self._known_relations: dict[str, list[Relation]] = {}
        self._by_symbol = {s.symbol.__hash__(): s for s in self.table.scalars.values()}

    def name(self, name: str, tree: Tree) -> Value:
        return self.table.value(name, tree)

    def call(self, function: str, args: list[Value], tree: Tree) -> Value:
        return self.functions.call(function, args, tree)

    def relation(self, op: str, lhs: ca.SX, rhs: ca.SX, event: bool, tree: Tree) -> ca.SX:
        difference = lhs - rhs if op in ("Gt", "Ge") else rhs - lhs
        if not event or not any(self._moves(symbol) for symbol in ca.symvar(difference)):
            return compare(op, lhs, rhs)
        inclusive = op in ("Ge", "Le")
        # CasADi prints six digits: the text finds candidates, the expressions themselves decide
        alike = self._known_relations.setdefault(f"{difference}|{inclusive}", [])
        for known in alike:
            if ca.is_equal(known.indicator, difference, DEEPEST):
                return known.symbol
        symbol = ca.SX.sym(f"relation_{len(self.system.relations)}")
        alike.append(Relation(symbol, difference, inclusive))
        self.system.relations.append(alike[-1])
        return symbol

    def _moves(self, symbol: ca.SX) -> bool:
        """Whether a symbol changes between events."""
        scalar = self._by_symbol.get(symbol.__hash__())
        if (
            scalar is None
        ):  # time, a derivative or a delayed value move; relations, ticks and pre() do not
            name = symbol.name()
            return name == "time" or name.startswith(("der(", "delay_"))
        return scalar.kind in ("state", "input", "algebraic") and not scalar.discrete_valued

    def operator(
        self, function: str, args: list[Tree], translate: Translator, tree: Tree
    ) -> Value | None:
        method = getattr(self, "_" + function.lower(), None)
        return None if method is None else method(args, translate, tree)

    def _der(self, args: list[Tree], translate: Translator, tree: Tree) -> Value:
        return self.system.derivatives[self._scalar_of(args[0], translate, tree).name]

    def _scalar_of(self, arg: Tree, translate: Translator, tree: Tree) -> Scalar:
        value = translate.scalar(arg)
        scalar = self._by_symbol.get(value.__hash__()) if value.is_symbolic() else None
        if scalar is None:
            raise self.source.refuse("der(), pre() and reinit() take the name of a variable", tree)
        return scalar

    def _pre(self, args: list[Tree], translate: Translator, tree: Tree) -> Value:
        scalar = self._scalar_of(args[0], translate, tree)
        if scalar.kind in ("state", "parameter", "calculated", "constant"):
            return scalar.symbol  # inside when: the value before the event is the present one
        if scalar.name not in self.system.pre:
            raise self.source.refuse(
                f"not supported: pre({scalar.name}) of a continuous or input variable", tree
            )
        return self.system.pre[scalar.name]

    def _edge(self, args: list[Tree], translate: Translator, tree: Tree) -> Value:
        return ca.logic_and(
            translate.scalar(args[0]), ca.logic_not(self._pre(args, translate, tree))
        )

    def _change(self, args: list[Tree], translate: Translator, tree: Tree) -> Value:
        return translate.scalar(args[0]) != self._pre(args, translate, tree)

    def _initial(self, args: list[Tree], translate: Translator, tree: Tree) -> Value:
        return self.system.initial

    def _terminal(self, args: list[Tree], translate: Translator, tree: Tree) -> Value:
        return ca.SX(0)

    def _sample(self, args: list[Tree], translate: Translator, tree: Tree) -> Value:
        start, interval = (translate.scalar(arg) for arg in args[:2])
        for value in (start, interval):
            for symbol in ca.symvar(value):
                scalar = self._by_symbol.get(symbol.__hash__())
                if scalar is None or scalar.kind not in ("parameter", "calculated"):
                    raise self.source.refuse(
                        "sample() takes parameters only", tree, hint="give a parameter expression"
                    )
        symbol = ca.SX.sym(f"tick_{len(self.system.samples)}")
        self.system.samples.append(Sample(symbol, start, interval))
        return symbol

    def _delay(self, args: list[Tree], translate: Translator, tree: Tree) -> Value:
        plain = translate.without_events()
        expression, time = plain.scalar(args[0]), plain.scalar(args[1])
        maximum = plain.scalar(args[2]) if len(args) > 2 else time
        symbol = ca.SX.sym(f"delay_{len(self.system.delays)}")
        self.system.delays.append(Delay(symbol, expression, time, maximum))
        return symbol


def build_system(model: FlatModel) -> HybridSystem:
    """Translates equations, when-clauses and assertions of a flat model."""
    functions = FunctionLibrary(model.source, model.functions, model.literals)
    table, _ = build_table(model, functions)
    system = HybridSystem(table)
    under_pre = names_under_pre(model)
    for scalar in table.scalars.values():
        if scalar.kind == "state":
            system.derivatives[scalar.name] = ca.SX.sym(f"der({scalar.name})")
        remembered = (
            scalar.variable.name in under_pre
            and scalar.kind == "algebraic"
            and scalar.discrete_valued
        )
        if scalar.kind == "discrete" or remembered:
            system.memories.append(scalar)
            system.pre[scalar.name] = ca.SX.sym(f"pre({scalar.name})")
    scope = HybridScope(system, functions)
    translate = Translator(model.source, scope)
    for equation in model.equations:
        for residual in flatten(translate(equation["residual"])):
            system.residuals.append((residual, equation))
    for scalar in table.of("algebraic"):
        if scalar.variable.binding is not None:
            residual = scalar.symbol - _element(
                translate(scalar.variable.binding), scalar.subscripts
            )
            system.residuals.append((residual, scalar.variable.tree))
    for number, chain in enumerate(model.when_chains):
        for tree in [chain["first"], *chain["else_when"]]:
            system.branches += _branches(system, translate, number, tree)
    for tree in model.asserts:
        system.assertions.append(_assertion(translate, tree))
    constants = table.of("constant")
    if constants:
        _put_constants(system, [s.symbol for s in constants], [s.value for s in constants])
    return system


def _element(value: Value, subscripts: tuple[int, ...]) -> ca.SX:
    for subscript in subscripts:
        value = value[subscript - 1] if isinstance(value, list) else value
    return value


def _branches(system: HybridSystem, translate: Translator, chain: int, tree: Tree) -> list[Branch]:
    """One branch for each condition of `when {a, b} then`: it fires when any of them rises."""
    first = len(system.branches)
    conditions = flatten(translate(tree["condition"]))
    branches = [
        Branch(chain, condition, ca.SX.sym(f"fired_{first + i}"))
        for i, condition in enumerate(conditions)
    ]
    branch = branches[0]
    inside = translate.without_events()
    source = translate.source
    for equation in tree["equations"]:
        kind, node = next(iter(equation.items()))
        if kind == "Assign":
            scalar = system.table.scalars.get(node["target"])
            if scalar is None:
                raise source.refuse(
                    f"not supported: an array assigned in a when-clause ({node['target']})", tree
                )
            branch.assigns[scalar.name] = inside.scalar(node["value"])
        elif kind == "Reinit":
            if node["state"] not in system.derivatives:
                raise source.refuse(f"reinit() takes a state, {node['state']} is none", tree)
            branch.reinits[node["state"]] = inside.scalar(node["value"])
        else:
            raise source.refuse(f"not supported: {kind} in a when-clause", tree)
    for other in branches[1:]:
        other.assigns, other.reinits = branch.assigns, branch.reinits
    return branches


def _assertion(translate: Translator, tree: Tree) -> Assertion:
    message = (
        tree["message"]["Literal"]["value"].get("String", "assertion failed")
        if "Literal" in tree["message"]
        else "assertion failed"
    )
    level = (
        float(translate.scalar(tree["level"])) if tree.get("level") else 2
    )  # AssertionLevel.warning is 1, .error 2
    return Assertion(
        translate.without_events().scalar(tree["condition"]), message, warning=level == 1
    )


def _put_constants(system: HybridSystem, old: list[ca.SX], new: list[Any]) -> None:
    def put(expression: ca.SX) -> ca.SX:
        return ca.substitute([expression], old, new)[0]

    system.residuals = [(put(residual), tree) for residual, tree in system.residuals]
    for relation in system.relations:
        relation.indicator = put(relation.indicator)
    for sample in system.samples:
        sample.start, sample.interval = put(sample.start), put(sample.interval)
    for delay in system.delays:
        delay.expression, delay.time, delay.maximum = (
            put(delay.expression),
            put(delay.time),
            put(delay.maximum),
        )
    for branch in system.branches:
        branch.condition = put(branch.condition)
        branch.assigns = {k: put(v) for k, v in branch.assigns.items()}
        branch.reinits = {k: put(v) for k, v in branch.reinits.items()}
    for assertion in system.assertions:
        assertion.condition = put(assertion.condition)


__all__ = [
    "TIME",
    "Assertion",
    "Branch",
    "Delay",
    "HybridSystem",
    "Relation",
    "Sample",
    "build_system",
]
