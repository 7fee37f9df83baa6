"""What a name of the flat model stands for: which scalars are states, inputs, parameters, ..., and
their start values.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import casadi as ca

from modelica_fmu import ir
from modelica_fmu.expressions import Translator, Value, compare, flatten
from modelica_fmu.functions import FunctionLibrary
from modelica_fmu.ir import FlatModel, FlatVariable, nodes, scalar_name, subscripts_of
from modelica_fmu.source import Source


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


def hidden(name: str, kind: str, symbol: ca.SX | None = None) -> Scalar:
    """A scalar that the model does not declare."""
    about = FlatVariable(name, "Real", "Continuous", "", (), protected=True)
    return Scalar(name, about, (), kind, symbol if symbol is not None else ca.SX.sym(name))


@dataclass
class Table:
    """All scalars, by name and by kind, and the arrays they form."""

    model: FlatModel
    scalars: dict[str, Scalar] = field(default_factory=dict)
    arrays: dict[str, Value] = field(default_factory=dict)
    strings: dict[str, FlatVariable] = field(default_factory=dict)

    def of(self, *kinds: str) -> list[Scalar]:
        return [s for s in self.scalars.values() if s.kind in kinds]

    @property
    def source(self) -> Source:
        return Source(self.model.file)

    def dimensions(self, node: Any) -> int | None:
        """Number of dimensions of a variable that stands as a whole."""
        if not isinstance(node, ir.Name) or node.subscripts:
            return None
        variable = self.model.variables.get(node.name)
        if variable is None:
            return None
        return len(variable.dims)

    def value(self, name: str, node: Any) -> Value:
        if name in self.arrays:
            return self.arrays[name]
        if name == "time":
            return TIME
        if name in self.strings:
            binding = self.strings[name].binding
            if isinstance(binding, ir.Text):
                return binding.value
            raise self.source.refuse("not supported: a String in an equation", node)
        raise self.source.refuse(f"unknown name {name}", node)


MOST_SCALARS = 10_000
TIME = ca.SX.sym("time")
SETTINGS = ir.Place(Path("solver"), 0)  # where the solver's settings stand: in no file


class PlainScope:
    """Bindings, bounds and start values: no hybrid operators."""

    def __init__(self, table: Table, functions: FunctionLibrary) -> None:
        self.table, self.functions = table, functions

    def name(self, name: str, node: Any) -> Value:
        return self.table.value(name, node)

    def relation(self, op: str, lhs: ca.SX, rhs: ca.SX, event: bool, node: Any) -> ca.SX:
        return compare(op, lhs, rhs)

    def rounded(self, value: ca.SX, event: bool, node: Any) -> ca.SX:
        return ca.floor(value)

    def dimensions(self, node: Any) -> int | None:
        return self.table.dimensions(node)

    def operator(
        self, function: str, args: tuple[Any, ...], translate: Translator, node: Any
    ) -> Value | None:
        if function in ("der", "pre", "sample", "delay", "edge", "change"):
            raise self.table.source.refuse(
                f"{function}() cannot stand in a binding or start value", node
            )
        return None

    def call(self, node: ir.Call, translate: Translator, every: bool = False) -> Value:
        return self.functions.call(node, translate, every)


def build_table(model: FlatModel) -> tuple[Table, FunctionLibrary]:
    """Classifies every scalar and translates bindings and start values."""
    table = Table(model)
    states = scalars_under(model, ("der",))
    assigned = assigned_in_when(model)
    for name in [n for n, v in model.variables.items() if v.type == "String"]:
        table.strings[name] = model.variables.pop(name)
    if (count := sum(math.prod(v.dims) for v in model.variables.values())) > MOST_SCALARS:
        raise table.source.refuse(
            f"{count} scalar variables, at most {MOST_SCALARS} are compiled",
            hint="make its arrays smaller",
        )
    for variable in _solver_parameters():
        model.variables[variable.name] = variable
    for name, variable, subscripts in model.scalars():
        kind = _kind(name, variable, states, assigned)
        table.scalars[name] = Scalar(name, variable, subscripts, kind, ca.SX.sym(name))
    for variable in model.variables.values():
        table.arrays[variable.name] = _array(table, variable.name, variable.dims, ())
        known = literal(variable.binding) if variable.variability == "Constant" else None
        if known is not None and not variable.dims:  # sizes and rounds depend on it
            table.arrays[variable.name] = ca.SX(known)
    functions = FunctionLibrary(table.source, model.functions)
    functions.parameters = frozenset(s.name for s in table.of("parameter"))
    translate = Translator(table.source, PlainScope(table, functions), events=False)
    for variable in model.variables.values():
        _give_values(
            [table.scalars[scalar_name(variable.name, at)] for at in subscripts_of(variable.dims)],
            translate,
        )
    _fold_constants(table)
    return table, functions


def _solver_parameters() -> list[FlatVariable]:
    """Settings of the internal solver; `generate.SOLVER` tells core.c where they are."""
    return [
        _parameter(
            "solver.max_step", 1e-3, 1e-6, 1e4, "s", "Longest internal step in co-simulation"
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
    def literal(value: float) -> ir.Literal:
        return ir.Literal(SETTINGS, value)

    return FlatVariable(
        name,
        "Real",
        "Parameter",
        "",
        (),
        literal(start),
        min=literal(low),
        max=literal(high),
        unit=unit,
        description=description,
    )


def _array(table: Table, name: str, dims: tuple[int, ...], at: tuple[int, ...]) -> Value:
    if not dims:
        return table.scalars[scalar_name(name, at)].symbol
    return [_array(table, name, dims[1:], (*at, i)) for i in range(1, dims[0] + 1)]


def _kind(name: str, variable: FlatVariable, states: set[str], assigned: set[str]) -> str:
    if variable.variability == "Constant":
        return "constant"
    if variable.variability == "Parameter":
        return "parameter"
    if variable.causality == "input":
        return "input"
    if name in states:
        return "state"
    return "discrete" if name in assigned else "algebraic"


def _give_values(scalars: list[Scalar], translate: Translator) -> None:
    """Binding or start value of the scalars of one variable."""
    if not scalars:
        return
    variable, kind = scalars[0].variable, scalars[0].kind
    tree = variable.binding if kind in ("constant", "parameter") else variable.start
    if tree is None and kind == "constant":
        raise translate.source.refuse(
            f"the constant {variable.name} has no value", variable, hint="bind it"
        )
    tree = tree or variable.start
    whole = ca.SX(0) if tree is None else translate(tree)
    for scalar in scalars:
        value = whole
        for subscript in scalar.subscripts:
            fits = not isinstance(value, list) or subscript <= len(value)
            value = value[subscript - 1] if isinstance(value, list) and fits else value
        if not isinstance(value, ca.SX):
            said = f"dimension mismatch: the value of {variable.name} does not fit it"
            raise translate.source.refuse(said, variable)
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
        raise table.source.refuse("constants that depend on one another", hint="break the circle")
    for scalar in table.of("parameter"):
        free = literal(scalar.variable.fixed) == 0  # found by the initial system
        if free or (scalar.value is not None and ca.symvar(scalar.value)):
            scalar.kind = "calculated"


def _substitute(table: Table, old: list[ca.SX], new: list[Any]) -> None:
    for scalar in table.scalars.values():
        if scalar.value is not None and not scalar.value.is_constant():
            scalar.value = ca.substitute([scalar.value], old, new)[0]


def everything(model: FlatModel) -> list[Any]:
    """All that is computed between events and at them."""
    bindings = [v.binding for v in model.variables.values() if v.binding is not None]
    return [model.equations, model.algorithms, model.whens, model.assertions, bindings]


def scalars_under(model: FlatModel, functions: tuple[str, ...]) -> set[str]:
    """Names of scalars that stand under an operator such as der()."""
    found: set[str] = set()
    for node in nodes([everything(model), model.initial_equations, model.initial_algorithms]):
        if isinstance(node, ir.Builtin) and node.function in functions:
            for inner in nodes(list(node.args)):
                if isinstance(inner, ir.Name):
                    found |= scalar_names(model, inner)
    return found


def scalar_names(model: FlatModel, node: ir.Name) -> set[str]:
    """The scalars that a reference may mean."""
    variable = model.variables.get(node.name)
    if variable is None:
        return set()
    fixed = [int(s.value) if isinstance(s, ir.Literal) else None for s in node.subscripts]
    fixed += [None] * (len(variable.dims) - len(fixed))
    return {
        scalar_name(variable.name, at)
        for at in subscripts_of(variable.dims)
        if all(k is None or k == i for k, i in zip(fixed, at, strict=True))
    }


def assigned_in_when(model: FlatModel) -> set[str]:
    found: set[str] = set()
    for when in model.whens:
        for _, actions in when.branches:
            for node in assigned(actions):
                found |= scalar_names(model, node)
    for algorithm in model.algorithms:
        for node in nodes(list(algorithm.body)):
            if isinstance(node, ir.WhenStatement):
                for _, body in node.branches:
                    for name in targets(body):
                        found |= scalar_names(model, name)
    return found


def assigned(actions: Iterable[ir.WhenAction]) -> Iterable[ir.Name]:
    """What the equations of a when-clause determine."""
    for action in actions:
        if isinstance(action, ir.Equation):
            sides = action.left.items if isinstance(action.left, ir.Several) else [action.left]
            for side in sides:
                yield from (n for n in _whole_names(side))
        elif isinstance(action, ir.IfEquation):
            for _, body in action.branches:
                yield from assigned(body)
            yield from assigned(action.otherwise)


def _whole_names(side: Any) -> Iterable[ir.Name]:
    if isinstance(side, ir.Name):
        yield side
    elif isinstance(side, ir.Array):
        for item in side.items:
            yield from _whole_names(item)
    elif isinstance(side, ir.Record):
        for _, item in side.fields:
            yield from _whole_names(item)


def targets(body: Iterable[Any]) -> Iterable[ir.Name]:
    """Variables that statements assign."""
    for node in nodes(list(body)):
        if isinstance(node, ir.Assign):
            yield from (t for t in node.targets if isinstance(t, ir.Name))


def constant(value: Value) -> float | None:
    """The number that a value is, or None."""
    items = flatten(value)
    return float(items[0]) if len(items) == 1 and items[0].is_constant() else None


def literal(node: Any) -> float | None:
    """The number that an attribute is written as, or None."""
    return float(node.value) if isinstance(node, ir.Literal) else None
