"""Savitzky-Golay filters (least squares of a polynomial in a moving window).

`scipy.signal.savgol_filter` fits the two ends of every signal anew, at ten times the price of the
rest; a diagnosis filters thousands of short signals.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pneugantry.engine.plant import Array

__all__ = ["savgol"]


def savgol(values: Array, window: int, degree: int, derivative: int = 0) -> Array:
    """Smoothed values or a derivative (N,), per row; the ends by the polynomials of the first and
    the last whole window. window: rows, odd; a shorter signal gets a shorter one.
    """
    width = min(window, len(values) - 1 + len(values) % 2)
    ends = _ends(width, degree, derivative)
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
