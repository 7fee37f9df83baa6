"""The mechanics as one view: both cylinders and the contact, driven by the measured actuator forces from a log's start to its end.

No restart and no measured speed goes in, so the residual is the sensors' white noise where friction and contact are right, and
what the valves do plays no part: in the gantry FMU they pass the measured force on.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from diagnosis.signals import Table
from diagnosis.views import SignalStore, Values
from pyfmi_runner.block_fmu import BlockFmu
from pyfmi_runner.log import PERIOD
from pyfmi_runner.plant import plant_parameters

__all__ = ["MechanicsView"]

Array = NDArray[np.float64]
SEGMENT = 100  # samples; a segment far off (a missed break-away) counts by its logarithm only
KNEE = 4.0  # mean square of a segment from which on it does
OUTPUTS = ("v_x", "v_z", "f_x", "f_z")
# The valves pass the hand-set force on, within their shortest lag of 1 ms, which the inputs lead.
SOLVER = {"solver.tolerance": 0.1}  # a millisecond a step but for stiff friction: exact to 0.01 of the noise
BYPASS = {f"valve_{a}.{p}": v for a in "xz" for p, v in (("K", 0.0), ("tau", 1e-3))}


class MechanicsView:
    """(f_ax, f_az) → v_x, v_z, f_x, f_z on the logs in which an axis is free."""

    name = "mechanics"
    tolerance: tuple[str, ...] = (
        *(f"axis_{axis}.{name}" for axis in "xz" for name in ("m", "C", "F_w", "friction.F_s", "friction.F_d")),
        "contact.K_c",
        "contact.C_c",
    )

    def __init__(self, gantry: BlockFmu, store: SignalStore) -> None:
        self._gantry, self._store = gantry, store
        self.actuator = {a: smoothed(store.table.columns[f"f_a{a}"], store.table.spans) for a in "xz"}
        self.logs = [i for i, (first, last) in enumerate(store.table.spans) if not _all_clamped(store.table, first, last)]

    def depends_on(self, parameter: str) -> bool:
        if parameter.startswith("sensors."):
            return not parameter.startswith("sensors.quantum")
        return parameter.startswith(("axis_", "contact.", "workpiece.")) or parameter in ("coupling", "waviness")

    def residual(self, values: Values) -> Array:
        """(rows, 4) in units of the noise; NaN on logs that are not judged."""
        table = self._store.table
        result = np.full((table.rows, len(OUTPUTS)), np.nan)
        for i in self.logs:
            rows = slice(*table.spans[i])
            simulated = sensed(self.simulate(i, values), values)
            for column, name in enumerate(OUTPUTS):
                result[rows, column] = (table.columns[name][rows] - simulated[:, column]) / table.sigma[name]
        return result

    def simulate(self, i: int, values: Values) -> Array:
        """True outputs (n, 4) of log i."""
        table, setup = self._store.table, self._store.table.setups[i]
        rows = slice(*table.spans[i])
        force = np.column_stack([ahead(self.actuator[a][rows] / values.get(f"sensors.gain_f_a{a}", 1.0)) for a in "xz"])
        clamps = np.column_stack([table.clamped[a][rows] for a in "xz"]).astype(np.float64)
        plant = {k: v for k, v in values.items() if not k.startswith(("sensors.", "timing.", "valve_")) and k != "waviness"}
        parameters = {**SOLVER, **BYPASS, **plant_parameters(setup), **plant}
        return self._gantry.run_clamped(parameters, ("f_manual_x", "f_manual_z"), force, ("clamp_x", "clamp_z"), clamps, OUTPUTS)


def ahead(force: Array) -> Array:
    """Input that, behind a lag of 1 ms, follows a sampled force: the exact inverse of the lag between samples, smoothed by their noise."""
    following = np.append(force[1:], force[-1])
    return 0.5 * (force + following) + (following - force)


def sensed(true: Array, values: Values) -> Array:
    """What the sensors, with their assumed errors, say of true v_x, v_z, f_x, f_z (n, 4)."""
    get = values.get
    v_x, v_z = (_tachometer(true[:, k], get(f"sensors.tau_v_{a}", 0.0)) for k, a in enumerate("xz"))
    f_x = get("sensors.gain_f_x", 1.0) * true[:, 2] + get("sensors.crosstalk_f_x", 0.0) * true[:, 3] + get("sensors.bias_f_x", 0.0)
    f_z = get("sensors.gain_f_z", 1.0) * true[:, 3] + get("sensors.crosstalk_f_z", 0.0) * true[:, 2] + get("sensors.bias_f_z", 0.0)
    return np.column_stack([v_x, v_z, f_x, f_z])


def _tachometer(speed: Array, tau: float) -> Array:
    return speed if tau <= 0 else first_order(np.ascontiguousarray(speed), float(np.exp(-PERIOD / tau)))


@njit(cache=True)
def first_order(speed: Array, keep: float) -> Array:
    result = np.empty(len(speed))
    value = speed[0]
    for k in range(len(speed)):
        driven = speed[k] if k == 0 else 0.5 * (speed[k] + speed[k - 1])
        value = keep * value + (1 - keep) * driven
        result[k] = value
    return result


def robust_segments(residual: Array) -> Array:
    """Columns of one log (n, channels) in segments; a segment that went astray counts by its logarithm only."""
    n = len(residual) // SEGMENT * SEGMENT
    blocks = residual[:n].reshape(-1, SEGMENT, residual.shape[1])
    square = np.mean(blocks**2, axis=1, keepdims=True)
    scale = np.where(square > KNEE, np.sqrt(KNEE * (1 + np.log(np.maximum(square, KNEE) / KNEE)) / np.maximum(square, KNEE)), 1.0)
    return np.asarray((blocks * scale).reshape(n, -1))


def smoothed(values: Array, spans: NDArray[np.int64]) -> Array:
    """A measured signal with its noise taken out, log by log."""
    result = np.empty(len(values))
    for first, last in spans:
        result[first:last] = savgol_filter(values[first:last], 15, 2)
    return result


def _all_clamped(table: Table, first: int, last: int) -> bool:
    return bool(table.clamped["x"][first:last].all() and table.clamped["z"][first:last].all())


__all__ += ["first_order", "robust_segments", "sensed", "smoothed"]
