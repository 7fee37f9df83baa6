"""The surface finish as §4.1.5 words it: a normally distributed random angle, bounded by 3 degrees,
added to the edge's own.

The thesis prints neither the distance over which an angle is held nor the spread before bounding.
A draw therefore draws both: the distance log-uniformly within 10..40 mm, the spread within half to
the whole bound. An angle turns into the next over a tenth of the distance, at most 1 mm: a corner
of no length would be a jump of the contact's damping force.
"""

from __future__ import annotations

import atexit
import math
import shutil
import tempfile
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pyfmi_runner.workpiece import workpiece

__all__ = ["BOUND", "edge_with_finish", "finish_statistics", "random_angle"]

Array = NDArray[np.float64]
BOUND = math.radians(3.0)  # rad, §4.1.5
SPREADS = (0.5 * BOUND, BOUND)  # rad, standard deviation before bounding; not printed
HOLDS = (0.010, 0.040)  # m, over which an angle is held; not printed
STEP, X_DATUM = 0.5e-3, 0.95  # m: grid, and where z_w = 0
FIRST, LAST = 0.0, 1.0  # m, the stroke


def finish_statistics(draw: int) -> tuple[float, float]:
    """Distance [m] over which draw number `draw` holds an angle, and its spread [rad]."""
    first, second = np.random.default_rng((413, draw)).random(2)
    hold = HOLDS[0] * (HOLDS[1] / HOLDS[0]) ** float(first)
    return hold, SPREADS[0] + (SPREADS[1] - SPREADS[0]) * float(second)


def random_angle(x: Array, draw: int) -> Array:
    """Angle [rad] at x [m] of a draw, within the bound; the same for every workpiece."""
    hold, spread = finish_statistics(draw)
    cells = math.ceil((LAST - FIRST) / hold) + 2
    drawn = np.random.default_rng((415, draw)).normal(0.0, spread, cells)
    angles = np.clip(drawn, -BOUND, BOUND)
    corner = min(0.1 * hold, 1e-3)
    edges = FIRST + hold * np.arange(1, cells)
    at = np.stack([edges - 0.5 * corner, edges + 0.5 * corner], axis=1).ravel()
    held = np.stack([angles[:-1], angles[1:]], axis=1).ravel()
    return np.interp(x, at, held)


@lru_cache(maxsize=64)
def edge_with_finish(piece: str, draw: int) -> str:
    """A named workpiece with the random angle, written as a table of x, z_w; its path."""
    x = np.arange(FIRST, LAST + 0.5 * STEP, STEP)
    base = workpiece(piece)
    theta = np.arctan(base.slope(x)) + random_angle(x, draw)
    slope = np.tan(theta) - base.slope(x)
    rise = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * STEP)])
    z_w = base.height(x) + rise - np.interp(X_DATUM, x, rise)
    path = Path(_folder()) / f"{piece}_{draw}.csv"
    lines = [f"{a:.4f},{b:.9f}" for a, b in zip(x, z_w, strict=True)]
    path.write_text("x,z_w\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


@cache
def _folder() -> str:
    """One folder a process: a table is written once and read by that process alone."""
    folder = tempfile.mkdtemp(prefix="pneugantry_finish_")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
