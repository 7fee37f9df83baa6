"""The sampled loop, sample by sample in Python: plant FMU, sensors, controller. Slow, and open to a
debugger.

`compiled_loop` does the same in machine code and gives the same bits.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controllers.interface import Command, Controller, Reference, Sense
from modelica_fmu.errors import InputError, RunError
from pyfmi_runner.fmu import FmuSession
from pyfmi_runner.plan import APPROACH, RETREAT, Plan
from pyfmi_runner.plant import CLAMPS, COMMANDS, MANUAL, OUTPUTS, PROFILE
from pyfmi_runner.sensors import SensorParams, initial_state, sense
from pyfmi_runner.workpiece import local_profile

__all__ = ["MICROSECOND", "Progress", "Rows", "python_loop", "set_inputs"]

MICROSECOND = 1e-6  # s
Progress = Callable[[int, int], bool]  # (samples done, samples in all) -> go on?


@dataclass(eq=False)
class Rows:
    """What a run has recorded; the first `done` rows count."""

    commands: NDArray[np.float64]  # (samples, 2): the command that acts from t_k on, V
    measured: NDArray[np.float64]  # (samples, 8), in the order of the logs
    theta: NDArray[np.float64]  # (samples,), true slope angle, rad
    done: int = 0
    failure: str = ""  # why the run ended early
    cancelled: bool = False
    seconds: float = 0.0  # wall time of the stepping alone

    @classmethod
    def empty(cls, samples: int) -> Rows:
        return cls(np.empty((samples, 2)), np.empty((samples, 8)), np.empty(samples))


def python_loop(
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
    started = time.perf_counter()
    sensor_state = initial_state()
    acting = Command(*plan.approach)
    given: list[Command] = []  # commands by sample; `acted` of them have reached the valves
    acted = 0
    for k in range(plan.samples):
        now, end = k * plan.period, (k + 1) * plan.period
        try:
            set_inputs(fmu, plan, k)
            sensor_state, measured = sense(
                sensors, sensor_state, tuple(fmu.get(OUTPUTS)), plan.noise[k]
            )
            given.append(_command(plan, k, controller, Sense(*measured)))
            while acted <= k and plan.acts[acted] <= now:
                acting, acted = given[acted], acted + 1
            rows.commands[k], rows.measured[k], rows.theta[k] = acting, measured, fmu.get("theta")
            rows.done = k + 1
            fmu.set(COMMANDS, acting)
            while acted <= k and plan.acts[acted] < end:  # a command that acts within the period
                fmu.step((plan.acts[acted] - now) * MICROSECOND, time=now * MICROSECOND)
                now, acting, acted = plan.acts[acted], given[acted], acted + 1
                fmu.set(COMMANDS, acting)
            fmu.step((end - now) * MICROSECOND, time=now * MICROSECOND)
        except (
            RunError,
            InputError,
        ) as error:  # InputError: a command that the FMU does not take, such as NaN
            rows.failure = f"at t = {now * MICROSECOND:.6g} s: {error}"
            break
        if progress is not None and not progress(k + 1, plan.samples):
            rows.cancelled = True
            break
    rows.seconds = time.perf_counter() - started
    return rows


def set_inputs(fmu: FmuSession, plan: Plan, k: int) -> None:
    """Clamps and hand-set forces where they change, the user's own edge about the present
    position.
    """
    if k == 0 or (plan.clamps[k] != plan.clamps[k - 1]).any():
        fmu.set(CLAMPS, plan.clamps[k])
    if k == 0 or (plan.manual[k] != plan.manual[k - 1]).any():
        fmu.set(MANUAL, plan.manual[k])
    if plan.profile is not None:
        x = fmu.get("x")
        fmu.set(PROFILE, (x, *local_profile(*plan.profile, x)))


def _command(plan: Plan, k: int, controller: Controller, measured: Sense) -> Command:
    phase = plan.phase[k]
    if phase == APPROACH:
        return Command(*plan.approach)
    if phase == RETREAT:
        return Command(0.0, 0.0)
    if k == 0 or plan.phase[k - 1] == APPROACH:
        controller.reset()
    return controller.step(Reference(plan.f_nd[k], plan.v_td[k]), measured)
