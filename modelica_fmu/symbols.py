"""What a name of the flat model stands for: which scalars are states, inputs, parameters, ..., and
their start values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from modelica_fmu.expressions import Translator, Value, compare, flatten
from modelica_fmu.frontend import FlatModel, FlatVariable, Tree, scalar_name, subscripts_of
from modelica_fmu.functions import FunctionLibrary


@dataclass(eq=False)
class Scalar:
    """One scalar of the model with its symbol."""

    name: str
    variable: FlatVariable
    subscripts: tuple[int, ...]
    kind: str  # constant, parameter, calculated, input, state, algebraic, discrete
    symbol: ca.SX
    value: ca.SX | None = None  # binding of constants and parameters, start expression of the rest

    @property
    def discrete_valued(self) -> bool:
        return self.variable.type != "Real"


@dataclass
class Table:
    """All scalars, by name and by kind, and the arrays they form."""

    model: FlatModel
    scalars: dict[str, Scalar] = field(default_factory=dict)
    arrays: dict[str, Value] = field(default_factory=dict)

    def of(self, *kinds: str) -> list[Scalar]:
        return [s for s in self.scalars.values() if s.kind in kinds]

    def value(self, name: str, tree: Tree) -> Value:
        if name in self.arrays:
            return self.arrays[name]
        if name in self.model.literals:
            return ca.SX(self.model.literals[name])
        if name == "time":
            return TIME
        raise self.model.source.refuse(f"unknown name {name}", tree)


MOST_SCALARS = 10_000
TIME = ca.SX.sym("time")


class PlainScope:
    """Bindings, bounds and start values: no hybrid operators."""

    def __init__(self, table: Table, functions: FunctionLibrary) -> None:
        self.table, self.functions = table, functions

    def name(self, name: str, tree: Tree) -> Value:
        return self.table.value(name, tree)

    def relation(self, op: str, lhs: ca.SX, rhs: ca.SX, event: bool, tree: Tree) -> ca.SX:
        return compare(op, lhs, rhs)

    def operator(
        self, function: str, args: list[Tree], translate: Translator, tree: Tree
    ) -> Value | None:
        if function in ("Der", "Pre", "Sample", "Delay", "Edge", "Change"):
            raise self.table.model.source.refuse(
                f"{function.lower()}() cannot stand in a binding or start value", tree
            )
        return None

    def call(self, function: str, args: list[Value], tree: Tree) -> Value:
        return self.functions.call(function, args, tree)


def build_table(model: FlatModel, functions: FunctionLibrary) -> tuple[Table, PlainScope]:
    """Classifies every scalar and translates bindings and start values."""
    states = _names_under(model, "Der")
    assigned = _assigned_in_when(model)
    table = Table(model)
    if (count := sum(math.prod(v.dims) for v in model.variables.values())) > MOST_SCALARS:
        raise model.source.refuse(
            f"{count} scalar variables, at most {MOST_SCALARS} are compiled",
            hint="make its arrays smaller",
        )
    for variable in _solver_parameters():
        model.variables[variable.name] = variable
    for name, variable, subscripts in model.scalars():
        kind = _kind(variable, states, assigned)
        table.scalars[name] = Scalar(name, variable, subscripts, kind, ca.SX.sym(name))
    for variable in model.variables.values():
        table.arrays[variable.name] = _array(table, variable.name, variable.dims, ())
    scope = PlainScope(table, functions)
    translate = Translator(model.source, scope, events=False)
    for variable in model.variables.values():
        _give_values(
            [table.scalars[scalar_name(variable.name, at)] for at in subscripts_of(variable.dims)],
            translate,
        )
    _fold_constants(table)
    return table, scope


def _solver_parameters() -> list[FlatVariable]:
    """Settings of the internal solver; `generate.SOLVER` tells core.c where they are."""
    return [
        _parameter(
            "solver.max_step", 1e-3, 1e-6, 1.0, "s", "Longest internal step in co-simulation"
        ),
        _parameter(
            "solver.tolerance",
            1e-4,
            1e-12,
            1e6,
            "1",
            "Local error per step, relative to max(|x|, nominal), embedded order 3",
        ),
    ]


def _parameter(
    name: str, start: float, low: float, high: float, unit: str, description: str
) -> FlatVariable:
    def literal(value: float) -> Tree:
        return {"Literal": {"value": {"Real": value}}}

    return FlatVariable(
        name=name,
        type="Real",
        variability="Parameter",
        causality="",
        dims=(),
        binding=literal(start),
        start=None,
        fixed=None,
        min=literal(low),
        max=literal(high),
        nominal=None,
        unit=unit,
        description=description,
        protected=False,
        final=False,
        tree={},
    )


def _array(table: Table, name: str, dims: tuple[int, ...], at: tuple[int, ...]) -> Value:
    if not dims:
        return table.scalars[scalar_name(name, at)].symbol
    return [_array(table, name, dims[1:], (*at, i)) for i in range(1, dims[0] + 1)]


def _kind(variable: FlatVariable, states: set[str], assigned: set[str]) -> str:
    if variable.variability == "Constant":
        return "constant"
    if variable.variability == "Parameter":
        return "parameter"
    if variable.causality == "input":
        return "input"
    if variable.name in states:
        return "state"
    return "discrete" if variable.name in assigned else "algebraic"


def _give_values(scalars: list[Scalar], translate: Translator) -> None:
    """Binding or start value of the scalars of one variable."""
    if not scalars:
        return
    variable, kind = scalars[0].variable, scalars[0].kind
    tree = variable.binding if kind in ("constant", "parameter") else variable.start
    if tree is None and kind == "constant":
        raise translate.source.refuse(
            f"the constant {variable.name} has no value", variable.tree, hint="bind it"
        )
    tree = tree or variable.start
    whole = ca.SX(0) if tree is None else translate(tree)
    for scalar in scalars:
        value = whole
        for subscript in scalar.subscripts:
            value = value[subscript - 1] if isinstance(value, list) else value
        scalar.value = value


def _fold_constants(table: Table) -> None:
    """Puts constants' numbers into every value; parameters bound to other parameters become
    calculated.
    """
    for _ in range(100):
        known = [s for s in table.of("constant") if s.value is not None and s.value.is_constant()]
        open_ = [
            s for s in table.of("constant") if s.value is not None and not s.value.is_constant()
        ]
        if known:
            _substitute(table, [s.symbol for s in known], [s.value for s in known])
        if not open_:
            break
    else:
        raise table.model.source.refuse(
            "constants that depend on one another", hint="break the circle"
        )
    for scalar in table.of("parameter"):
        if scalar.value is not None and ca.symvar(scalar.value):
            scalar.kind = "calculated"


def _substitute(table: Table, old: list[ca.SX], new: list[Any]) -> None:
    for scalar in table.scalars.values():
        if scalar.value is not None and not scalar.value.is_constant():
            scalar.value = ca.substitute([scalar.value], old, new)[0]


def _names_under(model: FlatModel, function: str) -> set[str]:
    """Names that stand directly under a built-in such as der()."""
    found: set[str] = set()

    def walk(tree: Any) -> None:
        if isinstance(tree, dict):
            call = tree.get("BuiltinCall")
            if call and call["function"] == function:
                if "VarRef" not in call["args"][0]:
                    raise model.source.refuse(
                        f"not supported: {function.lower()}() of an expression",
                        tree,
                        hint="name it first",
                    )
                found.add(call["args"][0]["VarRef"]["name"]["name"])
            tree = list(tree.values())
        if isinstance(tree, list):
            for child in tree:
                walk(child)

    walk(model.equations)
    if function != "Der":
        walk(model.when_chains)
    return found


def names_under_pre(model: FlatModel) -> set[str]:
    """Variables whose value before the event is asked for."""
    return _names_under(model, "Pre") | _names_under(model, "Edge") | _names_under(model, "Change")


def _assigned_in_when(model: FlatModel) -> set[str]:
    names = set()
    for chain in model.when_chains:
        for branch in [chain["first"], *chain["else_when"]]:
            for equation in branch["equations"]:
                if "Assign" in equation:
                    names.add(equation["Assign"]["target"])
    return names


def constant(value: Value) -> float | None:
    """The number that a value is, or None."""
    items = flatten(value)
    return float(items[0]) if len(items) == 1 and items[0].is_constant() else None


def literal(tree: Tree | None) -> float | None:
    """The number that an attribute is written as, or None."""
    node = (tree or {}).get("Literal")
    number = next(iter(node["value"].values())) if node else None
    return float(number) if isinstance(number, int | float) else None
