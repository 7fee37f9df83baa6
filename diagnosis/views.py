"""Views: one block of the plant fed with measured signals, and what is left between its output and the measured one.

A view's residual is in units of the sensors' noise. Each view knows the tolerance parameters of its block and which parameters (of the
FMU, `sensors.*`, `timing.*`) it depends on, so that a hypothesis is judged on the views that it touches.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from diagnosis.signals import Signals, Table, corrected
from pyfmi_runner.block_fmu import BlockFmu
from pyfmi_runner.blocks import COMMAND_QUANTUM, recomputed_commands
from pyfmi_runner.campaign import Campaign
from pyfmi_runner.log import PERIOD
from pyfmi_runner.plant import PROFILE, own_profile, plant_parameters

__all__ = ["ContactView", "FrictionView", "SensorView", "SignalStore", "TimingView", "ValveView", "View"]

Array = NDArray[np.float64]
Values = Mapping[str, float]
WINDOW = 120  # samples after which the friction block is started again
PRESLIDING_ERROR = 0.25  # N, standard deviation of a window's starting displacement-dependent force
TOUCHING = 0.5  # N, measured contact force that tells contact from none
LEAD = 8  # samples either side of a window's start over which its speed and acceleration are fitted


class View(Protocol):
    """One block against its measured output."""

    name: str  # the block
    tolerance: tuple[str, ...]  # parameters that every rig has a few percent off

    def depends_on(self, parameter: str) -> bool: ...

    def residual(self, values: Values) -> Array:
        """(rows, channels) in units of the noise, NaN where nothing is judged; `values`: what differs from the nominal model."""
        ...


class SignalStore:
    """Corrected signals by the sensor errors assumed; the last few are kept."""

    def __init__(self, table: Table) -> None:
        self.table = table
        self._kept: dict[tuple[tuple[str, float], ...], Signals] = {}

    def signals(self, values: Values) -> Signals:
        key = tuple(sorted((name, value) for name, value in values.items() if name.startswith("sensors.") and name != "sensors.quantum"))
        if key not in self._kept:
            if len(self._kept) > 24:
                self._kept.clear()
            self._kept[key] = corrected(self.table, dict(key))
        return self._kept[key]


def _own(prefix: str, nominal: Values, values: Values, known: Mapping[str, object]) -> dict[str, float]:
    """Parameters of a block out of those of the gantry, with the prefix taken off."""
    merged = {**nominal, **values}
    own = {name.removeprefix(prefix): value for name, value in merged.items() if name.startswith(prefix)}
    return {name: value for name, value in own.items() if name in known}


def midway(values: Array, spans: NDArray[np.int64]) -> Array:
    """A continuous signal's mean over the millisecond behind each sample, log by log."""
    result = values.copy()
    result[:-1] = 0.5 * (values[:-1] + values[1:])
    result[spans[:, 1] - 1] = values[spans[:, 1] - 1]
    return result


class ValveView:
    """(u, s) → f_a. Both inputs are good as exact, so its residual is the force sensor's white noise where the valve is right."""

    def __init__(self, axis: str, block: BlockFmu, nominal: Values, store: SignalStore) -> None:
        self.axis, self.name, self._block, self._nominal, self._store = axis, f"valve_{axis}", block, nominal, store
        self.prefix = f"valve_{axis}."
        self.tolerance = tuple(self.prefix + p for p in ("K", "u_0", "tau"))
        self._known = {n: v for n, v in block.file.variables.items() if v.causality == "parameter"}

    def depends_on(self, parameter: str) -> bool:
        return parameter.startswith(self.prefix) or parameter == f"sensors.gain_f_a{self.axis}"

    def residual(self, values: Values) -> Array:
        table, signals = self._store.table, self._store.signals({})
        parameters = _own(self.prefix, self._nominal, values, self._known)
        for end in ("s_low", "s_high"):
            parameters[end] = self._nominal[f"axis_{self.axis}.{end}"]
        inputs = np.column_stack([table.columns[f"u_{self.axis}"], signals.position[self.axis]])
        simulated = self._block.run(parameters, ("u", "s"), inputs, ("f_a",), table.spans)[:, 0]
        gain = values.get(f"sensors.gain_f_a{self.axis}", 1.0)
        return ((table.columns[f"f_a{self.axis}"] - gain * simulated) / table.sigma[f"f_a{self.axis}"])[:, None]


class FrictionView:
    """(f_a, f_c) → v in short windows, each started from measured position and speed."""

    def __init__(self, axis: str, block: BlockFmu, nominal: Values, store: SignalStore) -> None:
        self.axis, self.name, self._block, self._nominal, self._store = axis, f"friction_{axis}", block, nominal, store
        self.prefix = f"axis_{axis}."
        self.tolerance = tuple(self.prefix + p for p in ("m", "C", "F_w", "friction.F_s", "friction.F_d", "friction.v_th"))
        self._known = {n: v for n, v in block.file.variables.items() if v.causality == "parameter"}
        self._sigma = store.table.sigma[f"v_{axis}"]
        self.windows = self._place_windows()

    def _place_windows(self) -> NDArray[np.int64]:
        clamped = self._store.table.clamped[self.axis]
        found: list[tuple[int, int]] = []
        for first, last in self._store.table.spans:
            for start in range(int(first) + LEAD, int(last) - WINDOW - LEAD, WINDOW):
                if clamped[start - LEAD : start + WINDOW].any():
                    continue
                found.append((start, start + WINDOW))
        return np.array(found, dtype=np.int64).reshape(-1, 2)

    def depends_on(self, parameter: str) -> bool:
        a = self.axis
        mine = {
            "sensors.bias_f_x",
            "sensors.bias_f_z",
            "sensors.gain_f_x",
            "sensors.gain_f_z",
            "sensors.crosstalk_f_x",
            "sensors.crosstalk_f_z",
        }
        mine |= {f"sensors.gain_f_a{a}", f"sensors.tau_v_{a}"} | ({"coupling"} if a == "z" else set())
        return parameter.startswith(self.prefix) or parameter in mine

    def residual(self, values: Values) -> Array:
        table, signals = self._store.table, self._store.signals(values)
        result = np.full((table.rows, 1), np.nan)
        if len(self.windows) == 0:
            return result
        parameters = _own(self.prefix, self._nominal, values, self._known)
        parameters.pop("s_start", None)
        tau = values.get(f"sensors.tau_v_{self.axis}", 0.0)
        speed, rate = self._starts(signals, tau)
        names, columns = (
            ["f_a", "f_c", "f_load"],
            [signals.actuator[self.axis], signals.force[self.axis], np.hypot(signals.force["x"], signals.force["z"])],
        )
        if values.get("coupling", 0.0) != 0.0:
            names.append("f_couple")
            columns.append(values["coupling"] * _acceleration(signals.speed["x"], table))
        inputs = midway(np.column_stack(columns), table.spans)
        at = self.windows[:, 0]
        starts = {"s_start": np.clip(signals.position[self.axis][at], parameters["s_low"], parameters["s_high"]), "v": speed}
        if parameters["friction.law"] in (3.0, 4.0):
            net = np.column_stack(columns)[at] @ np.array([1.0, -1.0, 0.0, 1.0][: len(columns)])
            starts["friction.F_pre"] = self._presliding(parameters, net, speed, rate)
        simulated = self._block.run(parameters, names, inputs, ("v",), self.windows, starts)
        moved = None
        if "friction.F_pre" in starts:
            starts["friction.F_pre"] = starts["friction.F_pre"] - PRESLIDING_ERROR * np.sign(starts["friction.F_pre"])
            moved = self._block.run(parameters, names, inputs, ("v",), self.windows, starts) - simulated
        if tau > 0:
            simulated = self._tachometer(simulated, tau, table.columns[f"v_{self.axis}"])
        result[:] = (signals.speed[self.axis][:, None] - simulated) / self._sigma
        result = self._without_start_error(result, parameters)
        if moved is not None:
            rows = self.windows[:, 0][:, None] + np.arange(WINDOW)
            result[rows, 0] = without_direction(result[rows, 0], moved[rows, 0] / self._sigma)
        return result

    def _starts(self, signals: Signals, tau: float) -> tuple[Array, Array]:
        """Speed and acceleration at each window's start, from a line through the measured speed around it."""
        lags = np.arange(-LEAD, LEAD + 1)
        around = signals.speed[self.axis][self.windows[:, 0][:, None] + lags]
        rate = around @ lags / (lags @ lags) / PERIOD
        return around.mean(axis=1) + tau * rate, rate

    @staticmethod
    def _presliding(parameters: Values, net: Array, speed: Array, rate: Array) -> Array:
        """Displacement-dependent force that balances the others at the start."""
        force = net - parameters["F_w"] - parameters["m"] * rate - parameters["C"] * speed
        limit = parameters["friction.beta"] if parameters["friction.law"] == 3.0 else parameters["friction.F_s"]
        return np.clip(force, -0.999 * limit, 0.999 * limit)

    def _tachometer(self, speed: Array, tau: float, measured: Array) -> Array:
        """What a tachometer of time constant tau says of the simulated speed, starting at what it said."""
        share = 1.0 - np.exp(-PERIOD / tau)
        result = speed.copy()
        for k in range(WINDOW):
            rows = self.windows[:, 0] + k
            before = measured[rows] if k == 0 else result[rows - 1, 0]
            driven = speed[rows, 0] if k == 0 else 0.5 * (speed[rows, 0] + speed[rows - 1, 0])
            result[rows, 0] = before + share * (driven - before) if k else before
        return result

    def _without_start_error(self, residual: Array, parameters: Values) -> Array:
        """Takes out what the starting speed's own error explains: it decays with m/C."""
        decay = np.exp(-parameters["C"] / parameters["m"] * PERIOD * np.arange(WINDOW)) / math.sqrt(2 * LEAD + 1)
        rows = self.windows[:, 0][:, None] + np.arange(WINDOW)
        residual[rows, 0] = without_direction(residual[rows, 0], np.broadcast_to(decay, rows.shape))
        return residual


def without_direction(residual: Array, direction: Array) -> Array:
    """Whitens rows (W, n) of noise 1 plus one unknown amount, N(0, 1), of a direction (W, n): a generalised least squares."""
    norm = np.maximum(np.sum(direction**2, axis=1), 1e-300)
    share = (1.0 - 1.0 / np.sqrt(1.0 + norm)) / norm
    return np.asarray(residual - (share * np.sum(residual * direction, axis=1))[:, None] * direction)


def _acceleration(speed: Array, table: Table) -> Array:
    """Measured acceleration [m/s2], the slope over 10 ms either side, log by log."""
    result = np.zeros(table.rows)
    half = 10
    for first, last in table.spans:
        v = speed[first:last]
        kernel = np.arange(half, -half - 1, -1) / (2 * sum(i * i for i in range(1, half + 1))) / PERIOD
        result[first:last] = np.convolve(np.pad(v, half, mode="edge"), kernel, mode="valid")
    return result


def _onsets(table: Table, around: int = 20) -> NDArray[np.bool_]:
    """Rows within 20 ms of contact's onset or loss, where the speed jumps faster than its mean can follow."""
    touching = np.hypot(table.columns["f_x"], table.columns["f_z"]) > TOUCHING
    changes = np.flatnonzero(np.diff(touching.astype(np.int8)) != 0)
    near = np.zeros(table.rows, dtype=bool)
    for change in changes:
        near[max(0, change - around) : change + around + 1] = True
    return near


def _mean(values: Array, half: int = 4) -> Array:
    """Mean over `half` samples either side: a speed's noise would bias the damping that multiplies it."""
    width = 2 * half + 1
    return np.convolve(np.pad(values, half, mode="edge"), np.full(width, 1.0 / width), mode="valid")


class ContactView:
    """(s, v) → contact force, on the logs that have a workpiece."""

    name = "contact"
    tolerance: tuple[str, ...] = ("contact.K_c", "contact.C_c")

    def __init__(self, block: BlockFmu, nominal: Values, store: SignalStore) -> None:
        self._block, self._nominal, self._store = block, nominal, store
        self._known = {n: v for n, v in block.file.variables.items() if v.causality == "parameter"}
        self.logs = [i for i, setup in enumerate(store.table.setups) if setup.workpiece != "none"]
        self._onsets = _onsets(store.table)

    def depends_on(self, parameter: str) -> bool:
        sensed = parameter.startswith("sensors.") and not parameter.startswith(("sensors.gain_f_a", "sensors.quantum"))
        return sensed or parameter.startswith(("contact.", "workpiece.")) or parameter == "waviness"

    def residual(self, values: Values) -> Array:
        table, signals = self._store.table, self._store.signals(values)
        result = np.full((table.rows, 2), np.nan)
        for i in self.logs:
            rows = slice(*table.spans[i])
            simulated = self.simulate(i, signals, values)
            for column, axis in enumerate("xz"):
                result[rows, column] = (signals.force[axis][rows] - simulated[:, column]) / table.sigma[f"f_{axis}"]
        result[self._onsets] = 0.0
        return result

    def simulate(self, i: int, signals: Signals, values: Values) -> Array:
        """Contact force (n, 2) of log i for its corrected signals."""
        table, setup = self._store.table, self._store.table.setups[i]
        rows = slice(*table.spans[i])
        given = {k: v for k, v in plant_parameters(setup).items() if k.startswith(("workpiece.", "contact."))}
        shift = values.get("contact.z_0_shift", 0.0)
        parameters = _own("", {**self._nominal, **given}, values, self._known)
        parameters["contact.z_0"] = given["contact.z_0"] + shift
        x, z = signals.position["x"][rows], signals.position["z"][rows]
        names, columns = ["x", "z", "v_x", "v_z"], [x, z, _mean(signals.speed["x"][rows]), _mean(signals.speed["z"][rows])]
        profile = own_profile(setup)
        if profile is not None:
            names += list(PROFILE)
            columns += [x, profile.height(x), profile.slope(x), profile.curvature(x)]
        return self._block.run(parameters, names, np.column_stack(columns), ("f_x", "f_z"))


class SensorView:
    """Position against the integral of the speed, and the force channels where nothing is touched."""

    name = "sensors"
    tolerance: tuple[str, ...] = ()

    def __init__(self, store: SignalStore) -> None:
        self._store = store
        self.untouched = self._untouched()

    def _untouched(self) -> NDArray[np.bool_]:
        """Rows of logs without a workpiece."""
        free = np.zeros(self._store.table.rows, dtype=bool)
        for setup, (first, last) in zip(self._store.table.setups, self._store.table.spans, strict=True):
            free[first:last] = setup.workpiece == "none"
        return free

    def depends_on(self, parameter: str) -> bool:
        return parameter.startswith(("sensors.tau_v", "sensors.bias"))

    def residual(self, values: Values) -> Array:
        table, signals = self._store.table, self._store.signals({k: v for k, v in values.items() if self.depends_on(k)})
        result = np.full((table.rows, 4), np.nan)
        for column, axis in enumerate("xz"):
            moving = ~table.clamped[axis]
            result[moving, column] = signals.innovation[axis][moving]
            bias = values.get(f"sensors.bias_f_{axis}", 0.0)
            result[self.untouched, 2 + column] = (table.columns[f"f_{axis}"][self.untouched] - bias) / table.sigma[f"f_{axis}"]
        return result


class TimingView:
    """Measured signals → command: what the log's own controller makes of them, delayed by `timing.delay`."""

    name = "timing"
    tolerance: tuple[str, ...] = ()

    def __init__(self, campaign: Campaign, store: SignalStore) -> None:
        self._store = store
        self._computed = np.full((store.table.rows, 2), np.nan)
        for run, (first, last) in zip(campaign, store.table.spans, strict=True):
            commands = recomputed_commands(run, run.log.measured())
            if commands is not None:
                self._computed[first:last] = commands
        self.quantum = COMMAND_QUANTUM
        self.judged = np.isfinite(self._computed)  # whatever the delay: a residual vector must keep its length

    def depends_on(self, parameter: str) -> bool:
        return parameter == "timing.delay"

    def residual(self, values: Values) -> Array:
        table = self._store.table
        recorded = np.column_stack([table.columns["u_x"], table.columns["u_z"]])
        samples = values.get("timing.delay", 0.0) / PERIOD
        result = np.full_like(recorded, np.nan)
        for first, last in table.spans:
            rows = np.arange(last - first)
            whole, share = int(np.floor(samples)), samples - np.floor(samples)
            for column in range(2):
                computed = self._computed[first:last, column]
                late = (1 - share) * computed[np.clip(rows - whole, 0, None)] + share * computed[np.clip(rows - whole - 1, 0, None)]
                result[first:last, column] = (recorded[first:last, column] - late) / self.quantum
        return result
