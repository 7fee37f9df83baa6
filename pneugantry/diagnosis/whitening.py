"""Residuals made white and robust, so that a sum of squares counts information and not
repetition.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["correlation_length", "innovations", "robust_segments"]

Array = NDArray[np.float64]
SEGMENT = 100  # samples; a segment far off (a missed break-away) counts by its logarithm only
KNEE = 4.0  # mean square of a segment from which on it does


def robust_segments(residual: Array) -> Array:
    """Columns of one log (n, channels) in segments; a segment that went astray counts by its
    logarithm only. Rows after the last whole segment are left out: below SEGMENT rows none is left.
    """
    n, channels = len(residual) // SEGMENT * SEGMENT, residual.shape[1]
    blocks = residual[:n].reshape(n // SEGMENT, SEGMENT, channels)
    square = np.mean(blocks**2, axis=1, keepdims=True)
    scale = np.where(
        square > KNEE,
        np.sqrt(KNEE * (1 + np.log(np.maximum(square, KNEE) / KNEE)) / np.maximum(square, KNEE)),
        1.0,
    )
    return np.asarray((blocks * scale).reshape(n, channels))


@njit(cache=True)
def innovations(residual: Array, drift: float, length: float) -> Array:
    """One-step prediction errors, noise 1, of white noise plus a slow error of standard deviation
    `drift` and `length` samples.
    """
    phi = np.exp(-1.0 / length)
    q = drift * drift * (1.0 - phi * phi)
    p = drift * drift
    for _ in range(200):  # stationary variance of the slow error's prediction
        p = phi * phi * p / (p + 1.0) + q
    gain, scale = p / (p + 1.0), np.sqrt(p + 1.0)
    slow = 0.0
    result = np.empty(len(residual))
    for k in range(len(residual)):
        error = residual[k] - slow
        result[k] = error / scale
        slow = phi * (slow + gain * error)
    return result


def correlation_length(residual: Array, longest: int = 2000) -> float:
    """Integrated autocorrelation time in samples, >= 1: how many samples of a residual say the
    same.
    """
    r = residual - residual.mean()
    power = float(r @ r)
    if power <= 0:
        return 1.0
    n = len(r)
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(r, size)
    correlation = np.fft.irfft(spectrum * np.conj(spectrum), size)[: min(longest, n)] / power
    negative = np.flatnonzero(correlation < 0.02)
    end = int(negative[0]) if len(negative) else len(correlation)
    return float(max(1.0, 1.0 + 2.0 * correlation[1:end].sum()))
