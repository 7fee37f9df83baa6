"""The mechanics as one view: both cylinders and the contact, driven by the measured actuator forces
from a log's start to its end.

No restart and no measured speed goes in, so the residual is the sensors' white noise where friction
and contact are right, and what the valves do plays no part: in the gantry FMU they pass the
measured force on.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from pneugantry.diagnosis.signals import Table, sensed_forces
from pneugantry.diagnosis.tachometer import sensed_speed
from pneugantry.diagnosis.views import SOLVER, SignalStore, Values
from pyfmi_runner.block_fmu import BlockFmu, Guide
from pyfmi_runner.plant import plant_parameters

__all__ = ["MechanicsView", "sensed", "smoothed"]

Array = NDArray[np.float64]
STATES = ("x", "z", "v_x", "v_z")
OUTPUTS = ("v_x", "v_z", "f_x", "f_z")
# The valves pass the hand-set force on, within their shortest lag of 1 ms, which the inputs lead.
BYPASS = {f"valve_{a}.{p}": v for a in "xz" for p, v in (("K", 0.0), ("tau", 1e-3))}


class MechanicsView:
    """(f_ax, f_az) → v_x, v_z, f_x, f_z on the logs in which an axis is free."""

    name = "mechanics"
    tolerance: tuple[str, ...] = (
        *(
            f"axis_{axis}.{name}"
            for axis in "xz"
            for name in ("m", "C", "F_w", "friction.F_s", "friction.F_d")
        ),
        "contact.K_c",
        "contact.C_c",
    )

    def __init__(self, gantry: BlockFmu, store: SignalStore, mass: Mapping[str, float]) -> None:
        self._gantry, self._store, self._mass = gantry, store, mass
        # s in which the simulated carriages are led back to the measured ones; 0: they run freely
        self.guided = 0.0
        self.actuator = {
            a: smoothed(store.table.columns[f"f_a{a}"], store.table.spans) for a in "xz"
        }
        self.every = [
            i
            for i, (first, last) in enumerate(store.table.spans)
            if not _all_clamped(store.table, first, last)
        ]
        self.opened = [i for i in self.every if store.table.setups[i].loop == "open"]
        self.logs = self.every

    def depends_on(self, parameter: str) -> bool:
        if parameter.startswith("sensors."):
            return not parameter.startswith("sensors.quantum")
        return parameter.startswith(("axis_", "contact.", "workpiece.")) or parameter in (
            "coupling",
            "coupling_limit",
            "waviness",
        )

    def residual(self, values: Values) -> Array:
        """(rows, 4) in units of the noise; NaN on logs that are not judged."""
        table = self._store.table
        result = np.full((table.rows, len(OUTPUTS)), np.nan)
        for i in self.logs:
            rows = slice(*table.spans[i])
            simulated = sensed(self.simulate(i, values), table.columns["time"][rows], values)
            for column, name in enumerate(OUTPUTS):
                result[rows, column] = (
                    table.columns[name][rows] - simulated[:, column]
                ) / table.sigma[name]
        return result

    def simulate(self, i: int, values: Values) -> Array:
        """True outputs (n, 4) of log i."""
        table, setup = self._store.table, self._store.table.setups[i]
        rows = slice(*table.spans[i])
        force = np.column_stack(
            [ahead(self.actuator[a][rows] / values.get(f"sensors.gain_f_a{a}", 1.0)) for a in "xz"]
        )
        clamps = np.column_stack([table.clamped[a][rows] for a in "xz"]).astype(np.float64)
        plant = {
            k: v
            for k, v in values.items()
            if not k.startswith(("sensors.", "timing.", "valve_")) and k != "waviness"
        }
        parameters = {**SOLVER, **BYPASS, **plant_parameters(setup), **plant}
        inputs, flags = ("f_manual_x", "f_manual_z"), ("clamp_x", "clamp_z")
        if self.guided <= 0:
            return self._gantry.run_clamped(parameters, inputs, force, flags, clamps, OUTPUTS)
        signals = self._store.signals(
            {k: v for k, v in values.items() if k.startswith(("sensors.tau_v", "sensors.stages_v"))}
        )
        per_speed = [self._mass[a] / self.guided for a in "xz"]
        guide = Guide(
            np.column_stack([signals.position[a][rows] for a in "xz"]),
            np.column_stack([signals.speed[a][rows] for a in "xz"]),
            np.tile([g / (4 * self.guided) for g in per_speed], (len(force), 1)),
            per_speed,
        )
        return self._gantry.run_guided(
            parameters, inputs, force, flags, clamps, (*STATES, *OUTPUTS[2:]), guide
        )[:, 2:]


def ahead(force: Array) -> Array:
    """Input that, behind a lag of 1 ms, follows a sampled force: the exact inverse of the lag
    between samples, smoothed by their noise.
    """
    following = np.append(force[1:], force[-1])
    return 0.5 * (force + following) + (following - force)


def sensed(true: Array, time: Array, values: Values) -> Array:
    """What the sensors, with their assumed errors, say of true v_x, v_z, f_x, f_z (n, 4)."""
    speeds = [sensed_speed(true[:, k], a, values) for k, a in enumerate("xz")]
    return np.column_stack([*speeds, sensed_forces(true[:, 2:4], time, values)])


def smoothed(values: Array, spans: NDArray[np.int64]) -> Array:
    """A measured signal with its noise taken out, log by log."""
    result = np.empty(len(values))
    for first, last in spans:
        result[first:last] = savgol_filter(values[first:last], 15, 2)
    return result


def _all_clamped(table: Table, first: int, last: int) -> bool:
    return bool(table.clamped["x"][first:last].all() and table.clamped["z"][first:last].all())
