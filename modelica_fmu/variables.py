"""The FMI variables of a compiled system: causality, variability, start, bounds, unit of each."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import casadi as ca

from modelica_fmu import generate, ir
from modelica_fmu.compiled import TIME, BaseType, Variable
from modelica_fmu.expressions import Translator
from modelica_fmu.expressions import flatten as flat_values
from modelica_fmu.functions import FunctionLibrary
from modelica_fmu.hybrid import HybridSystem
from modelica_fmu.initialisation import Initial
from modelica_fmu.layout import Layout
from modelica_fmu.symbols import PlainScope, Scalar, constant
from modelica_fmu.units import rate_unit

__all__ = ["fmi_variables"]

PARAMETERS = ("parameter", "calculated", "constant")
MOST_PARAMETERS = 100  # that a bound follows from, one by the other


class Role(NamedTuple):
    """What FMI calls a variable: causality, variability and how its initial value comes about."""

    causality: str
    variability: str
    initial: str | None  # None where FMI forbids the attribute


def fmi_variables(system: HybridSystem, layout: Layout, initial: Initial) -> tuple[Variable, ...]:
    """All FMI variables; their order is that of the value references. Raises InputError for a
    start or bound that is no finite number.
    """
    model, source = system.table.model, system.table.source
    scope = PlainScope(system.table, FunctionLibrary(source, model.functions))
    translate = Translator(source, scope, events=False)
    made = [
        TIME,
        *_parameters(layout, translate, _fixed_parameters(system, layout)),
        *_inputs(layout, translate),
    ]
    first = len(made)
    made += _states(layout, translate, {s.name for s in initial.unknowns})
    made += _derivatives(layout, first)
    made += _outputs_and_locals(layout, translate)
    return tuple(made)


def _parameters(layout: Layout, translate: Translator, fixed: set[str]) -> Iterator[Variable]:
    for i, s in enumerate(layout.parameters):
        role = Role(
            "parameter", "fixed" if s.discrete_valued or s.name in fixed else "tunable", "exact"
        )
        yield _variable(s, "parameter", i, translate, role, generate.constant_start(s))
    for i, s in enumerate(layout.calculated, start=len(layout.parameters)):
        role = Role("calculatedParameter", "fixed" if s.name in fixed else "tunable", "calculated")
        if not s.variable.protected:
            yield _variable(s, "calculated", i, translate, role)


def _inputs(layout: Layout, translate: Translator) -> Iterator[Variable]:
    for i, s in enumerate(layout.inputs):
        role = Role("input", "discrete" if s.discrete_valued else "continuous", None)
        yield _variable(s, "input", i, translate, role, generate.constant_start(s))


def _states(layout: Layout, translate: Translator, sought: set[str]) -> Iterator[Variable]:
    """sought: names of the states that initialisation solves for."""
    for i, s in enumerate(layout.states):
        exact = s.value is None or s.value.is_constant()
        how = "approx" if s.name in sought else "exact"
        role = Role("local", "continuous", how if exact else "calculated")
        start = generate.constant_start(s) if exact else None
        yield _variable(s, "state", i, translate, role, start)


def _derivatives(layout: Layout, first: int) -> Iterator[Variable]:
    """first: value reference of the first state."""
    for i, s in enumerate(layout.states):
        yield Variable(
            f"der({s.name})",
            "derivative",
            "Real",
            "local",
            "continuous",
            "calculated",
            i,
            unit=rate_unit(s.variable.unit),
            description=f"Rate of {s.name}",
            derivative_of=first + i,
        )


def _outputs_and_locals(layout: Layout, translate: Translator) -> Iterator[Variable]:
    for i, s in enumerate(layout.algebraics):
        causality = "output" if s.variable.causality == "output" else "local"
        variability = "discrete" if s.discrete_valued else "continuous"
        role = Role(causality, variability, "calculated")
        yield _variable(s, "algebraic", i, translate, role)
    for i, s in enumerate(layout.memories):
        if s.kind == "discrete" and not s.variable.protected:
            role = Role("local", "discrete", "calculated")
            yield _variable(s, "discrete", i, translate, role)


def _fixed_parameters(system: HybridSystem, layout: Layout) -> set[str]:
    """Parameters that start values or sample times depend on cannot be tuned while running."""
    expressions = [s.value for s in layout.states + layout.memories if s.value is not None]
    expressions += [v for s in system.samples for v in (s.start, s.interval)] + [
        d.maximum for d in system.delays
    ]
    names = {v.name() for e in expressions for v in ca.symvar(e)}
    for s in reversed(layout.calculated):
        if s.name in names and s.value is not None:
            names |= {v.name() for v in ca.symvar(s.value)}
    return names


def _variable(
    s: Scalar,
    kind: str,
    index: int,
    translate: Translator,
    role: Role,
    start: float | None = None,
) -> Variable:
    v = s.variable
    low, high = (_bound(tree, s, translate) for tree in (v.min, v.max))
    nominal = _bound(v.nominal if kind == "state" else None, s, translate, at_start=True)
    for what, number in (("value", start), ("min", low), ("max", high), ("nominal", nominal)):
        if number is not None and not math.isfinite(number):
            raise translate.source.refuse(
                f"the {what} of {s.name} is {number}", v, hint="give a finite number"
            )
    plain = v.type in ("Real", "Integer", "Boolean")
    base: BaseType = v.type if plain else "Enumeration"  # type: ignore[assignment]
    return Variable(
        name=s.name,
        kind=kind,  # type: ignore[arg-type]
        type=base,
        causality=role.causality,  # type: ignore[arg-type]
        variability=role.variability,  # type: ignore[arg-type]
        initial=role.initial,  # type: ignore[arg-type]
        index=index,
        start=start,  # type: ignore[arg-type]
        unit=v.unit if base == "Real" else None,
        description=v.description or None,
        min=low,
        max=high,
        nominal=nominal,
        enumeration=v.type if base == "Enumeration" else None,
    )


def _bound(
    tree: ir.Expr | None, s: Scalar, translate: Translator, at_start: bool = False
) -> float | None:
    """The number that a bound is. One that depends on parameters is none; `at_start`: it is what
    the parameters' own values make it. InputError for one that depends on a variable.
    """
    if tree is None:
        return None
    value = translate(tree)
    for subscript in s.subscripts:
        value = value[subscript - 1] if isinstance(value, list) else value
    number = constant(value)
    if number is not None:
        return number
    assert isinstance(translate.scope, PlainScope)
    table = translate.scope.table
    values: Any = flat_values(value)
    for _ in range(MOST_PARAMETERS):
        symbols = [symbol for item in values for symbol in ca.symvar(item)]
        if not symbols:
            return float(values[0]) if at_start and len(values) == 1 else None
        found = [table.scalars.get(symbol.name()) for symbol in symbols]
        known: Any = [s.value for s in found if s is not None and s.kind in PARAMETERS]
        if len(known) < len(symbols) or any(k is None for k in known):
            break
        values = ca.substitute(values, symbols, known)
    raise translate.source.refuse(
        f"a bound of {s.name} depends on a variable", s.variable, hint="give a number"
    )
