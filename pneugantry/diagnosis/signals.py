"""A campaign's logs as one table of rows, and what the sensors' own errors, once assumed, make of
it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pneugantry.diagnosis.converter import converter_step
from pneugantry.diagnosis.tachometer import lag_of, undone
from pyfmi_runner.campaign import Campaign, LogSetup
from pyfmi_runner.log import PERIOD, SIGMA
from pyfmi_runner.smoothing import smooth_axis

__all__ = [
    "LAGGING",
    "SENSOR_NEUTRAL",
    "Signals",
    "Table",
    "acceleration",
    "corrected",
    "innovation",
    "sensed_forces",
    "table_of",
]

Array = NDArray[np.float64]
SENSOR_NEUTRAL = {
    "sensors.bias_f_x": 0.0,
    "sensors.bias_f_z": 0.0,
    "sensors.gain_f_x": 1.0,
    "sensors.gain_f_z": 1.0,
    "sensors.crosstalk_f_x": 0.0,
    "sensors.crosstalk_f_z": 0.0,
    "sensors.gain_f_ax": 1.0,
    "sensors.gain_f_az": 1.0,
    "sensors.tau_v_x": 0.0,
    "sensors.tau_v_z": 0.0,
    "sensors.stages_v_x": 1.0,
    "sensors.stages_v_z": 1.0,
    "sensors.drift_f_x": 0.0,
    "sensors.drift_f_z": 0.0,
    "sensors.curve_f_x": 0.0,
    "sensors.curve_f_z": 0.0,
}
CURVED_AT = 50.0  # N at which a force channel reads by the share `curve` too much


# s of lag from which on a speed is smoothed: no lag at all must look as a lag of some microseconds
# does
LAGGING = 2e-3
DWELL = 5  # samples over which a coarse converter's error stays the same, at least


@dataclass(frozen=True, eq=False)
class Table:
    """All logs one below the other; `spans[i]` are the first row and the row after the last of log
    i.
    """

    names: tuple[str, ...]
    setups: tuple[LogSetup, ...]
    spans: NDArray[np.int64]
    columns: Mapping[str, Array]  # time, u_x, u_z and the eight measured channels
    clamped: Mapping[str, NDArray[np.bool_]]  # by axis
    quanta: Mapping[str, float]  # converter step of each coarse channel
    sigma: Mapping[str, float]  # RMS noise of each channel, that of its converter included

    @property
    def rows(self) -> int:
        return int(self.spans[-1, 1])

    def log_of(self) -> NDArray[np.int64]:
        """Index of each row's log."""
        index = np.empty(self.rows, dtype=np.int64)
        for i, (first, last) in enumerate(self.spans):
            index[first:last] = i
        return index


@dataclass(frozen=True, eq=False)
class Signals:
    """True signals as far as they can be known from the measured ones under assumed sensor errors;
    shape (rows,) each.
    """

    position: Mapping[str, Array]  # m, by axis, smoothed with the speed
    speed: Mapping[str, Array]  # m/s, by axis; as measured, but with a tachometer's lag undone
    force: Mapping[str, Array]  # N, contact force by axis
    actuator: Mapping[str, Array]  # N, actuator force by axis


def table_of(campaign: Campaign) -> Table:
    """The rows of all logs of a campaign."""
    spans, start = [], 0
    for run in campaign:
        spans.append((start, start + len(run.log)))
        start += len(run.log)
    names = ("time", "u_x", "u_z", *SIGMA)
    columns = {name: np.concatenate([run.log[name] for run in campaign]) for name in names}
    clamped = {
        axis: np.concatenate([run.setup.clamp_signal(axis, run.log.time) for run in campaign])
        for axis in "xz"
    }
    steps = {name: converter_step(columns[name], SIGMA[name]) for name in SIGMA}
    quanta = {name: step for name, step in steps.items() if step > 0}
    if _cuts(columns, clamped, quanta):
        columns |= {name: columns[name] + 0.5 * step for name, step in quanta.items()}
    sigma = {
        name: float(np.hypot(SIGMA[name], steps[name] * np.sqrt(DWELL / 12))) for name in SIGMA
    }
    return Table(
        tuple(campaign.logs),
        tuple(run.setup for run in campaign),
        np.array(spans, dtype=np.int64),
        columns,
        clamped,
        quanta,
        sigma,
    )


def _cuts(
    columns: Mapping[str, Array],
    clamped: Mapping[str, NDArray[np.bool_]],
    quanta: Mapping[str, float],
) -> bool:
    """Whether a coarse converter cuts off instead of rounding: a clamped carriage's speed then
    reads half a step too low on average.
    """
    known = [
        (f"v_{axis}", clamped[axis])
        for axis in "xz"
        if f"v_{axis}" in quanta and clamped[axis].any()
    ]
    return any(float(np.mean(columns[name][rows])) < -0.25 * quanta[name] for name, rows in known)


def corrected(table: Table, sensors: Mapping[str, float]) -> Signals:
    """Undoes scale, offset and crosstalk of the force channels, and a tachometer's lag.

    `sensors`: values that differ from SENSOR_NEUTRAL, by name.
    """
    value = {**SENSOR_NEUTRAL, **sensors}
    c = table.columns
    f_x, f_z = (
        _straightened(c[f"f_{a}"], value[f"sensors.curve_f_{a}"])
        - value[f"sensors.bias_f_{a}"]
        - value[f"sensors.drift_f_{a}"] * c["time"]
        for a in "xz"
    )
    g_x, g_z = value["sensors.gain_f_x"], value["sensors.gain_f_z"]
    k_x, k_z = value["sensors.crosstalk_f_x"], value["sensors.crosstalk_f_z"]
    determinant = g_x * g_z - k_x * k_z
    force = {"x": (g_z * f_x - k_x * f_z) / determinant, "z": (g_x * f_z - k_z * f_x) / determinant}
    position, speed = {}, {}
    for axis in "xz":
        position[axis], speed[axis] = _motion(table, axis, *lag_of(axis, value))
    return Signals(
        position,
        speed,
        force,
        {axis: c[f"f_a{axis}"] / value[f"sensors.gain_f_a{axis}"] for axis in "xz"},
    )


def sensed_forces(true: Array, time: Array, sensors: Mapping[str, float]) -> Array:
    """What the force channels, with their assumed errors, say of true f_x, f_z (n, 2)."""
    value = {**SENSOR_NEUTRAL, **sensors}
    result = np.empty_like(true)
    for own, axis in enumerate("xz"):
        reading = (
            value[f"sensors.gain_f_{axis}"] * true[:, own]
            + value[f"sensors.crosstalk_f_{axis}"] * true[:, 1 - own]
        )
        reading = (
            reading + value[f"sensors.bias_f_{axis}"] + value[f"sensors.drift_f_{axis}"] * time
        )
        result[:, own] = reading * (
            1.0 + value[f"sensors.curve_f_{axis}"] * (reading / CURVED_AT) ** 2
        )
    return result


def _straightened(reading: Array, curve: float) -> Array:
    """A reading without its channel's curve; the inverse by iteration, which a few rounds make
    exact enough.
    """
    straight = reading
    for _ in range(6 if curve else 0):
        straight = reading / np.maximum(1.0 + curve * (straight / CURVED_AT) ** 2, 0.2)
    return straight


def acceleration(speed: Array, table: Table) -> Array:
    """Measured acceleration [m/s2], the slope over 10 ms either side, log by log."""
    result = np.zeros(table.rows)
    half = 10
    for first, last in table.spans:
        v = speed[first:last]
        kernel = (
            np.arange(half, -half - 1, -1) / (2 * sum(i * i for i in range(1, half + 1))) / PERIOD
        )
        result[first:last] = np.convolve(np.pad(v, half, mode="edge"), kernel, mode="valid")
    return result


def innovation(table: Table, axis: str, sensors: Mapping[str, float]) -> Array:
    """Position against the integral of the speed (rows,), log by log; 1 RMS where they agree. With
    v = v_m + tau dv_m/dt + second d2v_m/dt2 a tachometer's lag adds tau v_m + second dv_m/dt to the
    integral of v_m; three stages and a running mean have second = tau^2 / 3.
    """
    tau, stages = lag_of(axis, sensors)
    second = 0.0 if stages == 1 else tau**2 / 3
    rate = acceleration(table.columns[f"v_{axis}"], table) if second > 0 else np.zeros(table.rows)
    result = np.empty(table.rows)
    for first, last in table.spans:
        rows = slice(first, last)
        s, v = table.columns[axis][rows], table.columns[f"v_{axis}"][rows]
        lead = tau * v + second * rate[rows]
        result[rows] = smooth_axis(
            s - lead, v, table.sigma[axis], table.sigma[f"v_{axis}"], PERIOD
        ).innovation
    return result


def _motion(table: Table, axis: str, tau: float, stages: int) -> tuple[Array, Array]:
    """Smoothed position, and speed, log by log; well behind a lagging tachometer both smoothed."""
    position, speed = np.empty(table.rows), table.columns[f"v_{axis}"].copy()
    sigma, sigma_v = table.sigma[axis], table.sigma[f"v_{axis}"]
    for first, last in table.spans:
        rows = slice(first, last)
        s, v = table.columns[axis][rows], table.columns[f"v_{axis}"][rows]
        if tau > LAGGING:
            position[rows], speed[rows] = undone(s, v, sigma, sigma_v, tau, stages)
        else:
            position[rows] = smooth_axis(s - tau * v, v, sigma, sigma_v, PERIOD).position + tau * v
    return position, speed
