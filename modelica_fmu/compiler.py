"""Modelica → CompiledModel: flatten, translate, sort, differentiate, print C."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import casadi as ca

from modelica_fmu import generate
from modelica_fmu.about import about_file
from modelica_fmu.alone import alone
from modelica_fmu.compiled import CompiledModel, Variable
from modelica_fmu.errors import InputError, Undecided
from modelica_fmu.frontend import flatten
from modelica_fmu.generate import jumping
from modelica_fmu.hybrid import HybridSystem
from modelica_fmu.index_reduction import reduce_index
from modelica_fmu.initialisation import Initial, initial_system, is_fixed, is_free_parameter
from modelica_fmu.ir import FlatModel
from modelica_fmu.layout import Expressions, Layout, column
from modelica_fmu.sorting import solve
from modelica_fmu.symbols import Scalar
from modelica_fmu.translation import build_system
from modelica_fmu.variables import fmi_variables

CORE = ("core.h", "core.c")


@alone
def compile_model(
    path: Path | None,
    class_name: str,
    starts: Mapping[str, float] | None = None,
    libraries: Sequence[Path] = (),
) -> CompiledModel:
    """Compiles `class_name` of the Modelica file `path` to C. `starts`: values of parameters in
    place of the model's own.

    Raises InputError, with file and line, for what is not Modelica or not supported, and for a
    start of what is no free parameter.
    """
    try:
        compiled = _decided(path, class_name, libraries, starts or {})
        return compiled if path is None else replace(compiled, about=about_file(path))
    except RecursionError:
        hint = "split it over several variables"
        raise InputError(
            "an expression is nested too deeply, or has too many terms", file=path, hint=hint
        ) from None


def _decided(
    path: Path | None, class_name: str, libraries: Sequence[Path], starts: Mapping[str, float]
) -> CompiledModel:
    """Compiles; where a function's sizes or rounds hang on parameters, these become constants."""
    fixed: frozenset[str] = frozenset()
    while True:
        model = flatten(path, class_name, libraries, fixed)
        parameters = {n for n, v in model.variables.items() if v.variability == "Parameter"}
        try:
            return compile_system(build_system(model), starts)
        except Undecided as open_:
            names = {n if n in parameters else n.rpartition("[")[0] for n in open_.names}
            if not names or not names <= parameters:
                raise
            fixed |= names


def compile_system(
    system: HybridSystem, starts: Mapping[str, float] | None = None, part: bool = False
) -> CompiledModel:
    """Compiles a system of equations. part: one that was cut out, for `batch`, without what only an
    FMU has to answer. Raises as `compile_model`.
    """
    model = system.table.model
    reduce_index(system)
    solved = solve(system)
    initial = initial_system(system, solved)
    layout = _layout(system, part)
    _restart(layout.parameters, starts or {}, model)
    expressions = _expressions(system, layout, solved, initial)
    plain, enumerations = _typed(fmi_variables(system, layout, initial), model)
    states = [i for i, v in enumerate(plain) if v.kind == "state"]
    derivatives = [i for i, v in enumerate(plain) if v.kind == "derivative"]
    h, c = generate.source(
        system,
        layout,
        expressions,
        plain,
        (model.name, {"states": states, "derivatives": derivatives}),
    )
    outputs = tuple(i for i, v in enumerate(plain) if v.causality == "output")
    return CompiledModel(
        name=model.name,
        identifier=model.name.replace(".", "_"),
        description=model.description,
        variables=plain,
        states=tuple(states),
        derivatives=tuple(derivatives),
        outputs=outputs,
        dependencies=_dependencies(layout, expressions, plain),
        initial_unknowns=_initial_unknowns(layout, expressions, plain),
        n_indicators=len(system.relations) + jumping(system),
        enumerations=enumerations,
        sources={"model.h": h, "model.c": c},
        switching=_switching(system, layout, expressions),
        files=model.files,
        default_stop=model.stop_time or 1.0,
    )


def _typed(
    variables: tuple[Variable, ...], model: FlatModel
) -> tuple[tuple[Variable, ...], dict[str, tuple[tuple[str, str], ...]]]:
    """Variables and the enumerations they use, each under its last name where that is enough."""
    used = dict.fromkeys(v.enumeration for v in variables if v.enumeration is not None)
    last = [name.rsplit(".", 1)[-1] for name in used]
    taken = {
        name: short if last.count(short) == 1 else name
        for name, short in zip(used, last, strict=True)
    }
    return (
        tuple(
            v if v.enumeration is None else replace(v, enumeration=taken[v.enumeration])
            for v in variables
        ),
        {short: model.enumerations[name] for name, short in taken.items()},
    )


def _switching(system: HybridSystem, layout: Layout, expressions: Expressions) -> tuple[str, ...]:
    """States whose rate reads a relation that more than the clock decides."""
    still = {"time", *(s.symbol.name() for s in (*layout.parameters, *layout.calculated))}
    among = [r for r in system.relations if not _symbols_in(r.indicator) <= still]
    relations = column([r.symbol for r in among])
    return tuple(
        s.name
        for s, rate in zip(layout.states, expressions.derivatives, strict=True)
        if relations.numel() and ca.depends_on(rate, relations)
    )


def _restart(parameters: Sequence[Scalar], starts: Mapping[str, float], model: FlatModel) -> None:
    known = {s.name: s for s in parameters}
    for name, value in starts.items():
        if name not in known:
            raise InputError(
                f"{model.name} has no free parameter {name}",
                file=model.file,
                field=name,
                hint="give one that it has",
            )
        known[name].value = ca.SX(value)


def _layout(system: HybridSystem, part: bool) -> Layout:
    table = system.table
    algebraics = [s for s in table.of("algebraic") if not s.variable.protected]
    outputs = [s for s in algebraics if s.variable.causality == "output"]
    rest = [s for s in algebraics if s.variable.causality != "output"]
    return Layout(
        states=table.of("state"),
        inputs=table.of("input"),
        parameters=table.of("parameter"),
        calculated=_ordered(system, table.of("calculated")),
        memories=system.memories,
        algebraics=outputs + rest,
        n_outputs=len(outputs),
        part=part,
    )


def _ordered(system: HybridSystem, scalars: list[Scalar]) -> list[Scalar]:
    """Calculated parameters, each after those it depends on."""
    for scalar in scalars:
        if not _known(system, scalar):
            raise system.table.source.refuse(
                f"the parameter {scalar.name} depends on a variable: it cannot depend on one",
                scalar.variable,
                hint="let it depend on parameters only",
            )
    names = {s.name for s in scalars}
    done: list[Scalar] = []
    waiting = list(scalars)
    while waiting:
        ready = [
            s
            for s in waiting
            if is_free_parameter(s) or not (_symbols_in(s.value) & names) - {d.name for d in done}
        ]
        if not ready:
            them = ", ".join(s.name for s in waiting)
            circle = f"cyclic parameters, which depend on one another: {them}"
            raise system.table.source.refuse(circle, waiting[0].variable, hint="break the circle")
        done += ready
        waiting = [s for s in waiting if s not in ready]
    return done


def _symbols_in(value: ca.SX | None) -> set[str]:
    return set() if value is None else {v.name() for v in ca.symvar(value)}


def _expressions(
    system: HybridSystem, layout: Layout, solved: dict[str, ca.SX], initial: Initial
) -> Expressions:
    algebraic = list(system.table.of("algebraic"))
    old = [s.symbol for s in algebraic] + list(system.derivatives.values())
    new = [solved[s.name] for s in algebraic] + [
        solved[f"der({name})"] for name in system.derivatives
    ]

    def put(items: list[ca.SX]) -> list[ca.SX]:
        return [ca.densify(v) for v in (ca.substitute(items, old, new) if old and items else items)]

    memory = {s.name: s.symbol for s in layout.memories}
    updates = {
        s.name: (solved[s.name] if s.kind == "algebraic" else s.symbol) for s in layout.memories
    }
    updates |= system.updates
    chosen: list[ca.SX] = list(system.updates.values())
    chosen += [b.condition for b in system.branches]
    states = {s.name: s.symbol for s in layout.states}
    for branch in reversed(system.branches):
        new_values = _sequential(branch.assigns, memory)
        for name, value in new_values.items():
            updates[name] = ca.if_else(branch.fired, value, updates[name])
        chosen += [*new_values.values(), *branch.reinits.values()]
        for name, value in branch.reinits.items():
            states[name] = ca.if_else(branch.fired, value, states[name])
    sought = {s.name for s in initial.unknowns}
    for scalar in layout.states + layout.memories:
        if scalar.name in sought or not is_fixed(scalar):
            scalar.value = scalar.value if _known(system, scalar) else ca.SX(0)
        if not _known(system, scalar):
            raise system.table.source.refuse(
                f"the start value of {scalar.name} depends on a variable",
                scalar.variable,
                hint="let it depend on parameters only",
            )
    return Expressions(
        derivatives=put([solved[f"der({s.name})"] for s in layout.states]),
        algebraics=put([s.symbol for s in layout.algebraics]),
        indicators=put([r.indicator for r in system.relations]),
        conditions=put([b.condition for b in system.branches]),
        memory_updates=put([updates[s.name] for s in layout.memories]),
        state_updates=put([states[s.name] for s in layout.states]),
        assertions=put([a.condition for a in system.assertions]),
        delays=put([d.expression for d in system.delays]),
        delay_times=put([d.time for d in system.delays]),
        delay_maxima=put([d.maximum for d in system.delays]),
        calculated=[s.symbol if is_free_parameter(s) else start_of(s) for s in layout.calculated],
        initial_unknowns=initial.unknowns,
        initial_residuals=put(initial.residuals),
        initial_guesses=[s.symbol if s.kind == "state" else start_of(s) for s in initial.unknowns],
        constraints=put(system.constraints),
        loop_starts=[v for loop in system.loops for v in loop.starts],
        chained=_depend(put(chosen), list(memory.values())),
        roundings=put([ca.floor(r.argument) for r in system.roundings]),
        starts=[s.value if s.value is not None else ca.SX(0) for s in layout.states],
        memory_starts=[s.value if s.value is not None else ca.SX(0) for s in layout.memories],
        sample_starts=[s.start for s in system.samples],
        sample_intervals=[s.interval for s in system.samples],
    )


def _depend(expressions: list[ca.SX], symbols: list[ca.SX]) -> bool:
    if not (expressions and symbols):
        return False
    return bool(ca.depends_on(ca.vertcat(*expressions), ca.vertcat(*symbols)))


def start_of(scalar: Scalar) -> ca.SX:
    return scalar.value if scalar.value is not None else ca.SX(0)


def _known(system: HybridSystem, scalar: Scalar) -> bool:
    """Whether its start value depends on parameters only."""
    value = start_of(scalar)
    return not any(_is_moving(system, v) for v in ca.symvar(value))


def _is_moving(system: HybridSystem, symbol: ca.SX) -> bool:
    scalar = system.table.scalars.get(symbol.name())
    return scalar is None or scalar.kind not in ("parameter", "calculated", "constant")


def _sequential(assigns: dict[str, ca.SX], memory: dict[str, ca.SX]) -> dict[str, ca.SX]:
    """Within one branch a variable that another assignment uses stands for its new value."""
    result = dict(assigns)
    for _ in assigns:
        changed = False
        for name, value in result.items():
            others = [n for n in assigns if n != name and ca.depends_on(value, memory[n])]
            if others:
                result[name] = ca.substitute(
                    [value], [memory[n] for n in others], [result[n] for n in others]
                )[0]
                changed = True
        if not changed:
            break
    return result


def _dependencies(
    layout: Layout, e: Expressions, variables: tuple[Variable, ...]
) -> dict[int, tuple[int, ...]]:
    known = [(i, v) for i, v in enumerate(variables) if v.kind in ("state", "input")]
    symbols = column(
        [(layout.states if v.kind == "state" else layout.inputs)[v.index].symbol for _, v in known]
    )
    result = {}
    for i, v in enumerate(variables):
        if v.kind == "derivative" or v.causality == "output":
            expression = e.derivatives[v.index] if v.kind == "derivative" else e.algebraics[v.index]
            pattern = ca.jacobian_sparsity(expression, symbols)
            result[i] = tuple(known[j][0] for j in sorted(set(pattern.get_triplet()[1])))
    return result


def _initial_unknowns(
    layout: Layout, e: Expressions, variables: tuple[Variable, ...]
) -> dict[int, tuple[int, ...]]:
    """Unknowns of initialisation with everything they may depend on (conservative: all knowns)."""
    known = tuple(
        i
        for i, v in enumerate(variables)
        if v.kind == "input" or (v.kind in ("parameter", "state") and v.initial == "exact")
    )
    return {
        i: known
        for i, v in enumerate(variables)
        if v.causality in ("output", "calculatedParameter")
        or v.kind == "derivative"
        or (v.kind == "state" and v.initial == "calculated")
    }


__all__ = ["CORE", "compile_model", "compile_system"]
