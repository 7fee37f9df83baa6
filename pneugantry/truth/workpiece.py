"""Workpiece edges as tables of height and slope on an even grid of x, read by cubic Hermite
interpolation.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline

from pneugantry.truth.parameters import Rig

DATUM = 0.95  # m, x at which every edge has z_w = 0
X_FIRST, X_STEP, X_COUNT = -0.1, 1e-4, 12001
INCLINES = {"straight": 0.0, "incline_7": 7.0, "incline_16": 16.0, "incline_30": 30.0}  # deg
STANDOFF = {
    "straight": 0.040,
    "incline_7": 0.090,
    "incline_16": 0.092,
    "incline_30": 0.092,
    "curved": 0.090,
}  # m
# A [m], lambda [m], phi [rad]; section 4.1.5
FINISH = ((0.20e-3, 60e-3, 0.3), (0.08e-3, 27e-3, 1.1), (0.03e-3, 13e-3, 2.0))


def curved_angle(x: np.ndarray) -> np.ndarray:
    """Slope angle [rad] of the curved workpiece, shaped after Fig. 3.33/4.36."""
    hump, dip = (0.78 - x) / 0.16, (0.52 - x) / 0.10
    degrees = np.where((hump > 0) & (hump < 1), 50.0 * np.sin(np.pi * hump) ** 2, 0.0)
    degrees = degrees - np.where((dip > 0) & (dip < 1), 10.0 * np.sin(np.pi * dip) ** 2, 0.0)
    return np.radians(degrees)


def grid() -> np.ndarray:
    """x [m] of the table's nodes."""
    return X_FIRST + X_STEP * np.arange(X_COUNT)


def edge_table(workpiece: str, rig: Rig, finish: bool = False) -> np.ndarray:
    """Rows z_w [m] and tan(theta) on `grid()` of a named workpiece as mounted on this rig."""
    x = grid()
    if workpiece == "curved":
        slope = np.tan(curved_angle(x))
        antiderivative = CubicSpline(x, slope).antiderivative()
        height = antiderivative(x) - antiderivative(DATUM)
    elif workpiece in INCLINES:
        slope = np.full_like(x, math.tan(math.radians(INCLINES[workpiece])))
        height = slope * (x - DATUM)
    elif workpiece == "none":
        return np.zeros((2, X_COUNT))
    else:
        raise ValueError(
            f"workpiece must be one of {sorted(STANDOFF)} or 'none', got {workpiece!r}"
        )
    contact = rig.contact[0]
    if contact["tilt"] != 0.0:
        arm = x - contact["pivot"]
        angle = contact["tilt"] * (1.0 + contact["tilt_bow"] * arm)
        height = height + np.tan(angle) * arm
        slope = slope + np.tan(angle) + contact["tilt"] * contact["tilt_bow"] * arm
    extra = np.zeros_like(x) if rig.edge is None else rig.edge(x)
    if finish:
        extra = extra + sum(a * np.sin(2 * np.pi * x / wave + phase) for a, wave, phase in FINISH)
    return np.vstack([height + extra, slope + np.gradient(extra, X_STEP, edge_order=2)])


@njit
def edge_at(table: np.ndarray, x: float) -> tuple[float, float]:
    """(z_w [m], tan theta) at x [m]; beyond the table the edge goes on straight."""
    place = (x - X_FIRST) / X_STEP
    if place < 0.0:
        return table[0, 0] + table[1, 0] * (x - X_FIRST), table[1, 0]
    k = int(place)
    if k >= X_COUNT - 1:
        return table[0, -1] + table[1, -1] * (place - X_COUNT + 1) * X_STEP, table[1, -1]
    s = place - k
    a, b, da, db = table[0, k], table[0, k + 1], table[1, k] * X_STEP, table[1, k + 1] * X_STEP
    height = a + s * (da + s * (3.0 * (b - a) - 2.0 * da - db + s * (2.0 * (a - b) + da + db)))
    slope = (
        da + s * (2.0 * (3.0 * (b - a) - 2.0 * da - db) + 3.0 * s * (2.0 * (a - b) + da + db))
    ) / X_STEP
    return height, slope
