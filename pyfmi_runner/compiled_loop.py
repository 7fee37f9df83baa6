"""The sampled loop in machine code: FMU by address, sensor and controller kernels compiled in. Same
bits as `loop.python_loop`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba.core.errors import NumbaError
from numba.extending import register_jitable
from numpy.typing import NDArray

from controllers.interface import Command, Controller, Reference, Sense
from modelica_fmu.errors import InputError
from pyfmi_runner.fmu import FmuSession
from pyfmi_runner.loop import MICROSECOND, Progress, Rows
from pyfmi_runner.machine_code import kept
from pyfmi_runner.native import call_step, call_values
from pyfmi_runner.plan import APPROACH, RETREAT, Plan
from pyfmi_runner.plant import CLAMPS, COMMANDS, MANUAL, OUTPUTS, PROFILE
from pyfmi_runner.sensors import SensorParams, initial_state, sense
from pyfmi_runner.workpiece import local_profile

__all__ = ["FMI_WARNING", "compiled_loop", "native_values"]

CHUNK = 4096  # samples between two looks at progress and cancel
FMI_WARNING = 1


class Wiring(NamedTuple):
    """Addresses and value references of one FMU instance."""

    component: int
    set_real: int
    set_boolean: int
    get_real: int
    do_step: int
    commands: NDArray[np.uint32]
    clamps: NDArray[np.uint32]
    manual: NDArray[np.uint32]
    profile: NDArray[np.uint32]
    outputs: NDArray[np.uint32]  # OUTPUTS, then theta


class Course(NamedTuple):
    """The arrays of a `Plan`."""

    period: int
    phase: NDArray[np.int64]
    f_nd: NDArray[np.float64]
    v_td: NDArray[np.float64]
    clamps: NDArray[np.int32]
    manual: NDArray[np.float64]
    approach: tuple[float, float]
    acts: NDArray[np.int64]
    noise: NDArray[np.float64]
    own_profile: bool
    coefficients: NDArray[np.float64]
    x0: float
    dx: float


class Models(NamedTuple):
    """What does not change during a run."""

    sensors: SensorParams
    params: Any  # of the controller


class Carry(NamedTuple):
    """What one sample leaves to the next."""

    state: Any  # of the controller
    sensor_state: Any
    acting: Command
    acted: int  # commands that have begun to act


class Records(NamedTuple):
    """What a run fills, one row per sample."""

    given: NDArray[np.float64]  # V, (N, 2): commands as the controller gave them
    commands: NDArray[np.float64]  # V, (N, 2): commands that act from the row's instant on
    measured: NDArray[np.float64]  # (N, 8)
    theta: NDArray[np.float64]  # rad


def compiled_loop(
    fmu: FmuSession,
    plan: Plan,
    controller: Controller,
    sensors: SensorParams,
    progress: Progress | None = None,
) -> Rows:
    """Runs `plan` on a session that is ready to step. A failing FMU ends the run; what was recorded
    stays.
    """
    rows = Rows.empty(plan.samples)
    controller.reset()
    loop = _loop_for(type(controller).kernel)
    wiring, course = _wiring(fmu), _course(plan)
    models = Models(sensors, controller.params)
    carry = Carry(controller.state, initial_state(), Command(*plan.approach), 0)
    records = Records(np.empty((plan.samples, 2)), rows.commands, rows.measured, rows.theta)
    chunks = [(k, min(k + CHUNK, plan.samples)) for k in range(0, plan.samples, CHUNK)]
    started = 0.0
    for span in [(0, 0), *chunks]:  # the empty first one compiles the loop
        try:
            status, rows.done, now, carry = loop(wiring, course, models, carry, records, span)
        except NumbaError as error:  # only ever while it compiles
            raise _not_compiled(controller, error) from error
        controller.state = carry.state
        if status > FMI_WARNING:
            time_now = now * MICROSECOND
            rows.failure = f"at t = {time_now:.6g} s: {fmu.stepped_natively(time_now, status)}"
            return rows
        if span[1] == 0:
            started = time.perf_counter()
        elif progress is not None and not progress(span[1], plan.samples):
            rows.cancelled = True
            break
        rows.seconds = time.perf_counter() - started
    fmu.stepped_natively(rows.done * plan.period * MICROSECOND)
    return rows


def _not_compiled(controller: Controller, error: NumbaError) -> InputError:
    """What numba says of a kernel: the second line says what, the first where in numba."""
    lines = [line for line in str(error).splitlines() if line.strip()]
    reason = lines[min(1, len(lines) - 1)] if lines else type(error).__name__
    return InputError(
        f"its kernel cannot be compiled ({reason})",
        field=type(controller).__name__,
        hint="decorate it and what it calls with numba's register_jitable, or run with "
        "compiled=False",
    )


def _wiring(fmu: FmuSession) -> Wiring:
    raw = fmu.raw()
    return Wiring(
        raw.component,
        raw.set_real,
        raw.set_boolean,
        raw.get_real,
        raw.do_step,
        fmu.references(COMMANDS),
        fmu.references(CLAMPS),
        fmu.references(MANUAL),
        fmu.references(PROFILE),
        fmu.references((*OUTPUTS, "theta")),
    )


def _course(plan: Plan) -> Course:
    coefficients, x0, dx = (
        plan.profile if plan.profile is not None else (np.zeros((1, 6)), 0.0, 1.0)
    )
    return Course(
        plan.period,
        plan.phase,
        plan.f_nd,
        plan.v_td,
        plan.clamps,
        plan.manual,
        plan.approach,
        plan.acts,
        plan.noise,
        plan.profile is not None,
        coefficients,
        x0,
        dx,
    )


@register_jitable
def native_values(
    function: int, component: int, references: NDArray[np.uint32], values: NDArray[Any]
) -> int:
    return call_values(
        function, component, references.ctypes.data, references.size, values.ctypes.data
    )


@register_jitable
def _changed(switches, k):  # type: ignore[no-untyped-def]
    """Whether a row of two switches differs from the one before."""
    return k == 0 or switches[k, 0] != switches[k - 1, 0] or switches[k, 1] != switches[k - 1, 1]


@register_jitable
def _set_switches(wiring, course, k):  # type: ignore[no-untyped-def]
    """Clamps and pulls by hand, where they change; returns the FMU's status."""
    status = 0
    if _changed(course.clamps, k):
        flags = np.empty(2, np.int32)
        flags[:] = course.clamps[k]
        status = native_values(wiring.set_boolean, wiring.component, wiring.clamps, flags)
    if _changed(course.manual, k):
        two = np.empty(2)
        two[:] = course.manual[k]
        manual = native_values(wiring.set_real, wiring.component, wiring.manual, two)
        status = max(status, manual)
    return status


@register_jitable
def _set_edge(wiring, course, one, four):  # type: ignore[no-untyped-def]
    """Height, slope and curvature of a user's edge about the present x; returns the status."""
    status = native_values(wiring.get_real, wiring.component, wiring.outputs[:1], one)
    height, slope, curvature = local_profile(course.coefficients, course.x0, course.dx, one[0])
    four[0], four[1], four[2], four[3] = one[0], height, slope, curvature
    return max(status, native_values(wiring.set_real, wiring.component, wiring.profile, four))


@register_jitable
def _set_command(wiring, command, two):  # type: ignore[no-untyped-def]
    two[0], two[1] = command.u_x, command.u_z
    return native_values(wiring.set_real, wiring.component, wiring.commands, two)


@register_jitable
def _step(wiring, now, until):  # type: ignore[no-untyped-def]
    """The FMU from `now` to `until`, both in microseconds; returns its status."""
    start, length = now * MICROSECOND, (until - now) * MICROSECOND
    return call_step(wiring.do_step, wiring.component, start, length)


@lru_cache(maxsize=64)
def _loop_for(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """The loop with a controller's kernel compiled in."""
    control = _control_with(kernel)

    def loop(wiring, course, models, carry, records, span):  # type: ignore[no-untyped-def]
        one, two, four, outputs = np.empty(1), np.empty(2), np.empty(4), np.empty(9)
        state, sensor_state, acting, acted = carry
        start, stop = span
        status, done, now = 0, start, np.int64(start * course.period)
        for k in range(start, stop):
            now, end = np.int64(k * course.period), np.int64((k + 1) * course.period)
            status = max(status, _set_switches(wiring, course, k))
            if course.own_profile:
                status = max(status, _set_edge(wiring, course, one, four))
            read = native_values(wiring.get_real, wiring.component, wiring.outputs, outputs)
            status = max(status, read)
            sensor_state, seen = sense(
                models.sensors, sensor_state, _eight(outputs), course.noise[k]
            )
            state, command = control(course, models.params, state, seen, k)
            records.given[k, 0], records.given[k, 1] = command.u_x, command.u_z
            while acted <= k and course.acts[acted] <= now:
                acting, acted = Command(records.given[acted, 0], records.given[acted, 1]), acted + 1
            records.commands[k, 0], records.commands[k, 1] = acting.u_x, acting.u_z
            records.theta[k] = outputs[8]
            for j in range(8):
                records.measured[k, j] = seen[j]
            done = k + 1
            status = max(status, _set_command(wiring, acting, two))
            while acted <= k and course.acts[acted] < end:  # a command that acts within the period
                until = course.acts[acted]
                status = max(status, _step(wiring, now, until))
                now = until
                acting, acted = Command(records.given[acted, 0], records.given[acted, 1]), acted + 1
                status = max(status, _set_command(wiring, acting, two))
            status = max(status, _step(wiring, now, end))
            if status > FMI_WARNING:
                break
        return status, done, now, Carry(state, sensor_state, acting, acted)

    return kept(loop, kernel)


@register_jitable
def _eight(values):  # type: ignore[no-untyped-def]
    """The sensed outputs as a tuple, in the order of MEASURED."""
    return (
        values[0],
        values[1],
        values[2],
        values[3],
        values[4],
        values[5],
        values[6],
        values[7],
    )


def _control_with(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """The command of a sample: open loop before contact, nothing in retreat, else the kernel's."""

    @register_jitable
    def control(course, params, state, seen, k):  # type: ignore[no-untyped-def]
        if course.phase[k] == APPROACH:
            return state, Command(course.approach[0], course.approach[1])
        if course.phase[k] == RETREAT:
            return state, Command(0.0, 0.0)
        sample = Sense(seen[0], seen[1], seen[2], seen[3], seen[4], seen[5], seen[6], seen[7])
        return kernel(params, state, Reference(course.f_nd[k], course.v_td[k]), sample)

    return control
