"""Estimates with 95 % intervals, and straight lines through points with errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

__all__ = ["Estimate", "Line", "line", "mean", "quantile"]

Array = NDArray[np.float64]


class Estimate(NamedTuple):
    """A value with its standard deviation, and the half-width of its 95 % interval in standard
    deviations.
    """

    value: float
    sigma: float
    reach: float = 1.96

    @property
    def low(self) -> float:
        return self.value - self.reach * self.sigma

    @property
    def high(self) -> float:
        return self.value + self.reach * self.sigma


def quantile(freedom: float) -> float:
    """Half-width of a 95 % interval in standard deviations that were themselves estimated with so
    many degrees of freedom.
    """
    return float(stdtrit(freedom, 0.975)) if freedom >= 1 else math.inf


def mean(values: Sequence[float]) -> Estimate:
    """Mean of repeated tests, its interval from their scatter; infinite for a single one."""
    n = len(values)
    if n == 0:
        return Estimate(math.nan, math.nan)
    if n == 1:
        return Estimate(float(values[0]), math.inf)
    return Estimate(
        float(np.mean(values)), float(np.std(values, ddof=1)) / math.sqrt(n), quantile(n - 1)
    )


class Line(NamedTuple):
    """y = slope * x + offset; zero: the x at which y = 0. `r2`: coefficient of determination."""

    slope: Estimate
    offset: Estimate
    zero: Estimate
    r2: float


def line(x: Array, y: Array) -> Line:
    """Least-squares line with intervals from its own scatter: the calibration lines of Appendix B,
    the valve's K and u_0.

    x, y: (n,), n >= 3, in any units. Raises ValueError for fewer points or a single x.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    if len(x) < 3 or len(x) != len(y) or np.ptp(x) == 0:
        raise ValueError(
            f"a line needs at least 3 points at different x, got x = {x.tolist()} and "
            f"{len(y)} values"
        )
    design = np.column_stack([x, np.ones_like(x)])
    (slope, offset), *_ = np.linalg.lstsq(design, y, rcond=None)
    rest = y - design @ (slope, offset)
    freedom = len(x) - 2
    covariance = np.linalg.inv(design.T @ design) * float(rest @ rest) / freedom
    reach = quantile(freedom)
    zero = -offset / slope if slope else math.nan
    gradient = np.array([-zero, -1.0]) / slope if slope else np.full(2, math.nan)
    spread = float((y - y.mean()) @ (y - y.mean()))
    return Line(
        Estimate(float(slope), math.sqrt(covariance[0, 0]), reach),
        Estimate(float(offset), math.sqrt(covariance[1, 1]), reach),
        Estimate(float(zero), math.sqrt(float(gradient @ covariance @ gradient)), reach),
        1.0 - float(rest @ rest) / spread if spread else math.nan,
    )
