"""What a set of logs cannot show, whatever the rig does: motions, forces and commands that are not
in them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from pyfmi_runner.campaign import LoggedRun
from pyfmi_runner.log import PERIOD, STROKE_X, STROKE_Z, Log

__all__ = ["not_excited"]

MOVING = 5e-3  # m/s, over 20 samples
TOUCHING = 2.0  # N
COMMANDED = 0.05  # V


def not_excited(runs: Iterable[LoggedRun]) -> list[str]:
    """What these logs cannot tell, one sentence each."""
    facts = [_Motion(run) for run in runs]
    return [text for text in _gaps(facts) if text]


class _Motion:
    """What one log does."""

    def __init__(self, run: LoggedRun) -> None:
        log, setup = run.log, run.setup
        self.closed = setup.loop == "closed" and setup.controller is not None
        self.workpiece = setup.workpiece if setup.workpiece != "none" else ""
        felt = [log[c] for c in ("f_x", "f_z") if c in log]
        self.measures_force = bool(felt)
        force = np.hypot.reduce([np.zeros(len(log)), *felt])
        self.touching = bool((_mean(force) > TOUCHING).any())
        self.forward, self.back, self.dragged, self.command = {}, {}, {}, {}
        self.range: dict[str, tuple[float, float]] = {}
        for axis in "xz":
            free = ~setup.clamp_signal(axis, log.time)
            speed = np.where(free, _speed(log, axis), 0.0)
            self.forward[axis], self.back[axis] = (
                bool((speed > MOVING).any()),
                bool((speed < -MOVING).any()),
            )
            self.dragged[axis] = bool(((np.abs(speed) > MOVING) & (_mean(force) > TOUCHING)).any())
            if axis in log:
                low, high = np.quantile(log[axis], (0.02, 0.98))
                self.range[axis] = float(low), float(high)
            self.command[axis] = float(np.ptp(log[f"u_{axis}"])) > COMMANDED


def _speed(log: Log, axis: str) -> Any:
    """Mean speed over 20 rows [m/s], of the position where no speed is measured; 0 without both."""
    if f"v_{axis}" in log:
        return _mean(log[f"v_{axis}"])
    return _mean(np.gradient(_mean(log[axis]), PERIOD)) if axis in log else np.zeros(len(log))


def _mean(values: Any) -> Any:
    return np.convolve(values, np.full(20, 0.05), mode="same")


def _gaps(facts: list[_Motion]) -> Iterator[str]:
    for axis, stroke in (("x", STROKE_X), ("z", STROKE_Z)):
        if not any(f.command[axis] for f in facts):
            yield (
                f"u_{axis} hardly changes: effects of valve_{axis} that act on changes (lag, "
                f"delay, hysteresis) cannot show"
            )
        forward, back = any(f.forward[axis] for f in facts), any(f.back[axis] for f in facts)
        if not (forward or back):
            yield f"{axis} does not move free of its clamp: nothing can be said of friction_{axis}"
        elif not (forward and back):
            sign = "+" if forward else "−"
            yield (
                f"{axis} moves towards {sign}{axis} only: level, direction and offset of its "
                f"friction cannot be told apart"
            )
        spans = [f.range[axis] for f in facts if axis in f.range]
        if spans and max(s[1] for s in spans) - min(s[0] for s in spans) < 0.3 * stroke:
            yield (
                f"{axis} stays within 30 % of its stroke: effects that vary along it "
                f"(valve_lag_position, friction_position) cannot show"
            )
    if not any(f.measures_force for f in facts):
        yield "no contact force is measured: little can be said of the contact"
    elif not any(f.touching for f in facts):
        yield (
            f"no contact force above {TOUCHING:g} N: nothing can be said of the contact, of "
            f"force_gain, of friction_load"
        )
    elif not any(f.dragged["x"] for f in facts):
        yield (
            "no log slides along the edge in contact: bearing_drag, surface_waviness and "
            "workpiece_angle cannot show"
        )
    if not any(f.closed for f in facts):
        yield "no closed loop with a known controller among the fitted logs: loop_delay cannot show"
    kinds = {f.workpiece for f in facts if f.workpiece}
    if any(f.touching for f in facts) and len(kinds) == 1:
        yield (
            f"one workpiece only ({kinds.pop()}): an error of its shape or angle looks like "
            f"one of the contact"
        )
