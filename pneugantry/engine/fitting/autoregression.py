"""Noise of unknown colour: autoregressions that make residuals white, with the order that the data
pay for, behind the drift that a view's noise has where it adds up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyfmi_runner.first_order import first_order

__all__ = ["LONGEST", "Whitener", "drifting", "quoted", "undrifted", "whitener_of"]

Array = NDArray[np.float64]
LONGEST = (
    12  # samples; every order leaves out as many rows at a log's start, so that orders compare
)
LASTING = (16.0, 32.0, 64.0, 128.0)  # rows, of drifts that are tried
DRIFT = 0.95  # share of a drift that is taken out: what is constant stays in sight
TINY = 1e-9  # share of a process's power that is taken as white, so that its order is bounded
BISECTIONS = 12  # until a bound is met


@dataclass(frozen=True, eq=False)
class Whitener:
    """e_k = (s_k - sum coefficients_i s_{k-i}) / sigma, of s = r less most of its drift."""

    coefficients: Array
    sigma: float
    lasting: float = 0.0  # rows over which the drift is told; 0: it has none

    def __call__(self, residual: Array) -> Array:
        """Innovations of residuals (..., N), from row LONGEST on."""
        rows = residual.shape[-1]
        still = undrifted(residual, self.lasting) if self.lasting else residual
        if residual.ndim == 1 and len(self.coefficients):
            kernel = np.concatenate([[1.0], -self.coefficients])
            return np.asarray(np.convolve(still, kernel)[LONGEST:rows] / self.sigma)
        found = still[..., LONGEST:] / self.sigma
        for i, coefficient in enumerate(self.coefficients, 1):
            found -= (coefficient / self.sigma) * still[..., LONGEST - i : rows - i]
        return np.asarray(found)

    def drawn(self, innovations: Array) -> Array:
        """Noise (N,) of which these are the innovations."""
        from scipy.signal import lfilter  # costs half a second, for who quotes a model's error

        noise = lfilter([self.sigma], np.r_[1.0, -self.coefficients], innovations)
        if self.lasting:
            fade = math.exp(-1 / self.lasting)
            noise = lfilter([1.0, -fade], [1.0, -fade - DRIFT * (1 - fade)], noise)
        return np.asarray(noise)


def undrifted(residual: Array, lasting: float) -> Array:
    """Residuals (..., N) less DRIFT times m_{k-1}, the mean of the rows before, each counted less
    by the factor e for every `lasting` rows that it lies back; 0 before the first. A random walk
    under white noise of `lasting` times its step becomes white: the noise of what a view adds up.
    """
    fade, still = math.exp(-1 / lasting), np.array(residual, dtype=float, order="C")
    for place in np.ndindex(residual.shape[:-1]):
        row = still[place]
        row[1:] -= DRIFT * first_order(row[:-1], 1 - fade, fade)
    return still


def drifting(residuals: Sequence[Array], least: float) -> Whitener:
    """As `whitener_of`, of what is noise and nothing else: with the drift that it shows, if any."""
    tried = [_whitener(residuals, least, math.inf, lasting) for lasting in (0.0, *LASTING)]
    return min(tried, key=lambda found: found[1])[0]


def whitener_of(
    residuals: Sequence[Array], least: float = 1e-9, slow: float = math.inf, lasting: float = 0.0
) -> Whitener:
    """Autoregression of the order 0..LONGEST of least n log s^2 + order log n over all residuals,
    behind a drift that lasts as long as is known. `least`: bound of sigma from below. `slow`: bound
    of the noise at frequency 0, as the sigma of white noise that is as strong there: without it an
    error that hardly changes would be noise, however large.

    The mean is not taken out: a constant error is structure that an effect may explain.
    """
    return _whitener(residuals, least, slow, lasting)[0]


def _whitener(
    residuals: Sequence[Array], least: float, slow: float, lasting: float
) -> tuple[Whitener, float]:
    """As `whitener_of`; and what is least of it. A drift counts as one order more."""
    if lasting:
        residuals, slow = [undrifted(r, lasting) for r in residuals], slow * (1 - DRIFT)
    n = sum(len(r) - LONGEST for r in residuals)
    lags = np.array(
        [sum(float(r[: len(r) - k] @ r[k:]) for r in residuals) for k in range(LONGEST + 1)]
    )
    lags[0] = lags[0] * (1 + 1e-9) + 1e-300
    products = sum((_products(r) for r in residuals), np.zeros((LONGEST + 1, LONGEST + 1)))
    kernels = _bounded(_kernels(lags), lags / max(n, 1), least, slow)
    squares = np.maximum(((kernels @ products) * kernels).sum(axis=1) / n, 0.0)
    sizes = np.maximum(np.sqrt(squares), least)
    orders = np.arange(LONGEST + 1) + (lasting > 0)
    costs = n * (2 * np.log(sizes) + squares / sizes**2) + orders * math.log(n)
    best = int(np.argmin(costs))
    found = Whitener(-kernels[best, 1 : best + 1], float(sizes[best]), lasting)
    return found, float(costs[best])


def _products(residual: Array) -> Array:
    """Sums (LONGEST + 1, LONGEST + 1) of r_{k-i} r_{k-j} over the rows k from LONGEST on."""
    delayed = np.lib.stride_tricks.sliding_window_view(residual, LONGEST + 1)[:, ::-1]
    own = np.ascontiguousarray(delayed.T)
    return np.asarray(own @ own.T)


def _kernels(lags: Array) -> Array:
    """(orders, LONGEST + 1): of each order 0..LONGEST 1 and what to add of the rows before, that
    the sum is least (Levinson, Durbin); 0 beyond its order.

    lags (LONGEST + 1,): autocovariance times a factor.
    """
    made, left = np.zeros((LONGEST + 1, LONGEST + 1)), float(lags[0])
    made[:, 0] = 1.0
    for order in range(1, LONGEST + 1):
        before = made[order - 1, :order]
        share = float(before @ lags[order:0:-1]) / left
        made[order, :order] = before
        made[order, 1 : order + 1] -= share * before[::-1]
        left *= 1 - share**2
    return made


def quoted(sigma: float, error: float, rows: float) -> Whitener:
    """Of white noise `sigma` and, added to it, an error of that RMS whose correlation falls to 1/e
    within so many rows (first order). Under white noise that is larger than the error, LONGEST rows
    tell it less: it then lasts shorter.
    """
    lags = error**2 * np.exp(-np.arange(LONGEST + 1) / rows)
    lags[0] += sigma**2 + TINY * error**2
    coefficients = np.asarray(np.linalg.solve(_toeplitz(lags[:-1]), lags[1:]), dtype=float)
    return Whitener(coefficients, math.sqrt(float(lags[0] - coefficients @ lags[1:])))


def _toeplitz(lags: Array) -> Array:
    """(N, N) of autocovariances (N,)."""
    places = np.arange(len(lags))
    return np.asarray(lags[np.abs(np.subtract.outer(places, places))])


def _bounded(kernels: Array, lags: Array, least: float, slow: float) -> Array:
    """Kernels with their roots drawn inwards as far as the noise at frequency 0 needs to be `slow`.
    lags: autocovariance.
    """
    places, among = np.arange(LONGEST + 1), _toeplitz(lags)

    def held(drawn: Array) -> NDArray[np.bool_]:
        power = np.maximum(((drawn @ among) * drawn).sum(axis=1), 0.0)
        return np.asarray(np.maximum(np.sqrt(power), least) <= slow * drawn.sum(axis=1))

    wide = np.zeros(len(kernels), bool) if math.isinf(slow) else ~held(kernels)
    wide[0] = False
    if not wide.any():
        return kernels
    own, low, high = kernels[wide], np.zeros(wide.sum()), np.ones(wide.sum())
    for _ in range(BISECTIONS):
        shares = 0.5 * (low + high)
        sound = held(own * shares[:, None] ** places)
        low, high = np.where(sound, shares, low), np.where(sound, high, shares)
    found = kernels.copy()
    found[wide] = own * low[:, None] ** places
    return found
