"""Residuals made white and robust, so that a sum of squares counts information and not repetition."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["correlation_length", "innovations", "robust_windows"]

Array = NDArray[np.float64]
KNEE = 4.0  # mean square of a window beyond which it counts by its logarithm only


def robust_windows(residual: Array, windows: NDArray[np.int64]) -> Array:
    """Rows of all windows, one after the other; a window that went astray (a missed break-away) counts by its logarithm only."""
    if len(windows) == 0:
        return np.zeros(0)
    rows = windows[:, 0][:, None] + np.arange(windows[0, 1] - windows[0, 0])
    block = residual[rows]
    square = np.mean(block**2, axis=1)
    scale = np.ones(len(square))
    astray = square > KNEE
    scale[astray] = np.sqrt(KNEE * (1 + np.log(square[astray] / KNEE)) / square[astray])
    return np.asarray((block * scale[:, None]).ravel())


@njit(cache=True)
def innovations(residual: Array, drift: float, length: float) -> Array:
    """One-step prediction errors, noise 1, of white noise plus a slow error of standard deviation `drift` and `length` samples."""
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
    """Integrated autocorrelation time in samples, >= 1: how many samples of a residual say the same."""
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
