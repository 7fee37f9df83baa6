"""Noise of unknown colour: autoregressions that make residuals white, with the order that the data
pay for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz

__all__ = ["LONGEST", "Whitener", "quoted", "whitener_of"]

Array = NDArray[np.float64]
LONGEST = (
    12  # samples; every order leaves out as many rows at a log's start, so that orders compare
)
TINY = 1e-9  # share of a process's power that is taken as white, so that its order is bounded
BISECTIONS = 12  # until a bound is met


@dataclass(frozen=True, eq=False)
class Whitener:
    """e_k = (r_k - sum coefficients_i r_{k-i}) / sigma."""

    coefficients: Array
    sigma: float

    def __call__(self, residual: Array) -> Array:
        """Innovations of a residual (N,), from row LONGEST on."""
        kernel = np.concatenate([[1.0], -self.coefficients])
        return np.asarray(np.convolve(residual, kernel)[LONGEST : len(residual)] / self.sigma)

    def drawn(self, innovations: Array) -> Array:
        """Noise (N,) of which these are the innovations."""
        from scipy.signal import lfilter  # costs half a second, for who quotes a model's error

        return np.asarray(lfilter([self.sigma], np.r_[1.0, -self.coefficients], innovations))


def whitener_of(
    residuals: Sequence[Array], least: float = 1e-9, slow: float = math.inf
) -> Whitener:
    """Autoregression of the order 0..LONGEST of least n log s^2 + order log n over all residuals.
    `least`: bound of sigma from below. `slow`: bound of the noise at frequency 0, as the sigma of
    white noise that is as strong there: without it an error that hardly changes would be noise,
    however large.

    The mean is not taken out: a constant error is structure that an effect may explain.
    """
    n = sum(len(r) - LONGEST for r in residuals)
    lags = np.array(
        [sum(float(r[: len(r) - k] @ r[k:]) for r in residuals) for k in range(LONGEST + 1)]
    )
    lags[0] = lags[0] * (1 + 1e-9) + 1e-300
    best, cost = Whitener(np.zeros(0), 1.0), math.inf
    for order in range(LONGEST + 1):
        raw = solve_toeplitz(lags[:order], lags[1 : order + 1]) if order else np.zeros(0)
        tried = Whitener(_bounded(np.asarray(raw), lags / max(n, 1), least, slow), 1.0)
        square = sum(float(e @ e) for e in map(tried, residuals)) / n
        size = max(math.sqrt(square), least)
        price = n * (2 * math.log(size) + square / size**2) + order * math.log(n)
        if price < cost - 1e-9:
            best, cost = Whitener(tried.coefficients, size), price
    return best


def quoted(sigma: float, error: float, rows: float) -> Whitener:
    """Of white noise `sigma` and, added to it, an error of that RMS whose correlation falls to 1/e
    within so many rows (first order). Under white noise that is larger than the error, LONGEST rows
    tell it less: it then lasts shorter.
    """
    lags = error**2 * np.exp(-np.arange(LONGEST + 1) / rows)
    lags[0] += sigma**2 + TINY * error**2
    coefficients = np.asarray(solve_toeplitz(lags[:-1], lags[1:]))
    return Whitener(coefficients, math.sqrt(float(lags[0] - coefficients @ lags[1:])))


def _bounded(coefficients: Array, lags: Array, least: float, slow: float) -> Array:
    """Coefficients with their roots drawn inwards as far as the noise at frequency 0 needs to be
    `slow`. lags: autocovariance.
    """
    order = len(coefficients)
    among = lags[np.abs(np.subtract.outer(np.arange(order + 1), np.arange(order + 1)))]

    def held(share: float) -> tuple[Array, bool]:
        drawn = coefficients * share ** np.arange(1, order + 1)
        kernel = np.concatenate([[1.0], -drawn])
        sigma = max(math.sqrt(max(float(kernel @ among @ kernel), 0.0)), least)
        return drawn, sigma <= slow * float(kernel.sum())

    if order == 0 or math.isinf(slow) or held(1.0)[1]:
        return coefficients
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        share = 0.5 * (low + high)
        low, high = (share, high) if held(share)[1] else (low, share)
    return held(low)[0]
