"""What is suspicious about a log that can be used."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pyfmi_runner.command_order import commands_swapped
from pyfmi_runner.log import COLUMNS, MEASURED, PERIOD, SIGMA, STROKE_X, STROKE_Z, Log

__all__ = ["Kind", "Suspicion", "log_warnings", "suspicions", "touches"]

Kind = Literal["constant", "clipped", "held", "swapped", "reversed", "scale", "offset"]
FELT = 5.0  # N, a contact force that runs over more is no offset of its cell


@dataclass(frozen=True)
class Suspicion:
    """What is suspicious about a channel."""

    channel: str
    kind: Kind
    text: str  # one sentence


def log_warnings(log: Log) -> list[str]:
    """What is suspicious about a usable log, one sentence each; empty for a sound log."""
    return [s.text for s in suspicions(log)]


def suspicions(log: Log) -> list[Suspicion]:
    """Stuck or clipped channels, swapped or reversed columns, speeds that disagree with positions,
    offsets, a start that is not at rest. What needs a channel that is not measured is left out.
    """
    return [
        *_stuck_or_clipped(log),
        *_force_order(log),
        *_actuator_order(log),
        *_command_order(log),
        *_speeds(log),
        *_start(log),
    ]


def _has(log: Log, *names: str) -> bool:
    return all(name in log for name in names)


def touches(force: NDArray[np.float64]) -> bool:
    """Does a channel of the contact force [N] tell of a workpiece, single rows apart?"""
    finite = force[np.isfinite(force)]
    return len(finite) > 0 and float(np.ptp(np.percentile(finite, [1, 99]))) > FELT


def _runs(values: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First rows and lengths of the stretches over which a channel does not change."""
    first = np.flatnonzero(np.r_[True, values[1:] != values[:-1]])
    return first, np.diff(np.r_[first, len(values)])


def _stuck_or_clipped(log: Log) -> Iterator[Suspicion]:
    runs = {name: _runs(log[name]) for name in MEASURED if name in log}
    longest = {name: int(lengths.max()) for name, (_, lengths) in runs.items()}
    if float(np.median(list(longest.values()))) >= 50:
        return  # a log without noise, or all coarse: standing still is no sign of a fault
    for name, (first, lengths) in runs.items():
        values, unit = log[name], COLUMNS[name].unit
        row = int(first[np.argmax(lengths)])
        held = np.unique(values[first[lengths >= 20]])
        if longest[name] == len(log):
            said = f"{name} reads {values[0]:g} {unit} throughout: is the sensor connected?"
            yield Suspicion(name, "constant", said)
        elif (
            name.startswith("f_")
            and len(held)
            and set(held) <= {values.min(), values.max()}
            and abs(held).min() > 5
        ):
            ends = " and ".join(f"{v:g}" for v in held)
            said = f"{name} looks clipped at {ends} {unit}: widen the sensor's range"
            yield Suspicion(name, "clipped", said)
        elif longest[name] >= 500:
            held_for = f"{longest[name] * PERIOD:.1f} s from row {row}"
            said = f"{name} holds {values[row]:g} {unit} for {held_for}"
            yield Suspicion(name, "held", f"{said}: stuck, or a coarse converter")


def _force_order(log: Log) -> Iterator[Suspicion]:
    if not _has(log, "f_x", "f_z"):
        return
    f_x, f_z = log["f_x"], log["f_z"]
    rms_x, rms_z = float(np.sqrt(np.mean(f_x**2))), float(np.sqrt(np.mean(f_z**2)))
    if rms_x > 2.0 and rms_x > 2 * rms_z:
        said = f"f_x carries the contact force ({rms_x:.1f} N RMS; f_z {rms_z:.1f} N)"
        yield Suspicion("f_x", "swapped", f"{said}: are columns f_x and f_z swapped?")
    elif rms_z > 2.0 and np.mean(f_z) < -0.5 * rms_z and touches(f_z):
        said = "f_z is negative in contact; it is the robot's force on the workpiece, > 0"
        yield Suspicion("f_z", "reversed", f"{said}: is its sign reversed?")


def _actuator_order(log: Log) -> Iterator[Suspicion]:
    pushes_x, pushes_z = (
        float(np.mean(log[name])) if name in log else 0.0 for name in ("f_ax", "f_az")
    )
    if pushes_x > 5 and pushes_z < -5:
        said = "f_ax is positive and f_az negative, expected the reverse"
        yield Suspicion("f_ax", "swapped", f"{said}: are columns f_ax and f_az swapped?")
    elif pushes_x > 5:
        said = "f_ax is positive; the x valve pushes to -x: is its sign reversed?"
        yield Suspicion("f_ax", "reversed", said)
    elif pushes_z < -5:
        said = "f_az is negative; the z valve pushes to +z: is its sign reversed?"
        yield Suspicion("f_az", "reversed", said)


def _command_order(log: Log) -> Iterator[Suspicion]:
    if not _has(log, "f_ax", "f_az"):
        return
    commands, forces = ({a: log[f"{kind}{a}"] for a in "xz"} for kind in ("u_", "f_a"))
    if commands_swapped(commands, forces, PERIOD):
        said = "u_x drives f_az and u_z drives f_ax: are columns u_x and u_z swapped?"
        yield Suspicion("u_x", "swapped", said)


def _speeds(log: Log) -> Iterator[Suspicion]:
    if not _has(log, "x", "z", "v_x", "v_z"):
        return
    window = 250  # rows: long against a tachometer's lag, short against a stroke
    moved, driven = {}, {}
    for axis in "xz":
        travel = np.r_[0.0, np.cumsum(log[f"v_{axis}"])[:-1]] * PERIOD
        moved[axis] = log[axis][window:] - log[axis][:-window]
        driven[axis] = travel[window:] - travel[:-window]
    for axis, other in ("xz", "zx"):
        if len(log) < 4 * window or float(np.std(moved[axis])) < 10 * SIGMA[axis]:
            continue  # the axis hardly moves: nothing to compare
        power = float(np.mean(moved[axis] ** 2))
        slope = float(np.mean(moved[axis] * driven[axis])) / power
        rest = float(np.sqrt(np.mean((moved[axis] - driven[axis]) ** 2)))
        crossed = float(np.sqrt(np.mean((moved[axis] - driven[other]) ** 2)))
        drift = float(np.mean(driven[axis] - moved[axis])) / (window * PERIOD)
        if crossed < 0.2 * rest:
            said = f"the integral of v_{other} follows {axis}, not that of v_{axis}"
            yield Suspicion(f"v_{axis}", "swapped", f"{said}: are columns v_x and v_z swapped?")
        elif slope < -0.5:
            said = f"v_{axis} runs against d{axis}/dt"
            text = f"{said}: is the sign of v_{axis} or of {axis} reversed?"
            yield Suspicion(f"v_{axis}", "reversed", text)
        elif not 0.8 < slope < 1.25:
            said = f"v_{axis} is {slope:.3g} times d{axis}/dt"
            text = f"{said}: check the unit and scale of v_{axis} and {axis}"
            yield Suspicion(f"v_{axis}", "scale", text)
        elif abs(drift) > 20 * SIGMA[f"v_{axis}"]:
            said = f"v_{axis} reads {drift:+.3g} m/s more than d{axis}/dt on average: an offset?"
            yield Suspicion(f"v_{axis}", "offset", said)


def _start(log: Log) -> Iterator[Suspicion]:
    for name in filter(log.__contains__, ("v_x", "v_z", "f_ax", "f_az")):
        first = float(np.mean(log[name][:5]))
        limit = 20 * SIGMA[name] if name.startswith("v") else 5.0
        if abs(first) > limit:
            said = f"{name} starts at {first:.3g} {COLUMNS[name].unit}"
            text = f"{said}: the log does not start at rest, or an offset"
            yield Suspicion(name, "offset", text)
    for name in filter(log.__contains__, ("f_x", "f_z")):
        first = float(np.mean(log[name][:50]))
        if abs(first) > 0.3:
            said = f"{name} starts at {first:.3g} N: an offset, unless the log starts in contact"
            yield Suspicion(name, "offset", said)
    for axis, stroke in (("x", STROKE_X), ("z", STROKE_Z)):
        if axis not in log:
            continue
        low, high = float(log[axis].min()), float(log[axis].max())
        if low < -10 * SIGMA[axis] or high > stroke + 10 * SIGMA[axis]:
            said = f"{axis} spans {low:.4g}..{high:.4g} m, outside the stroke 0..{stroke:g} m"
            yield Suspicion(axis, "offset", f"{said}: an offset?")
