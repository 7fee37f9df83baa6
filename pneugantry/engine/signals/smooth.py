"""Noisy signals made smooth: Savitzky-Golay filters (least squares of a polynomial in a moving
window), and parabolas over windows as wide as the signal allows.

`scipy.signal.savgol_filter` fits the two ends of every signal anew, at ten times the price of the
rest; a diagnosis filters thousands of short signals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pneugantry.engine.plant import Array

__all__ = ["Widest", "savgol", "widest", "widest_slope"]

WIDTHS = (5, 9, 17, 33, 65)  # rows of a window
APART = 4.5  # standard deviations by which estimates may differ: by chance once in 150,000 rows


def savgol(values: Array, window: int, degree: int, derivative: int = 0) -> Array:
    """Smoothed values or a derivative (N,), per row; the ends by the polynomials of the first and
    the last whole window. window: rows, odd; a shorter signal gets a shorter one, of
    a degree that it tells.
    """
    width = min(window, len(values) - 1 + len(values) % 2)
    ends = _ends(width, min(degree, width - 1), derivative)
    half = width // 2
    result = np.empty(len(values))
    result[half : len(values) - half] = np.correlate(values, ends[half], "valid")
    result[:half] = ends[:half] @ values[:width]
    result[len(values) - half :] = ends[half + 1 :] @ values[-width:]
    return result


@lru_cache(maxsize=32)
def _ends(width: int, degree: int, derivative: int) -> Array:
    """(width, width): what the fit to a window makes of its values at each of its rows."""
    at = np.arange(width) - width // 2
    powers = np.vander(at, degree + 1, increasing=True).astype(float)
    of_rows = np.zeros_like(powers)
    for k in range(derivative, degree + 1):
        factor = np.prod(np.arange(k - derivative + 1, k + 1, dtype=float))
        of_rows[:, k] = factor * at.astype(float) ** (k - derivative)
    return np.asarray(of_rows @ np.linalg.pinv(powers))


@dataclass(frozen=True, eq=False)
class Widest:
    """A signal smoothed as wide as it allows."""

    values: Array  # (N,)
    resting: Array  # (N,), means over the widest window of all; NaN where not even that is too wide
    error: float  # standard deviation of these means, times `APART`

    def less(self, scale: float, bias: float, rest: float | None) -> Array:
        """(values - bias) / scale; what does not differ from `rest` then is that."""
        found = (self.values - bias) / scale
        if rest is None:
            return found
        still = np.abs((self.resting - bias) / scale - rest) < self.error
        return np.where(still, rest, found)


def widest(values: Array, sigma: float) -> Widest:
    """Parabolas (N,) through the rows about each, over the widest window whose value agrees with
    those of all narrower ones: standstill is smoothed more than motion. sigma: of the signal's
    white noise. (Intersection of confidence intervals: Goldenshluger and Nemirovski, 1997.)
    """
    values = np.asarray(values, dtype=float)
    chosen, agree = _agreeing(values, sigma, 0)
    if len(values) < WIDTHS[-1]:
        return Widest(chosen, np.full(len(values), np.nan), 0.0)
    means = np.where(agree, savgol(values, WIDTHS[-1], 1), np.nan)
    return Widest(chosen, means, APART * sigma / WIDTHS[-1] ** 0.5)


def widest_slope(values: Array, sigma: float) -> Array:
    """The same of their slopes, per row (N,)."""
    return _agreeing(np.asarray(values, dtype=float), sigma, 1)[0]


def _agreeing(values: Array, sigma: float, derivative: int) -> tuple[Array, Array]:
    """Of each row (N,) a parabola's value or derivative over the widest window that agrees, and
    whether that is the widest of all.
    """
    chosen = np.zeros(len(values)) if derivative else values
    reach = math.inf if derivative else APART * sigma
    low, high = chosen - reach, chosen + reach
    agree = np.ones(len(values), dtype=bool)
    for width in (w for w in WIDTHS if w <= len(values)):
        tried = savgol(values, width, 2, derivative)
        of_rows = _ends(width, 2, derivative)[width // 2]
        reach = APART * sigma * float(np.sqrt((of_rows**2).sum()))
        low, high = np.maximum(low, tried - reach), np.minimum(high, tried + reach)
        agree &= low <= high
        chosen = np.where(agree, tried, chosen)
    return chosen, agree
