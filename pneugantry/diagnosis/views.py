"""Views: one block of the plant fed with measured signals, and what is left between its output and
the measured one.

A view's residual is in units of the sensors' noise. Each view knows the tolerance parameters of its
block and which parameters (of the FMU, `sensors.*`, `timing.*`) it depends on, so that a hypothesis
is judged on the views that it touches.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from pneugantry.diagnosis.signals import (
    LAGGING,
    Signals,
    Table,
    acceleration,
    corrected,
    innovation,
    sensed_forces,
)
from pneugantry.diagnosis.tachometer import lag_of, sensed_speed
from pyfmi_runner.block_fmu import BlockFmu, Guide
from pyfmi_runner.blocks import COMMAND_QUANTUM, recomputed_commands
from pyfmi_runner.campaign import Campaign
from pyfmi_runner.log import PERIOD
from pyfmi_runner.plant import PROFILE, own_profile, plant_parameters

__all__ = [
    "ContactView",
    "FrictionView",
    "SensorView",
    "SignalStore",
    "TimingView",
    "ValveView",
    "View",
]

Array = NDArray[np.float64]
Values = Mapping[str, float]
Key = TypeVar("Key", bound=Hashable)
Made = TypeVar("Made")
# time in which a simulated carriage is led back to the measured one, as a share of its own time
# constant m/C
GUIDED = 0.35
SOLVER = {
    "solver.tolerance": 0.1
}  # a millisecond a step but for stiff friction: exact to 0.01 of the noise
TOUCHING = 0.5  # N, measured contact force that tells contact from none
CLEAR = 5e-3  # m from the workpiece at the start from which on a log begins out of contact
TURN = 2e-3  # m/s of deflection within which a loss turns its sign
AT_REST = 50  # samples for which it then stays so


class View(Protocol):
    """One block against its measured output."""

    name: str  # the block
    tolerance: tuple[str, ...]  # parameters that every rig has a few percent off

    def depends_on(self, parameter: str) -> bool: ...

    def residual(self, values: Values) -> Array:
        """(rows, channels) in units of the noise, NaN where nothing is judged; `values`: what
        differs from the nominal model.
        """
        ...


class SignalStore:
    """Corrected signals by the sensor errors assumed; the last few are kept."""

    def __init__(self, table: Table) -> None:
        self.table = table
        self._kept: dict[tuple[tuple[str, float], ...], Signals] = {}
        self._innovations: dict[tuple[str, float, int], Array] = {}

    def signals(self, values: Values) -> Signals:
        key = tuple(
            sorted(
                (name, value)
                for name, value in values.items()
                if name.startswith("sensors.") and name != "sensors.quantum"
            )
        )
        return _kept(self._kept, key, lambda: corrected(self.table, dict(key)))

    def innovation(self, axis: str, values: Values) -> Array:
        """Position against the integral of the speed."""
        key = (axis, *lag_of(axis, values))
        return _kept(self._innovations, key, lambda: innovation(self.table, axis, values))


def _kept(kept: dict[Key, Made], key: Key, make: Callable[[], Made]) -> Made:
    """What was made for a key; the last few are kept."""
    if key not in kept:
        if len(kept) > 24:
            kept.clear()
        kept[key] = make()
    return kept[key]


def _own(
    prefix: str, nominal: Values, values: Values, known: Mapping[str, object]
) -> dict[str, float]:
    """Parameters of a block out of those of the gantry, with the prefix taken off."""
    merged = {**nominal, **values}
    own = {
        name.removeprefix(prefix): value
        for name, value in merged.items()
        if name.startswith(prefix)
    }
    return {name: value for name, value in own.items() if name in known}


def midway(values: Array, spans: NDArray[np.int64]) -> Array:
    """A continuous signal's mean over the millisecond behind each sample, log by log."""
    result = values.copy()
    result[:-1] = 0.5 * (values[:-1] + values[1:])
    result[spans[:, 1] - 1] = values[spans[:, 1] - 1]
    return result


class ValveView:
    """(u, s) → f_a. Both inputs are good as exact, so its residual is the force sensor's white
    noise where the valve is right.
    """

    def __init__(self, axis: str, block: BlockFmu, nominal: Values, store: SignalStore) -> None:
        self.axis, self.name, self._block, self._nominal, self._store = (
            axis,
            f"valve_{axis}",
            block,
            nominal,
            store,
        )
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
        return (
            (table.columns[f"f_a{self.axis}"] - gain * simulated) / table.sigma[f"f_a{self.axis}"]
        )[:, None]


class FrictionView:
    """(f_a, f_c) → v over whole logs, the simulated carriage gently led to the measured one.

    Driven by the actuator force and the measured contact force, and led back to where it was
    measured, in contact with the spring of the edge besides: a break-away that the model misses
    costs what it is worth and no more, so the misfit is smooth in the parameters where a free run
    of the plant is not.
    """

    def __init__(self, axis: str, block: BlockFmu, nominal: Values, store: SignalStore) -> None:
        self.axis, self.name, self._block, self._nominal, self._store = (
            axis,
            f"friction_{axis}",
            block,
            nominal,
            store,
        )
        self.prefix = f"axis_{axis}."
        self.guided = GUIDED * nominal[self.prefix + "m"] / nominal[self.prefix + "C"]  # s
        self.tolerance = tuple(
            self.prefix + p
            for p in ("m", "C", "F_w", "friction.F_s", "friction.F_d", "friction.v_th")
        )
        self._known = {n: v for n, v in block.file.variables.items() if v.causality == "parameter"}
        table = store.table
        self.logs = [
            i
            for i, (first, last) in enumerate(table.spans)
            if not table.clamped[axis][first:last].all()
        ]
        self.actuator = table.columns[f"f_a{axis}"]
        self.moving = np.zeros(table.rows, dtype=bool)
        for i in self.logs:
            self.moving[slice(*table.spans[i])] = ~table.clamped[axis][slice(*table.spans[i])]
        self._spring = np.where(
            _touching(table) & (axis == "z"), nominal["contact.K_c"], 0.0
        )  # z alone faces the edge
        self._blind = _onsets(table) | _impacts(
            table, axis, nominal[self.prefix + "s_low"], nominal[self.prefix + "s_high"]
        )

    def depends_on(self, parameter: str) -> bool:
        a = self.axis
        mine = {
            f"sensors.{what}_f_{b}"
            for what in ("bias", "gain", "crosstalk", "drift", "curve")
            for b in "xz"
        }
        mine |= {f"sensors.gain_f_a{a}", f"sensors.tau_v_{a}", f"sensors.stages_v_{a}"} | (
            {"coupling", "coupling_limit"} if a == "z" else set()
        )
        return parameter.startswith(self.prefix) or parameter in mine

    def residual(self, values: Values) -> Array:
        table, signals = (
            self._store.table,
            self._store.signals({k: v for k, v in values.items() if self.depends_on(k)}),
        )
        result = np.full((table.rows, 1), np.nan)
        parameters = {**SOLVER, **_own(self.prefix, self._nominal, values, self._known)}
        sigma = table.sigma[f"v_{self.axis}"]
        names = ["f_a", "f_c", "f_load"]
        actuator = self.actuator / values.get(f"sensors.gain_f_a{self.axis}", 1.0)
        columns = [
            actuator,
            signals.force[self.axis],
            np.hypot(signals.force["x"], signals.force["z"]),
        ]
        if values.get("coupling", 0.0) != 0.0:
            names.append("f_couple")
            couple, limit = (
                values["coupling"] * self._acceleration,
                values.get("coupling_limit", 0.0),
            )
            columns.append(limit * np.tanh(couple / limit) if limit > 0 else couple)
        inputs = midway(np.column_stack(columns), table.spans)
        mass = self._nominal[self.prefix + "m"]
        for i in self.logs:
            rows, setup = slice(*table.spans[i]), table.setups[i]
            guide = Guide(
                signals.position[self.axis][rows][:, None],
                signals.speed[self.axis][rows][:, None],
                (mass / (4 * self.guided**2) + self._spring[rows])[:, None],
                [mass / self.guided],
            )
            parameters["s_start"] = {"x": setup.start_x, "z": setup.start_z}[self.axis]
            clamped = table.clamped[self.axis][rows][:, None].astype(np.float64)
            true = self._block.run_guided(
                parameters, names, inputs[rows], ("clamp",), clamped, ("s", "v"), guide
            )[:, 1]
            result[rows, 0] = (
                table.columns[f"v_{self.axis}"][rows] - sensed_speed(true, self.axis, values)
            ) / sigma
        result[self._blind] = 0.0
        result[~self.moving] = np.nan
        return result

    @cached_property
    def _acceleration(self) -> Array:
        return acceleration(self._store.table.columns["v_x"], self._store.table)


def _impacts(
    table: Table, axis: str, low: float, high: float, near: float = 2e-3, around: int = 25
) -> NDArray[np.bool_]:
    """Rows about a carriage's arrival at an end stop: its speed falls at once, at an instant known
    to a few milliseconds only.
    """
    s, v = table.columns[axis], table.columns[f"v_{axis}"]
    least = 5 * table.sigma[f"v_{axis}"]
    arriving = ((s > high - near) & (v > least)) | ((s < low + near) & (v < -least))
    return np.convolve(arriving, np.ones(2 * around + 1), mode="same") > 0.5


def _touching(table: Table) -> NDArray[np.bool_]:
    """Rows in contact: the measured force, less what the channels say where nothing is touched, is
    beyond TOUCHING.
    """
    free = np.zeros(table.rows, dtype=bool)
    for setup, (first, last) in zip(table.setups, table.spans, strict=True):
        if setup.workpiece == "none":
            free[first:last] = True
        elif setup.start_z < setup.z_0 - CLEAR:
            free[first : first + AT_REST] = True
    forces = [
        table.columns[f"f_{a}"] - (np.median(table.columns[f"f_{a}"][free]) if free.any() else 0.0)
        for a in "xz"
    ]
    return np.asarray(np.hypot(*forces) > TOUCHING)


def _onsets(table: Table, before: int = 20, after: int = 20) -> NDArray[np.bool_]:
    """Rows about contact's onset or loss: a carriage's speed jumps there faster than its mean can
    follow.
    """
    changes = np.flatnonzero(np.diff(_touching(table).astype(np.int8)) != 0)
    near = np.zeros(table.rows, dtype=bool)
    for change in changes:
        near[max(0, change - before) : change + after + 1] = True
    return near


def _mean(values: Array, half: int = 4) -> Array:
    """Mean over `half` samples either side: a speed's noise would bias the damping that multiplies
    it.
    """
    width = 2 * half + 1
    return np.convolve(np.pad(values, half, mode="edge"), np.full(width, 1.0 / width), mode="valid")


def _at_rest(speed: Array, sigma: float, half: int = 40) -> Array:
    """Smoothed speed, and none where the mean over 81 samples cannot be told from it: a drag turns
    within a few millimetres a second, and the noise of a carriage at rest would make it chatter.
    """
    slow = _mean(speed, half)
    return np.where(np.abs(slow) < 5 * sigma / np.sqrt(2 * half + 1), 0.0, _mean(speed))


def _slow(table: Table, axis: str, speed: Array) -> Array:
    """An axis' speed smoothed, log by log."""
    return np.concatenate(
        [_at_rest(speed[slice(*span)], table.sigma[f"v_{axis}"]) for span in table.spans]
    )


class ContactView:
    """(s, v) → contact force, on the logs that have a workpiece."""

    name = "contact"
    tolerance: tuple[str, ...] = ("contact.K_c", "contact.C_c")

    def __init__(self, block: BlockFmu, nominal: Values, store: SignalStore) -> None:
        self._block, self._nominal, self._store = block, nominal, store
        self._known = {n: v for n, v in block.file.variables.items() if v.causality == "parameter"}
        self.logs = [i for i, setup in enumerate(store.table.setups) if setup.workpiece != "none"]
        self._onsets = _onsets(
            store.table, before=3, after=3
        )  # the instant itself, known to a sample or two

    def depends_on(self, parameter: str) -> bool:
        sensed = parameter.startswith("sensors.") and not parameter.startswith(
            ("sensors.gain_f_a", "sensors.quantum")
        )
        return (
            sensed
            or parameter.startswith(("contact.", "workpiece."))
            or parameter in ("waviness", "loss")
        )

    def residual(self, values: Values) -> Array:
        table, signals = self._store.table, self._store.signals(values)
        result = np.full((table.rows, 2), np.nan)
        for i in self.logs:
            rows = slice(*table.spans[i])
            # as the channels read it: of forces that a channel's gain is taken out of the noise
            # would be another for each gain
            read = sensed_forces(
                self.simulate(i, signals, values), table.columns["time"][rows], values
            )
            for column, axis in enumerate("xz"):
                result[rows, column] = (
                    table.columns[f"f_{axis}"][rows] - read[:, column]
                ) / table.sigma[f"f_{axis}"]
        result[self._onsets] = 0.0
        return result

    def simulate(self, i: int, signals: Signals, values: Values) -> Array:
        """Contact force (n, 2) of log i for its corrected signals."""
        table, setup = self._store.table, self._store.table.setups[i]
        rows = slice(*table.spans[i])
        given = {
            k: v
            for k, v in plant_parameters(setup).items()
            if k.startswith(("workpiece.", "contact."))
        }
        shift = values.get("contact.z_0_shift", 0.0)
        parameters = _own("", {**self._nominal, **given}, values, self._known)
        parameters["contact.z_0"] = given["contact.z_0"] + shift
        x, z = signals.position["x"][rows], signals.position["z"][rows]
        speeds = [
            np.where(table.clamped[a][rows], 0.0, self._slow_speed(a, signals, values)[rows])
            for a in "xz"
        ]
        names, columns = ["x", "z", "v_x", "v_z"], [x, z, *speeds]
        profile = own_profile(setup)
        if profile is not None:
            names += list(PROFILE)
            columns += [x, profile.height(x), profile.slope(x), profile.curvature(x)]
        force = self._block.run(parameters, names, np.column_stack(columns), ("f_x", "f_z"))
        return (
            force * self._given_back(force, values)[:, None]
            if values.get("loss", 0.0) != 0.0
            else force
        )

    def _given_back(self, force: Array, values: Values) -> Array:
        """Share of the force (n, 2) that is left by a loss at every turn of the deflection: more on
        the way in, less on the way out.
        """
        rate = (
            np.gradient(_mean(np.hypot(force[:, 0], force[:, 1])), PERIOD)
            / self._nominal["contact.K_c"]
        )
        return np.asarray(1.0 + values["loss"] * rate / np.hypot(rate, TURN))

    def _slow_speed(self, axis: str, signals: Signals, values: Values) -> Array:
        """Smoothed true speed."""
        if lag_of(axis, values)[0] <= LAGGING:  # the speed as measured
            return self._smooth[axis]
        return _slow(self._store.table, axis, signals.speed[axis])

    @cached_property
    def _smooth(self) -> dict[str, Array]:
        table = self._store.table
        return {axis: _slow(table, axis, table.columns[f"v_{axis}"]) for axis in "xz"}


class SensorView:
    """Position against the integral of the speed, and the force channels where nothing
    is touched.
    """

    name = "sensors"
    tolerance: tuple[str, ...] = ()

    def __init__(self, store: SignalStore) -> None:
        self._store = store
        self.untouched = self._untouched()

    def _untouched(self) -> NDArray[np.bool_]:
        """Rows of logs without a workpiece."""
        free = np.zeros(self._store.table.rows, dtype=bool)
        for setup, (first, last) in zip(
            self._store.table.setups, self._store.table.spans, strict=True
        ):
            free[first:last] = setup.workpiece == "none"
        return free

    def depends_on(self, parameter: str) -> bool:
        return parameter.startswith(
            ("sensors.tau_v", "sensors.stages_v", "sensors.bias", "sensors.drift")
        )

    def residual(self, values: Values) -> Array:
        table = self._store.table
        result = np.full((table.rows, 4), np.nan)
        for column, axis in enumerate("xz"):
            moving = ~table.clamped[axis]
            result[moving, column] = self._store.innovation(axis, values)[moving]
            bias = (
                values.get(f"sensors.bias_f_{axis}", 0.0)
                + values.get(f"sensors.drift_f_{axis}", 0.0) * table.columns["time"]
            )
            result[self.untouched, 2 + column] = (table.columns[f"f_{axis}"] - bias)[
                self.untouched
            ] / table.sigma[f"f_{axis}"]
        return result


class TimingView:
    """Measured signals → command: what the log's own controller makes of them, delayed by
    `timing.delay`.
    """

    name = "timing"
    tolerance: tuple[str, ...] = ()

    def __init__(self, campaign: Campaign, store: SignalStore) -> None:
        self._store, self._campaign = store, campaign
        self._computed: dict[int, Array] = {}
        self.quantum = COMMAND_QUANTUM
        self.judged = np.isfinite(
            self.commands(0)
        )  # whatever the delay: a residual vector must keep its length

    def commands(self, late: int) -> Array:
        """(rows, 2) what the logs' controllers make of the signals of `late` samples before; NaN
        where no controller runs.
        """
        if late not in self._computed:
            result = np.full((self._store.table.rows, 2), np.nan)
            for run, (first, last) in zip(self._campaign, self._store.table.spans, strict=True):
                measured = run.log.measured()
                commands = recomputed_commands(
                    run, measured[np.clip(np.arange(len(measured)) - late, 0, None)]
                )
                if commands is not None:
                    result[first:last] = commands
            self._computed[late] = result
        return self._computed[late]

    def shifted(self, late: float, sensed_late: int) -> Array:
        """(rows, 2) commands that act `late` samples after they were made of signals `sensed_late`
        samples old.
        """
        computed = self.commands(sensed_late)
        whole, share = int(np.floor(late)), late - np.floor(late)
        result = np.empty_like(computed)
        for first, last in self._store.table.spans:
            rows, own = np.arange(last - first), computed[first:last]
            result[first:last] = own[np.clip(rows - whole, 0, None)]
            if share > 0:
                result[first:last] += share * (
                    own[np.clip(rows - whole - 1, 0, None)] - result[first:last]
                )
        return result

    def depends_on(self, parameter: str) -> bool:
        return parameter in ("timing.delay", "timing.sense_delay")

    def residual(self, values: Values) -> Array:
        table = self._store.table
        recorded = np.column_stack([table.columns["u_x"], table.columns["u_z"]])
        sensed_late = round(values.get("timing.sense_delay", 0.0) / PERIOD)
        return np.asarray(
            (recorded - self.shifted(values.get("timing.delay", 0.0) / PERIOD, sensed_late))
            / self.quantum
        )
