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

__all__ = ["LONGEST", "Whitener", "whitener_of"]

Array = NDArray[np.float64]
LONGEST = (
    12  # samples; every order leaves out as many rows at a log's start, so that orders compare
)


@dataclass(frozen=True, eq=False)
class Whitener:
    """e_k = (r_k - sum coefficients_i r_{k-i}) / sigma."""

    coefficients: Array
    sigma: float

    def __call__(self, residual: Array) -> Array:
        """Innovations of a residual (N,), from row LONGEST on."""
        kernel = np.concatenate([[1.0], -self.coefficients])
        return np.asarray(np.convolve(residual, kernel)[LONGEST : len(residual)] / self.sigma)


def whitener_of(residuals: Sequence[Array], least: float = 1e-9) -> Whitener:
    """Autoregression of the order 0..LONGEST of least n log s^2 + order log n over all residuals.
    `least`: bound of sigma from below.

    The mean is not taken out: a constant error is structure that an effect may explain.
    """
    n = sum(len(r) - LONGEST for r in residuals)
    lags = np.array(
        [sum(float(r[: len(r) - k] @ r[k:]) for r in residuals) for k in range(LONGEST + 1)]
    )
    lags[0] = lags[0] * (1 + 1e-9) + 1e-300
    best, cost = Whitener(np.zeros(0), 1.0), math.inf
    for order in range(LONGEST + 1):
        tried = Whitener(
            np.asarray(solve_toeplitz(lags[:order], lags[1 : order + 1])) if order else np.zeros(0),
            1.0,
        )
        square = sum(float(e @ e) for e in map(tried, residuals)) / n
        price = n * math.log(max(square, least**2)) + order * math.log(n)
        if price < cost - 1e-9:
            best, cost = Whitener(tried.coefficients, max(math.sqrt(square), least)), price
    return best
