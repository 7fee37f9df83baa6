"""A hybrid system: residuals, event relations, when-branches, sampled ticks and delays; and how
expressions are read that make them.

Between events every relation is a frozen symbol (0 or 1). Its indicator, left minus right side,
tells the solver when to look again. A relation makes no event inside noEvent(), in a function, or
between values that only change at events.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca

from modelica_fmu import ir
from modelica_fmu.expressions import Translator, Value, compare, elementwise
from modelica_fmu.functions import FunctionLibrary
from modelica_fmu.ir import FlatVariable
from modelica_fmu.symbols import Scalar, Table, constant
from modelica_fmu.tearing import Loop

__all__ = [
    "Assertion",
    "Branch",
    "Delay",
    "HybridNames",
    "HybridScope",
    "HybridSystem",
    "Relation",
    "Rounding",
    "Sample",
]

DEEPEST = 1_000_000  # operations down to which two indicators are compared


@dataclass
class Relation:
    symbol: ca.SX  # frozen value, 0 or 1
    indicator: ca.SX  # true where > 0 (or >= 0)
    inclusive: bool  # >= 0


@dataclass
class Rounding:
    """floor() of what moves: frozen between events, which two relations bring about."""

    symbol: ca.SX
    argument: ca.SX


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
    stops: str | None = None  # message with which it ends the run


@dataclass
class Assertion:
    condition: ca.SX
    message: str
    warning: bool


@dataclass
class HybridSystem:
    table: Table
    residuals: list[tuple[ca.SX, Any]] = field(default_factory=list)  # with their place
    initial_residuals: list[tuple[ca.SX, Any]] = field(default_factory=list)
    roundings: list[Rounding] = field(default_factory=list)
    loops: list[Loop] = field(default_factory=list)  # filled by sorting.solve
    constraints: list[ca.SX] = field(default_factory=list)  # that states must keep to
    relations: list[Relation] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)
    delays: list[Delay] = field(default_factory=list)
    branches: list[Branch] = field(default_factory=list)
    assertions: list[Assertion] = field(default_factory=list)
    updates: dict[str, ca.SX] = field(default_factory=dict)  # memories that algorithms assign
    memories: list[Scalar] = field(
        default_factory=list
    )  # discrete and Boolean scalars that pre() remembers
    derivatives: dict[str, ca.SX] = field(default_factory=dict)  # state -> symbol of its derivative
    pre: dict[str, ca.SX] = field(
        default_factory=dict
    )  # memory -> symbol of its value before the event
    initial: ca.SX = field(default_factory=lambda: ca.SX.sym("initial"))
    path: ca.SX = field(default_factory=lambda: ca.SX.sym("homotopy()"))  # 0 to 1
    simplified: bool = False  # some homotopy() has a simplified side of its own

    def copy(self) -> HybridSystem:
        """One that may be changed without this one. Expressions are shared: they never change."""
        scalars = {n: replace(s) for n, s in self.table.scalars.items()}
        branches = [
            replace(b, assigns=dict(b.assigns), reinits=dict(b.reinits)) for b in self.branches
        ]
        return replace(
            self,
            table=replace(self.table, scalars=scalars),
            residuals=list(self.residuals),
            initial_residuals=list(self.initial_residuals),
            roundings=[replace(r) for r in self.roundings],
            loops=list(self.loops),
            constraints=list(self.constraints),
            relations=[replace(r) for r in self.relations],
            samples=[replace(s) for s in self.samples],
            delays=[replace(d) for d in self.delays],
            branches=branches,
            assertions=[replace(a) for a in self.assertions],
            updates=dict(self.updates),
            memories=[scalars[s.name] for s in self.memories],
            derivatives=dict(self.derivatives),
            pre=dict(self.pre),
        )


class HybridScope:
    """Names and hybrid operators in equations and when-clauses."""

    def __init__(self, system: HybridSystem, functions: FunctionLibrary) -> None:
        self.system, self.table, self.functions = system, system.table, functions
        self.source = system.table.source
        self._known_relations: dict[str, list[Relation]] = {}
        self._known_roundings: dict[str, list[Rounding]] = {}
        self._by_symbol = {s.symbol.__hash__(): s for s in self.table.scalars.values()}

    def name(self, name: str, node: Any) -> Value:
        return self.table.value(name, node)

    def call(self, node: ir.Call, translate: Translator, every: bool = False) -> Value:
        return self.functions.call(node, translate, every)

    def relation(self, op: str, lhs: ca.SX, rhs: ca.SX, event: bool, node: Any) -> ca.SX:
        difference = lhs - rhs if op in (">", ">=") else rhs - lhs
        if not event or not self._any_moves(difference):
            return compare(op, lhs, rhs)
        inclusive = op in (">=", "<=")
        # CasADi prints six digits: the text finds candidates, the expressions themselves decide
        alike = self._known_relations.setdefault(f"{difference}|{inclusive}", [])
        for known in alike:
            if ca.is_equal(known.indicator, difference, DEEPEST):
                return known.symbol
        alike.append(self._new_relation(difference, inclusive))
        return alike[-1].symbol

    def dimensions(self, node: Any) -> int | None:
        return self.table.dimensions(node)

    def _new_relation(self, indicator: ca.SX, inclusive: bool) -> Relation:
        symbol = ca.SX.sym(f"relation_{len(self.system.relations)}")
        self.system.relations.append(Relation(symbol, indicator, inclusive))
        return self.system.relations[-1]

    def rounded(self, value: ca.SX, event: bool, node: Any) -> ca.SX:
        """floor(value): between events a frozen number that the value must not leave."""
        if not event or not self._any_moves(value):
            return ca.floor(value)
        alike = self._known_roundings.setdefault(str(value), [])
        for known in alike:
            if ca.is_equal(known.argument, value, DEEPEST):
                return known.symbol
        symbol = ca.SX.sym(f"rounding_{len(self.system.roundings)}")
        alike.append(Rounding(symbol, value))
        self.system.roundings.append(alike[-1])
        self._new_relation(value - symbol, inclusive=True)
        self._new_relation(symbol + 1 - value, inclusive=False)
        return symbol

    def _any_moves(self, expression: ca.SX) -> bool:
        return any(self._moves(symbol) for symbol in ca.symvar(expression))

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
        self, function: str, args: tuple[Any, ...], translate: Translator, node: Any
    ) -> Value | None:
        method = getattr(self, "_" + function.lower(), None) if function in HYBRID else None
        return None if method is None else method(args, translate, node)

    def _der(self, args: tuple[Any, ...], translate: Translator, node: Any) -> Value:
        value = translate.without_events()(args[0])
        return elementwise(lambda v: self._rate(v, node), value)

    def _rate(self, value: ca.SX, node: Any) -> ca.SX:
        """Time derivative of an expression: by the chain rule, of a variable its symbol."""
        if value.is_symbolic():
            return self._symbol_rate(value, node)
        total = ca.SX(0)
        for symbol in ca.symvar(value):
            total += ca.jacobian(value, symbol) * self._symbol_rate(symbol, node)
        return total

    def _symbol_rate(self, symbol: ca.SX, node: Any) -> ca.SX:
        scalar = self._by_symbol.get(symbol.__hash__())
        if scalar is None:
            if symbol.name() == "time":
                return ca.SX(1)
            if symbol.name().startswith("der("):
                return self._second_rate(symbol)
            if symbol.__hash__() == self.system.path.__hash__():
                return ca.SX(0)
            raise self.source.refuse("not supported: der() of what jumps at events", node)
        if scalar.kind in ("parameter", "calculated", "constant"):
            return ca.SX(0)
        if scalar.kind not in ("state", "algebraic") or scalar.discrete_valued:
            raise self.source.refuse(
                f"not supported: der() of {scalar.name}, which is no continuous variable",
                node,
                hint="filter it",
            )
        return self.system.derivatives[scalar.name]

    def _second_rate(self, first: ca.SX) -> ca.SX:
        """der(der(x)): the first derivative becomes a variable of its own."""
        name = f"rate_of_{first.name()[4:-1]}"
        if name not in self.table.scalars:
            about = FlatVariable(name, "Real", "Continuous", "", (), protected=True)
            made = Scalar(name, about, (), "state", ca.SX.sym(name))
            self.table.scalars[name] = made
            self._by_symbol[made.symbol.__hash__()] = made
            self.system.derivatives[name] = ca.SX.sym(f"der({name})")
            self.system.residuals.append((made.symbol - first, None))
        return self.system.derivatives[name]

    def _scalar_of(self, value: Value, node: Any) -> Scalar:
        symbolic = isinstance(value, ca.SX) and value.is_symbolic()
        scalar = self._by_symbol.get(value.__hash__()) if symbolic else None
        if scalar is None:
            raise self.source.refuse("pre() and reinit() take the name of a variable", node)
        return scalar

    def _pre(self, args: tuple[Any, ...], translate: Translator, node: Any) -> Value:
        plain = Translator(self.source, HybridNames(self), events=False)
        return elementwise(lambda v: self._pre_of(v, node), plain(args[0]))

    def _pre_of(self, value: ca.SX, node: Any) -> ca.SX:
        if value.is_constant():
            return value
        scalar = self._scalar_of(value, node)
        if scalar.kind in ("state", "parameter", "calculated", "constant"):
            return scalar.symbol  # inside when: the value before the event is the present one
        if scalar.name not in self.system.pre:
            raise self.source.refuse(
                f"not supported: pre({scalar.name}) of a continuous or input variable", node
            )
        return self.system.pre[scalar.name]

    def _edge(self, args: tuple[Any, ...], translate: Translator, node: Any) -> Value:
        return ca.logic_and(
            translate.scalar(args[0]), ca.logic_not(self._pre(args, translate, node))
        )

    def _change(self, args: tuple[Any, ...], translate: Translator, node: Any) -> Value:
        return translate.scalar(args[0]) != self._pre(args, translate, node)

    def _initial(self, args: tuple[Any, ...], translate: Translator, node: Any) -> Value:
        return self.system.initial

    def _terminal(self, args: tuple[Any, ...], translate: Translator, node: Any) -> Value:
        return ca.SX(0)

    def _homotopy(self, args: tuple[Any, ...], translate: Translator, node: Any) -> Value | None:
        """Actual and simplified, between which the start moves along `path`; then actual."""
        if len(args) < 2:
            return None
        actual, simple = translate(args[0]), translate.without_events()(args[1])
        path, self.system.simplified = self.system.path, True

        def one(a: ca.SX, s: ca.SX) -> ca.SX:
            return ca.if_else(path >= 1, a, path * a + (1 - path) * s)

        return translate.each(one, node, actual, simple)

    def _sample(self, args: tuple[Any, ...], translate: Translator, node: Any) -> Value:
        if len(args) != 2:
            raise self.source.refuse("not supported: sample() of a clock", node)
        start, interval = (translate.scalar(arg) for arg in args)
        for value in (start, interval):
            for symbol in ca.symvar(value):
                scalar = self._by_symbol.get(symbol.__hash__())
                if scalar is None or scalar.kind not in ("parameter", "calculated", "constant"):
                    raise self.source.refuse(
                        "sample() takes parameters only", node, hint="give a parameter expression"
                    )
        for known in self.system.samples:
            if ca.is_equal(known.start, start, DEEPEST) and ca.is_equal(
                known.interval, interval, DEEPEST
            ):
                return known.symbol
        symbol = ca.SX.sym(f"tick_{len(self.system.samples)}")
        self.system.samples.append(Sample(symbol, start, interval))
        return symbol

    def _delay(self, args: tuple[Any, ...], translate: Translator, node: Any) -> Value:
        plain = translate.without_events()
        time = plain.scalar(args[1])
        maximum = plain.scalar(args[2]) if len(args) > 2 else time
        longest, actual = constant(maximum), constant(time)
        if longest is not None and actual is not None and actual > longest:
            raise self.source.refuse(
                f"the delay {actual:g} must not exceed its maximum {longest:g}", node
            )
        return elementwise(lambda v: self._delayed(v, time, maximum), plain(args[0]))

    def _delayed(self, expression: ca.SX, time: ca.SX, maximum: ca.SX) -> ca.SX:
        symbol = ca.SX.sym(f"delay_{len(self.system.delays)}")
        self.system.delays.append(Delay(symbol, expression, time, maximum))
        return symbol


HYBRID = ("der", "pre", "edge", "change", "initial", "terminal", "sample", "delay", "homotopy")


class HybridNames(HybridScope):
    """The variables themselves, whatever an algorithm has assigned to them meanwhile."""

    def __init__(self, scope: HybridScope) -> None:
        self.__dict__.update(scope.__dict__)

    def name(self, name: str, node: Any) -> Value:
        return self.table.value(name, node)
