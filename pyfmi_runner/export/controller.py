"""A controller as a compiled model: its kernel, sampled, between inputs (Sense, Reference) and
outputs (Command).
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import casadi as ca

from controllers.interface import U_MAX, U_MIN, Command, Controller, Reference, Sense
from modelica_fmu import generate
from modelica_fmu.compiled import TIME, CompiledModel, Variable
from modelica_fmu.errors import InputError
from modelica_fmu.hybrid import Branch, HybridSystem, Sample
from modelica_fmu.ir import FlatModel, FlatVariable
from modelica_fmu.layout import Expressions, Layout
from modelica_fmu.symbols import Scalar, Table
from pyfmi_runner.export.kernel import is_symbolic, run_kernel

__all__ = ["ENABLED", "compile_controller"]

ENABLED = "enabled"
STOP = 45.0  # s, of the thesis' experiments
PERIOD = 1e-3  # s, where the controller has no dt of its own
INPUTS: dict[str, tuple[str, str]] = {  # unit, description
    "x": ("m", "Measured x piston position"),
    "z": ("m", "Measured z piston position"),
    "v_x": ("m/s", "Measured speed, x"),
    "v_z": ("m/s", "Measured speed, z"),
    "f_x": ("N", "Measured contact force of the robot on the workpiece, x"),
    "f_z": ("N", "Measured contact force of the robot on the workpiece, z"),
    "f_ax": ("N", "Measured actuator force, x"),
    "f_az": ("N", "Measured actuator force, z"),
    "f_nd": ("N", "Wanted normal force, > 0 presses into the workpiece"),
    "v_td": ("m/s", "Wanted tangential speed, < 0 towards -x"),
}
SOLVER = {  # core.c reads them as the last parameters; without states they decide nothing
    "solver.max_step": (1e-3, "s", "Longest internal step; of no effect here"),
    "solver.tolerance": (1e-4, "1", "Local error of a step; of no effect here"),
}
BOUNDS = {
    "idle.u_x": (U_MIN, U_MAX),
    "idle.u_z": (U_MIN, U_MAX),
    "solver.max_step": (1e-6, 1.0),
    "solver.tolerance": (1e-12, 1e6),
}
OUTPUTS = {
    "u_x": "Command of the x valve; pushes to -x",
    "u_z": "Command of the z valve; pushes to +z",
}


def compile_controller(name: str, controller: Controller) -> CompiledModel:
    """`controller` as a model without states: at every tick the kernel turns inputs and state into
    commands and the next state.

    Its float parameters become parameters of the model; whole numbers and truth values among them
    stay as they are. While `enabled` is false the state is the initial one and the commands are
    `idle.u_x`, `idle.u_z`. Raises InputError for a kernel, parameters or a state that the model
    cannot hold (arrays).
    """
    where = Path(
        inspect.getsourcefile(type(controller).kernel) or inspect.getfile(type(controller))
    )
    parameters = {
        path: value
        for path, value in _leaves(controller.params, "", name, where)
        if isinstance(value, float)
    }
    start = {
        f"state.{path}": value
        for path, value in _leaves(controller.initial_state(), "", name, where)
    }
    period = next((path for path in parameters if path.split(".")[-1] == "dt"), None)
    if period is None:
        parameters["period"], period = PERIOD, "period"
    parameters |= {"idle.u_x": 0.0, "idle.u_z": 0.0}
    system, layout = _system(name, where, parameters, start)
    expressions = _expressions(system, layout, controller, period)
    variables = _variables(layout, period)
    h, c = generate.source(
        system, layout, expressions, variables, (name, {"states": [], "derivatives": []})
    )
    outputs = tuple(i for i, v in enumerate(variables) if v.causality == "output")
    known = tuple(
        i for i, v in enumerate(variables) if v.initial == "exact" or v.causality == "input"
    )
    return CompiledModel(
        name=name,
        identifier=name.replace(".", "_"),
        variables=variables,
        states=(),
        derivatives=(),
        outputs=outputs,
        description=(inspect.getdoc(type(controller)) or name).splitlines()[0],
        dependencies=dict.fromkeys(outputs, ()),
        initial_unknowns=dict.fromkeys(outputs, known),
        n_indicators=0,
        enumerations={},
        sources={"model.h": h, "model.c": c},
        default_stop=STOP,
        tool="PneuGantry",
    )


def _leaves(value: Any, path: str, name: str, where: Path) -> Iterator[tuple[str, Any]]:
    """(path, number) of every number in nested tuples; a NamedTuple's parts go by their names,
    others by [1], [2], ...
    """
    if isinstance(value, tuple):
        fields = getattr(value, "_fields", None)
        for k, part in enumerate(value):
            label = f"{path}.{fields[k]}" if fields else f"{path}[{k + 1}]"
            yield from _leaves(part, label, name, where)
    elif isinstance(value, int | float):
        yield path.lstrip("."), value
    else:
        what = f"holds {type(value).__name__} {path.lstrip('.')}, which an FMU of scalars cannot"
        raise InputError(
            what,
            file=where,
            field=name,
            hint="export a controller of numbers and tuples, or keep it native",
        )


def _filled(value: Any, path: str, symbols: dict[str, ca.SX]) -> Any:
    """The nested tuples of `value` with symbols in place of the numbers that have one."""
    if not isinstance(value, tuple):
        return symbols.get(path.lstrip("."), value)
    fields = getattr(value, "_fields", None)
    parts = [
        _filled(part, f"{path}.{fields[k]}" if fields else f"{path}[{k + 1}]", symbols)
        for k, part in enumerate(value)
    ]
    return type(value)(*parts) if fields else tuple(parts)


def _scalar(
    name: str,
    kind: str,
    value: float,
    unit: str | None = None,
    text: str = "",
    boolean: bool = False,
) -> Scalar:
    variable = FlatVariable(
        name,
        "Boolean" if boolean else "Real",
        "Continuous",
        "input" if kind == "input" else "",
        (),
        unit=unit,
        description=text,
    )
    return Scalar(name, variable, (), kind, ca.SX.sym(name), ca.SX(value))


def _system(
    name: str, where: Path, parameters: dict[str, float], start: dict[str, float]
) -> tuple[HybridSystem, Layout]:
    system = HybridSystem(Table(FlatModel(name, "", where, {})))
    settings = [
        _scalar(n, "parameter", value, unit, text) for n, (value, unit, text) in SOLVER.items()
    ]
    outputs = [_scalar(n, "discrete", 0.0, "V", text) for n, text in OUTPUTS.items()]
    inputs = [_scalar(n, "input", 0.0, *about) for n, about in INPUTS.items()]
    layout = Layout(
        states=[],
        calculated=[],
        algebraics=[],
        n_outputs=0,
        inputs=[
            *inputs,
            _scalar(
                ENABLED,
                "input",
                1.0,
                None,
                "false: initial state, commands idle.u_x and idle.u_z",
                boolean=True,
            ),
        ],
        parameters=[
            *(_scalar(n, "parameter", value) for n, value in parameters.items()),
            *settings,
        ],
        memories=outputs + [_scalar(n, "discrete", float(value)) for n, value in start.items()],
    )
    system.memories = layout.memories
    system.pre = {s.name: ca.SX.sym(f"pre({s.name})") for s in layout.memories}
    return system, layout


def _expressions(
    system: HybridSystem, layout: Layout, controller: Controller, period: str
) -> Expressions:
    parameter = {s.name: s.symbol for s in layout.parameters}
    tick = ca.SX.sym("tick_0")
    system.samples = [Sample(tick, ca.SX(0), parameter[period])]
    branch = Branch(0, tick, ca.SX.sym("fired_0"))
    system.branches = [branch]
    given: dict[str, Any] = {s.name: s.symbol for s in layout.inputs}
    sense = Sense(*(given[n] for n in Sense._fields))
    reference = Reference(*(given[n] for n in Reference._fields))
    state = _filled(
        controller.initial_state(),
        "",
        {n.removeprefix("state."): symbol for n, symbol in system.pre.items()},
    )
    moved, command = run_kernel(
        type(controller).kernel, _filled(controller.params, "", parameter), state, reference, sense
    )
    where = Path(inspect.getsourcefile(type(controller).kernel) or "")
    after = {f"state.{path}": value for path, value in _symbolic_leaves(moved, "")}
    after |= dict(zip(OUTPUTS, Command(*command), strict=True))
    idle = {"u_x": parameter["idle.u_x"], "u_z": parameter["idle.u_z"]}
    updates = []
    for scalar in layout.memories:
        if scalar.name not in after:
            raise InputError(
                f"its kernel leaves out {scalar.name}",
                file=where,
                hint="return a state of the form it was given",
            )
        off = idle.get(scalar.name, _start(scalar))
        updates.append(
            ca.if_else(
                branch.fired,
                ca.if_else(given[ENABLED], ca.SX(after[scalar.name]), off),
                scalar.symbol,
            )
        )
    starts = [idle.get(s.name, _start(s)) for s in layout.memories]
    empty: list[ca.SX] = []
    return Expressions(
        derivatives=empty,
        algebraics=empty,
        indicators=empty,
        conditions=[tick],
        memory_updates=updates,
        state_updates=empty,
        assertions=empty,
        delays=empty,
        delay_times=empty,
        calculated=empty,
        starts=empty,
        memory_starts=starts,
        sample_starts=[ca.SX(0)],
        sample_intervals=[parameter[period]],
        delay_maxima=empty,
    )


def _start(scalar: Scalar) -> ca.SX:
    return ca.SX(0) if scalar.value is None else scalar.value


def _symbolic_leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, tuple):
        fields = getattr(value, "_fields", None)
        for k, part in enumerate(value):
            yield from _symbolic_leaves(
                part, f"{path}.{fields[k]}" if fields else f"{path}[{k + 1}]"
            )
    else:
        yield path.lstrip("."), value if is_symbolic(value) else float(value)


def _variables(layout: Layout, period: str) -> tuple[Variable, ...]:
    return (TIME, *_parameters(layout, period), *_inputs(layout), *_memories(layout))


def _parameters(layout: Layout, period: str) -> Iterator[Variable]:
    texts = {
        period: "Sampling period",
        "idle.u_x": "Command while not enabled",
        "idle.u_z": "Command while not enabled",
    }
    bounds = BOUNDS | {period: (1e-6, 1.0)}
    for i, s in enumerate(layout.parameters):
        low, high = bounds.get(s.name, (None, None))
        yield Variable(
            s.name,
            "parameter",
            "Real",
            "parameter",
            "fixed" if s.name in texts else "tunable",
            "exact",
            i,
            generate.constant_start(s),
            unit="s" if s.name == period else s.variable.unit,
            description=texts.get(s.name, s.variable.description) or None,
            min=low,
            max=high,
        )


def _inputs(layout: Layout) -> Iterator[Variable]:
    for i, s in enumerate(layout.inputs):
        real = s.variable.type == "Real"
        yield Variable(
            s.name,
            "input",
            "Real" if real else "Boolean",
            "input",
            "continuous" if real else "discrete",
            None,
            i,
            generate.constant_start(s),
            unit=s.variable.unit,
            description=s.variable.description,
        )


def _memories(layout: Layout) -> Iterator[Variable]:
    for i, s in enumerate(layout.memories):
        yield Variable(
            s.name,
            "discrete",
            "Real",
            "output" if s.name in OUTPUTS else "local",
            "discrete",
            "calculated",
            i,
            unit=s.variable.unit,
            description=s.variable.description or None,
        )
