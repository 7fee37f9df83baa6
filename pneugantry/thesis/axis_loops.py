"""Runs in the fixed frame (x, z), each axis with a loop of its own or none, as in the tuning of
§3.4.1, §3.4.2 and §4.2.1: u_x = u_0x - c_x, u_z = u_0z + c_z, c of Eq. 3-3 to 3-6.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.gains import PidGains
from controllers.interface import Command, Sense, clip_command
from controllers.pi import barred_side
from controllers.pid import PidState, pid_next, pid_output
from controllers.valve import U_0X, U_0Z
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.log import PERIOD
from pyfmi_runner.plant import CLAMPS, COMMANDS, OUTPUTS
from pyfmi_runner.sensors import SensorParams, initial_state, noise_rows, sense

__all__ = ["LOOPS", "PERIOD", "AxisLoop", "Driven", "drive", "drive_loops"]

LOOPS = {"v_x": "x", "f_x": "x", "f_z": "z", "v_z": "z"}  # what a loop controls: its axis
OFFSET = {"x": (U_0X, -1), "z": (U_0Z, 1)}  # V; du/dc
Law = Callable[[float, Sense], Command]  # time [s], sample


class Driven(NamedTuple):
    """A run, every sample."""

    time: NDArray[np.float64]  # s
    measured: NDArray[np.float64]  # (samples, 8), in the order of Sense
    u: NDArray[np.float64]  # V, (samples, 2): x, z

    def of(self, name: str) -> NDArray[np.float64]:
        """A channel of Sense, or "u_x", "u_z"."""
        if name in COMMANDS:
            return self.u[:, COMMANDS.index(name)]
        return self.measured[:, Sense._fields.index(name)]


@dataclass
class AxisLoop:
    """A PID on one axis; off, with u = 0, before `start` [s]. Holds the state of one run."""

    controls: str  # a key of LOOPS
    gains: PidGains
    set_point: float  # N or m/s
    start: float = 0.0
    state: PidState = field(default_factory=PidState)

    def command(self, time: float, sample: Sense) -> float:
        """u [V] of its axis."""
        if time < self.start:
            return 0.0
        error = self.set_point - float(getattr(sample, self.controls))
        offset, sign = OFFSET[LOOPS[self.controls]]
        u = offset + sign * pid_output(self.gains, self.state, error, PERIOD)
        self.state = pid_next(self.gains, self.state, error, PERIOD, barred_side(u, sign))
        return float(clip_command(u))


def drive(
    fmu: FmuFile,
    parameters: Mapping[str, float],
    law: Law,
    seconds: float,
    clamped: str = "",
) -> Driven:
    """The FMU from rest under a law with noisy samples; clamped: "x", "z" or none. Raises RunError
    where the FMU fails.
    """
    samples = round(seconds / PERIOD)
    sensors, noise, state = SensorParams(), noise_rows(samples, seed=0), initial_state()
    measured, u = np.empty((samples, len(OUTPUTS))), np.empty((samples, 2))
    with FmuSession(fmu, parameters=dict(parameters)) as session:
        for axis in clamped:
            session.set(CLAMPS["xz".index(axis)], True)
        for k in range(samples):
            true = session.get(OUTPUTS).tolist()
            state, sample = sense(sensors, state, tuple(true), noise[k])  # type: ignore[arg-type]
            command = law(k * PERIOD, Sense(*sample))
            measured[k], u[k] = sample, command
            session.set(COMMANDS, command)
            session.step(PERIOD, time=k * PERIOD)
    return Driven(PERIOD * np.arange(samples, dtype=np.float64), measured, u)


def drive_loops(
    fmu: FmuFile,
    parameters: Mapping[str, float],
    loops: list[AxisLoop],
    seconds: float,
    clamped: str = "",
) -> Driven:
    """At most one loop an axis; an axis without one gets u = 0."""
    by_axis = {LOOPS[loop.controls]: loop for loop in loops}

    def law(time: float, sample: Sense) -> Command:
        parts = (by_axis[a].command(time, sample) if a in by_axis else 0.0 for a in "xz")
        return Command(*parts)

    return drive(fmu, parameters, law, seconds, clamped)
