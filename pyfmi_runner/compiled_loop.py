"""The sampled loop in machine code: FMU by address, sensor and controller kernels compiled in. Same
bits as `loop.python_loop`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.core.errors import NumbaError
from numba.extending import register_jitable
from numpy.typing import NDArray

from controllers.interface import Command, Controller, Reference, Sense
from modelica_fmu.errors import InputError
from pyfmi_runner.fmu import FmuSession
from pyfmi_runner.loop import MICROSECOND, Progress, Rows
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
    given = np.empty((plan.samples, 2))
    loop = _loop_for(type(controller).kernel)
    wiring, course = _wiring(fmu), _course(plan)
    state, sensor_state, acting, acted = (
        controller.state,
        initial_state(),
        Command(*plan.approach),
        0,
    )
    started = 0.0
    for start, stop in [
        (0, 0),
        *((k, min(k + CHUNK, plan.samples)) for k in range(0, plan.samples, CHUNK)),
    ]:
        try:
            status, rows.done, state, sensor_state, acting, acted, now = loop(
                wiring,
                course,
                sensors,
                controller.params,
                state,
                sensor_state,
                acting,
                acted,
                given,
                start,
                stop,
                rows.commands,
                rows.measured,
                rows.theta,
            )
        except NumbaError as error:  # only ever while it compiles
            lines = [
                line for line in str(error).splitlines() if line.strip()
            ]  # the second says what, the first where in numba
            reason = lines[min(1, len(lines) - 1)] if lines else type(error).__name__
            hint = (
                "decorate it and what it calls with numba's register_jitable, or run with "
                "compiled=False"
            )
            raise InputError(
                f"its kernel cannot be compiled ({reason})",
                field=type(controller).__name__,
                hint=hint,
            ) from error
        controller.state = state
        if status > FMI_WARNING:
            rows.failure = (
                f"at t = {now * MICROSECOND:.6g} s: "
                f"{fmu.stepped_natively(now * MICROSECOND, status)}"
            )
            return rows
        if stop == 0:  # the empty first round compiles the loop
            started = time.perf_counter()
        elif progress is not None and not progress(stop, plan.samples):
            rows.cancelled = True
            break
        rows.seconds = time.perf_counter() - started
    fmu.stepped_natively(rows.done * plan.period * MICROSECOND)
    return rows


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


@lru_cache(maxsize=64)
def _loop_for(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """The loop with a controller's kernel compiled in. Not cached on disk: a kernel's own file may
    change.
    """

    @njit(nogil=True)
    def loop(  # type: ignore[no-untyped-def]
        wiring,
        course,
        sensors,
        params,
        state,
        sensor_state,
        acting,
        acted,
        given,
        start,
        stop,
        commands,
        measured,
        theta,
    ):
        two, flags, four, outputs = np.empty(2), np.empty(2, np.int32), np.empty(4), np.empty(9)
        one = np.empty(1)
        status = 0
        done = start
        now = np.int64(start * course.period)
        for k in range(start, stop):
            now = np.int64(k * course.period)
            end = np.int64((k + 1) * course.period)
            if (
                k == 0
                or course.clamps[k, 0] != course.clamps[k - 1, 0]
                or course.clamps[k, 1] != course.clamps[k - 1, 1]
            ):
                flags[:] = course.clamps[k]
                status = max(
                    status,
                    native_values(wiring.set_boolean, wiring.component, wiring.clamps, flags),
                )
            if (
                k == 0
                or course.manual[k, 0] != course.manual[k - 1, 0]
                or course.manual[k, 1] != course.manual[k - 1, 1]
            ):
                two[:] = course.manual[k]
                status = max(
                    status, native_values(wiring.set_real, wiring.component, wiring.manual, two)
                )
            if course.own_profile:
                status = max(
                    status,
                    native_values(wiring.get_real, wiring.component, wiring.outputs[:1], one),
                )
                height, slope, curvature = local_profile(
                    course.coefficients, course.x0, course.dx, one[0]
                )
                four[0], four[1], four[2], four[3] = one[0], height, slope, curvature
                status = max(
                    status, native_values(wiring.set_real, wiring.component, wiring.profile, four)
                )
            status = max(
                status, native_values(wiring.get_real, wiring.component, wiring.outputs, outputs)
            )
            true = (
                outputs[0],
                outputs[1],
                outputs[2],
                outputs[3],
                outputs[4],
                outputs[5],
                outputs[6],
                outputs[7],
            )
            sensor_state, seen = sense(sensors, sensor_state, true, course.noise[k])
            if course.phase[k] == APPROACH:
                command = Command(course.approach[0], course.approach[1])
            elif course.phase[k] == RETREAT:
                command = Command(0.0, 0.0)
            else:
                sample = Sense(
                    seen[0], seen[1], seen[2], seen[3], seen[4], seen[5], seen[6], seen[7]
                )
                state, command = kernel(
                    params, state, Reference(course.f_nd[k], course.v_td[k]), sample
                )
            given[k, 0], given[k, 1] = command.u_x, command.u_z
            while acted <= k and course.acts[acted] <= now:
                acting, acted = Command(given[acted, 0], given[acted, 1]), acted + 1
            commands[k, 0], commands[k, 1], theta[k] = acting.u_x, acting.u_z, outputs[8]
            for j in range(8):
                measured[k, j] = seen[j]
            done = k + 1
            two[0], two[1] = acting.u_x, acting.u_z
            status = max(
                status, native_values(wiring.set_real, wiring.component, wiring.commands, two)
            )
            while acted <= k and course.acts[acted] < end:
                until = course.acts[acted]
                status = max(
                    status,
                    call_step(
                        wiring.do_step,
                        wiring.component,
                        now * MICROSECOND,
                        (until - now) * MICROSECOND,
                    ),
                )
                now = until
                acting, acted = Command(given[acted, 0], given[acted, 1]), acted + 1
                two[0], two[1] = acting.u_x, acting.u_z
                status = max(
                    status, native_values(wiring.set_real, wiring.component, wiring.commands, two)
                )
            status = max(
                status,
                call_step(
                    wiring.do_step, wiring.component, now * MICROSECOND, (end - now) * MICROSECOND
                ),
            )
            if status > FMI_WARNING:
                break
        return status, done, state, sensor_state, acting, acted, now

    return loop  # type: ignore[no-any-return]
