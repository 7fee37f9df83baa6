"""Position and speed of an axis from its two noisy sensors together: the position is the integral
of the speed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyfmi_runner.machine_code import kept

__all__ = ["Smoothed", "smooth_axis"]

Array = NDArray[np.float64]


class Smoothed(NamedTuple):
    position: Array  # m, fixed-interval smoothed
    innovation: (
        Array  # (measured - predicted) / its standard deviation; 1 RMS where both sensors agree
    )
    sigma: float  # m, standard deviation of the smoothed position in the middle of a log


@kept
def _filter(s: Array, v: Array, dt: float, q: float, r: float) -> tuple[Array, Array, Array]:
    """Kalman filter of s' = v with measured v as input (noise variance q per step), then
    Rauch-Tung-Striebel backwards.
    """
    n = len(s)
    predicted, filtered, before, after = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    innovation = np.empty(n)
    x, p = s[0], r
    for k in range(n):
        if k > 0:
            x += 0.5 * dt * (v[k - 1] + v[k])
            p += q
        predicted[k], before[k] = x, p
        innovation[k] = (s[k] - x) / math.sqrt(p + r) if k > 0 else 0.0
        gain = p / (p + r) if k > 0 else 0.0
        x += gain * (s[k] - x)
        p *= 1.0 - gain
        filtered[k], after[k] = x, p
    smoothed, variance = filtered.copy(), after.copy()
    for k in range(n - 2, -1, -1):
        gain = after[k] / before[k + 1]
        smoothed[k] = filtered[k] + gain * (smoothed[k + 1] - predicted[k + 1])
        variance[k] = after[k] + gain * gain * (variance[k + 1] - before[k + 1])
    return smoothed, innovation, variance


def smooth_axis(
    position: Array, speed: Array, sigma_position: float, sigma_speed: float, dt: float = 1e-3
) -> Smoothed:
    """Smoothed position (N,) from measured position [m] and speed [m/s], (N,) each, with their RMS
    noise.

    The integral of white speed noise wanders by sigma_speed*dt a step, far less than the position's
    own noise, so the smoothed position is some ten times as exact as the measured one (0.1 mm and
    0.5 mm/s give 5 um).
    """
    q = (sigma_speed * dt) ** 2
    smoothed, innovation, variance = _filter(
        np.asarray(position, float), np.asarray(speed, float), dt, q, sigma_position**2
    )
    return Smoothed(smoothed, innovation, math.sqrt(variance[len(variance) // 2]))
