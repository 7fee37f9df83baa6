"""What a log says of one axis while it is free: position, speed and the forces on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyfmi_runner.campaign import Campaign
from pyfmi_runner.log import SIGMA, STROKE_X, STROKE_Z, Log
from pyfmi_runner.smoothing import smooth_axis

__all__ = [
    "HALF",
    "NEAR",
    "STROKE",
    "THRESHOLD",
    "Signals",
    "free_signals",
    "landings",
    "near_landings",
    "stretches_of",
]

Array = NDArray[np.float64]
THRESHOLD = 0.01  # m/s, "motion begins" (C.1), and half-width of the stick band (Eq. 3-18)
HALF = 8  # samples either side over which the speed is averaged
TOUCH = 0.8  # N, above which something is touched
NEAR = {"x": 3e-3, "z": 1e-3}  # m from an end stop: not counted
STROKE = {"x": STROKE_X, "z": STROKE_Z}


@dataclass(frozen=True, eq=False)
class Signals:
    """One stretch of a log over which an axis was free."""

    log: str
    axis: str
    time: Array  # s
    position: Array  # m, smoothed
    speed: Array  # m/s, as measured
    calm: Array  # m/s, averaged over HALF samples either side
    drive: Array  # N, f_a - f_c
    actuator: Array  # N, f_a
    landing: NDArray[
        np.bool_
    ]  # about a touch-down, where the contact force jumps between two samples


def free_signals(campaign: Campaign, axis: str) -> list[Signals]:
    """Every stretch over which the axis is not clamped."""
    found = []
    kernel = np.ones(2 * HALF + 1) / (2 * HALF + 1)
    for run in campaign:
        log = run.log
        free = ~run.setup.clamp_signal(axis, log.time)
        position = smooth_axis(
            log[axis], log[f"v_{axis}"], SIGMA[axis], SIGMA[f"v_{axis}"]
        ).position
        calm = np.convolve(np.pad(log[f"v_{axis}"], HALF, mode="edge"), kernel, mode="valid")
        for a, b in stretches_of(free):
            rows = slice(a, b)
            drive = log[f"f_a{axis}"] - log[f"f_{axis}"]
            found.append(
                Signals(
                    log.name,
                    axis,
                    log.time[rows],
                    position[rows],
                    log[f"v_{axis}"][rows],
                    calm[rows],
                    drive[rows],
                    log[f"f_a{axis}"][rows],
                    near_landings(log)[rows],
                )
            )
    return found


def landings(log: Log) -> NDArray[np.intp]:
    """First samples of each contact."""
    force = np.hypot(log["f_x"], log["f_z"])
    loose = np.convolve(force < TOUCH, np.ones(10), mode="full")[: len(force)] >= 9
    return np.flatnonzero(loose[:-1] & (force[1:] >= TOUCH)) + 1


def near_landings(log: Log, reach: int = 3) -> NDArray[np.bool_]:
    """Samples within `reach` of a touch-down."""
    near = np.zeros(len(log), dtype=np.bool_)
    for row in landings(log):
        near[max(0, row - reach) : row + reach + 1] = True
    return near


def stretches_of(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
