"""Block replay (teacher forcing): each block of the plant as an FMU of its own, fed with measured
signals.

A block that is right reproduces its own output to the sensors' noise, whatever the other blocks do.
Measured inputs are noisy, so a block's floor is not 1: it is found by the same replay of the
nominal plant's own log with the sensors' noise added.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from controllers.interface import Reference, Sense
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import LoggedRun
from pyfmi_runner.compiled_loop import FMI_WARNING, native_values
from pyfmi_runner.controller_file import controller_of, is_known_controller
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.log import MEASURED, PERIOD, SIGMA, Log
from pyfmi_runner.machine_code import kept
from pyfmi_runner.native import call_step
from pyfmi_runner.plant import PROFILE, own_profile, plant_parameters
from pyfmi_runner.sensors import noise_rows
from pyfmi_runner.smoothing import smooth_axis

__all__ = ["BLOCKS", "BlockReplayer", "noisy_copy"]

Array = NDArray[np.float64]
BLOCKS = ("valve_x", "valve_z", "friction_x", "friction_z", "contact", "sensors", "timing")
WINDOW = (
    100  # samples after which the friction block is started again from measured position and speed
)
LEAD = 5  # samples either side over which its starting speed is averaged
COMMAND_QUANTUM = 1e-4  # V, rounding of the recorded commands: the unit of the timing block
CLASSES = {
    "valve": "PneuGantry.Valve",
    "friction": "PneuGantry.Cylinder",
    "contact": "PneuGantry.Edge",
}


@dataclass(frozen=True, eq=False)
class _Signals:
    """A log's signals, positions smoothed."""

    run: LoggedRun
    x: Array
    z: Array
    innovations: Array  # (N, 2)

    @classmethod
    def of(cls, run: LoggedRun) -> _Signals:
        log = run.log
        x, z = (smooth_axis(log[a], log[f"v_{a}"], SIGMA[a], SIGMA[f"v_{a}"]) for a in "xz")
        return cls(run, x.position, z.position, np.column_stack([x.innovation, z.innovation]))

    def position(self, axis: str) -> Array:
        return self.x if axis == "x" else self.z


class BlockReplayer:
    """Residuals of each block, (measured - simulated)/sigma; used in a `with`."""

    def __init__(self, gantry: FmuFile) -> None:
        self.gantry = gantry
        self._files = {name: FmuFile.read(build_fmu(c).path) for name, c in CLASSES.items()}
        self._stack = ExitStack()
        self._sessions: dict[str, FmuSession] = {}

    def __enter__(self) -> BlockReplayer:
        for name, file in self._files.items():
            self._sessions[name] = self._stack.enter_context(FmuSession(file))
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.close()

    def residuals(self, run: LoggedRun) -> dict[str, Array]:
        """Residuals by block, (rows, channels) with NaN where a block cannot be judged; blocks that
        the log does not show are left out.
        """
        signals = _Signals.of(run)
        found: dict[str, Array | None] = {}
        for axis in "xz":
            found[f"valve_{axis}"] = self._valve(signals, axis)
            found[f"friction_{axis}"] = self._friction(signals, axis)
        found["contact"] = self._contact(signals)
        found["sensors"] = signals.innovations
        found["timing"] = _timing(run)
        return {name: found[name] for name in BLOCKS if found[name] is not None}  # type: ignore[misc]

    def gaps(self, run: LoggedRun, floor_run: LoggedRun) -> dict[str, dict[str, float]]:
        """{"block": {"gap": RMS, "floor": RMS of the nominal plant's own noisy log}}; `floor_run`
        from `noisy_copy`.
        """
        floors = self.residuals(floor_run)
        floors["timing"] = _rounding_floor(run)
        return {
            name: {"gap": _rms(values), "floor": _rms(floors[name])}
            for name, values in self.residuals(run).items()
        }

    def _parameters(self, prefix: str) -> dict[str, float]:
        """Values of the gantry's component under the names of its block."""
        return {
            name.removeprefix(prefix): float(v.start)
            for name, v in self.gantry.variables.items()
            if v.causality == "parameter" and v.start is not None and name.startswith(prefix)
        }

    def _valve(self, signals: _Signals, axis: str) -> Array:
        log = signals.run.log
        parameters = self._parameters(f"valve_{axis}.") | {
            "s_low": self._parameters(f"axis_{axis}.")["s_low"],
            "s_high": self._parameters(f"axis_{axis}.")["s_high"],
        }
        inputs = np.column_stack([log[f"u_{axis}"], _midway(signals.position(axis))])
        simulated = self._force("valve", parameters, ("u", "s"), inputs, ("f_a",))
        return (log[f"f_a{axis}"][:, None] - simulated) / SIGMA[f"f_a{axis}"]

    def _contact(self, signals: _Signals) -> Array | None:
        run = signals.run
        if run.setup.workpiece == "none":
            return None
        setup = {
            k: v
            for k, v in plant_parameters(run.setup).items()
            if k.startswith(("workpiece.", "contact."))
        }
        parameters = self._parameters("")
        parameters = {
            k: v for k, v in parameters.items() if k.startswith(("workpiece.", "contact."))
        } | setup
        v_x, v_z = run.log["v_x"], run.log["v_z"]
        names, columns = ["x", "z", "v_x", "v_z"], [signals.x, signals.z, v_x, v_z]
        profile = own_profile(run.setup)
        if profile is not None:
            names += list(PROFILE)
            columns += [
                signals.x,
                profile.height(signals.x),
                profile.slope(signals.x),
                profile.curvature(signals.x),
            ]
        simulated = self._force(
            "contact", parameters, tuple(names), np.column_stack(columns), ("f_x", "f_z")
        )
        return (
            np.column_stack([run.log[c] - simulated[:, i] for i, c in enumerate(("f_x", "f_z"))])
            / SIGMA["f_x"]
        )

    def _friction(self, signals: _Signals, axis: str) -> Array | None:
        log = signals.run.log
        free = ~signals.run.setup.clamp_signal(axis, log.time)
        if free.sum() < WINDOW:
            return None
        load = np.hypot(log["f_x"], log["f_z"])
        inputs = np.column_stack(
            [_midway(log[f"f_a{axis}"]), _midway(log[f"f_{axis}"]), _midway(load)]
        )
        parameters = self._parameters(f"axis_{axis}.")
        parameters.pop("s_start", None)
        position, speed = signals.position(axis), log[f"v_{axis}"]
        measured = np.column_stack([speed / SIGMA[f"v_{axis}"], position / SIGMA[axis]])
        residual = np.full((len(log), 2), np.nan)
        for start in range(LEAD, len(log) - WINDOW - LEAD, WINDOW):
            rows = slice(start, start + WINDOW)
            if not free[start - LEAD : start + WINDOW].all():
                continue
            initial = {
                "s_start": float(np.clip(position[start], -10, 10)),
                "v": float(speed[start - LEAD : start + LEAD + 1].mean()),
            }
            simulated = self._force(
                "friction", parameters | initial, ("f_a", "f_c", "f_load"), inputs[rows], ("v", "s")
            )
            residual[rows] = measured[rows] - simulated / (SIGMA[f"v_{axis}"], SIGMA[axis])
        return residual

    def _force(
        self,
        name: str,
        parameters: Mapping[str, float],
        inputs: tuple[str, ...],
        values: Array,
        outputs: tuple[str, ...],
    ) -> Array:
        """Outputs (N, len(outputs)) of a block for inputs (N, len(inputs)) held over each
        millisecond.
        """
        session = self._sessions[name]
        known = session.file.variables
        session.reset(
            {k: v for k, v in parameters.items() if k in known and known[k].settable_before_start}
        )
        raw = session.raw()
        result = np.empty((len(values), len(outputs)))
        wiring = (raw.component, raw.set_real, raw.get_real, raw.do_step)
        status = _drive(
            wiring,
            session.references(inputs),
            session.references(outputs),
            np.ascontiguousarray(values),
            PERIOD,
            result,
        )
        session.stepped_natively(len(values) * PERIOD, status)
        return result


@kept
def _drive(wiring, input_refs, output_refs, values, period, result):  # type: ignore[no-untyped-def]
    component, set_real, get_real, do_step = wiring
    for k in range(len(values)):
        status = native_values(set_real, component, input_refs, values[k])
        status = max(status, native_values(get_real, component, output_refs, result[k]))
        status = max(status, call_step(do_step, component, k * period, period))
        if status > FMI_WARNING:
            return status
    return 0


def _midway(values: Array) -> Array:
    """A continuous signal's mean over each sampling interval, from its samples."""
    return 0.5 * (values + np.append(values[1:], values[-1]))


def noisy_copy(run: LoggedRun, simulated: Array) -> LoggedRun:
    """The log that the simulated plant would have given: its outputs (N, 8) with the sensors'
    noise.
    """
    table = pd.DataFrame({name: run.log[name] for name in ("time", "u_x", "u_z")})
    noise = noise_rows(len(run.log), 0)
    for column, name in enumerate(MEASURED):
        table[name] = simulated[:, column] + SIGMA[name] * noise[:, column]
    return replace(run, log=Log(table, run.log.name, {}))


def _timing(run: LoggedRun) -> Array | None:
    """Recorded command less what the controller makes of the recorded signals, in units of the
    command's rounding.
    """
    measured = np.round(run.log.measured(), 12)
    commands = recomputed_commands(run, measured)
    return (
        None
        if commands is None
        else np.column_stack([run.log["u_x"], run.log["u_z"]]) / COMMAND_QUANTUM
        - commands / COMMAND_QUANTUM
    )


def recomputed_commands(run: LoggedRun, measured: Array) -> Array | None:
    """Commands (N, 2) of the log's controller for measured signals (N, 8); NaN before its contact
    phase; None without a controller that is known.
    """
    setup = run.setup
    if (
        setup.loop != "closed"
        or setup.controller is None
        or not is_known_controller(setup.controller)
        or "contact" not in setup.phases
        or "contour" not in setup.phases
    ):
        return None
    controller = controller_of(setup.controller, setup.gains)
    contact, contour = (
        round((setup.phases[name][0] - run.log.time[0]) / PERIOD) for name in ("contact", "contour")
    )
    end = round((setup.phases["contour"][1] - run.log.time[0]) / PERIOD)
    commands = np.full((len(measured), 2), np.nan)
    loop = _controller_loop(type(controller).kernel)
    f_nd, v_td = float(setup.f_nd or 0.0), float(setup.v_td or 0.0)
    loop(
        controller.params,
        controller.state,
        measured,
        (contact, contour, min(end, len(measured))),
        (f_nd, v_td),
        commands,
    )
    return commands


_LOOPS: dict[Any, Callable[..., None]] = {}


def _controller_loop(kernel: Callable[..., Any]) -> Callable[..., None]:
    if kernel not in _LOOPS:

        def loop(params, state, measured, span, wanted, commands):  # type: ignore[no-untyped-def]
            contact, contour, end = span
            f_nd, v_td = wanted
            for k in range(contact, end):
                m = measured[k]
                reference = Reference(f_nd, v_td if k >= contour else 0.0)
                state, command = kernel(
                    params, state, reference, Sense(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7])
                )
                commands[k, 0], commands[k, 1] = command.u_x, command.u_z

        _LOOPS[kernel] = kept(loop, kernel)
    return _LOOPS[kernel]


def _rounding_floor(run: LoggedRun) -> Array:
    """Timing residual that the log's own rounding causes: signals moved at random within their
    rounding steps.
    """
    measured = run.log.measured()
    generator = np.random.default_rng(0)
    steps = np.array([_quantum(column) for column in measured.T])
    moved = recomputed_commands(
        run, measured + steps * generator.uniform(-0.5, 0.5, measured.shape)
    )
    plain = recomputed_commands(run, measured)
    if moved is None or plain is None:
        return np.zeros((1, 1))
    return (moved - plain) / COMMAND_QUANTUM + generator.uniform(-0.5, 0.5, plain.shape)


def _quantum(values: Array) -> float:
    """Smallest step between neighbouring values of a rounded channel; 0 where it is not rounded."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-9]
    if len(steps) == 0 or len(steps) > 0.5 * len(values):
        return 0.0
    return float(np.median(steps[steps < 1.5 * steps.min()]))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else float("nan")
