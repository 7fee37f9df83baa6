"""Starts and ends of motion: F_s by Eq. C-1 and by fit, F_d by Eq. C-2."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from pneugantry.analysis.identify.motion import slides
from pneugantry.analysis.identify.signals import (
    HALF,
    NEAR,
    STROKE,
    THRESHOLD,
    Signals,
    stretches_of,
)
from pyfmi_runner.first_order import first_order
from pyfmi_runner.log import PERIOD

__all__ = ["Breakaway", "breakaways", "stops"]

Array = NDArray[np.float64]
LONGEST = 400  # samples before a start that are looked at
REST = 100  # samples of rest before it


@dataclass(frozen=True)
class Breakaway:
    """One start of motion: the force over the cable's at which v passes 0.01 m/s (C.1), and at
    which the piston let go.
    """

    log: str
    time: float  # s, v passes 0.01 m/s
    way: float  # +1 or -1
    by_rule: float  # N, as in Eq. C-1
    corrected: float  # N, less what the force gained while the mass came up to 0.01 m/s


def breakaways(stretches: Sequence[Signals], m: float, C: float, cable: float) -> list[Breakaway]:
    """Every start from rest. m [kg], C [N s/m], cable: F_w [N]."""
    found = []
    for s in stretches:
        net = _calmed(s.drive) - cable
        resting = np.abs(s.calm) < 0.4 * THRESHOLD
        beyond = np.abs(s.calm) > THRESHOLD
        for k in np.flatnonzero(beyond[1:] & ~beyond[:-1]) + 1:
            way = math.copysign(1.0, s.calm[k])
            first = max(0, k - LONGEST)
            if _was_at_rest(resting[first:k]) and way * net[k] > 0:
                rows = slice(first, k + 1)
                level = _onset(way * net[rows], way * s.speed[rows], m, C)
                found.append(Breakaway(s.log, float(s.time[k]), way, float(way * net[k]), level))
    return found


def _was_at_rest(still: NDArray[np.bool_]) -> bool:
    """REST samples of rest somewhere before, and nothing but starting since."""
    runs = stretches_of(still)
    return bool(runs) and runs[-1][1] - runs[-1][0] >= REST


def _calmed(values: Array) -> Array:
    kernel = np.ones(2 * HALF + 1) / (2 * HALF + 1)
    return np.asarray(np.convolve(np.pad(values, HALF, mode="edge"), kernel, mode="valid"))


def _onset(net: Array, speed: Array, m: float, C: float) -> float:
    """The break-away level with which m v' = net - level - C v, from where net passes it, comes
    closest to the measured speed.
    """
    fade = 1.0 - C / m * PERIOD

    def misfit(level: float) -> float:
        held = np.flatnonzero(net < level)
        onset = int(held[-1]) + 1 if len(held) else 0
        excess = net[onset:] - level
        push = np.concatenate([[0.0], 0.5 * (excess[1:] + excess[:-1])]) if len(excess) else excess
        ahead = first_order(push, PERIOD / m, fade)
        return float(np.sum(speed[:onset] ** 2) + np.sum((speed[onset:] - ahead) ** 2))

    return float(
        minimize_scalar(
            misfit, bounds=(0.6 * net[-1], net[-1]), method="bounded", options={"xatol": 1e-3}
        ).x
    )


def stops(stretches: Sequence[Signals], direction: float, cable: float) -> list[float]:
    """F_d by Eq. C-2: the force over the cable's at which a piston that slid freely falls below
    0.01 m/s.
    """
    found = []
    for s in stretches:
        for part in slides([s]):
            end = min(part.b + 3 * HALF, len(s.calm) - 1)
            if part.way * s.calm[end] > THRESHOLD or part.way != direction:
                continue
            k = (
                part.b
                - HALF
                + int(np.argmax(part.way * s.calm[part.b - HALF : end + 1] < THRESHOLD))
            )
            if not 3 * NEAR[s.axis] < s.position[k] < STROKE[s.axis] - 3 * NEAR[s.axis]:
                continue  # an end stop held it
            found.append(float(part.way * (_calmed(s.drive)[k] - cable)))
    return found
