"""Curves of one variable, as sums of given shapes with a prior: straight between knots over the
range that the data cover, level beyond, with a jump where the variable changes its sign; or a wave
of one period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from pneugantry.engine.plant import Array
from pneugantry.engine.signals.hats import hats

__all__ = [
    "JUMP",
    "SIZES",
    "Basis",
    "FineKnots",
    "Knots",
    "Wave",
    "finer",
    "knots_over",
    "waves_of",
]

COUNT = 11
FINE = 41  # knots of a curve with narrow features
EDGE = 0.005  # share of the weight beyond each end of the covered range
JUMP = 2e-3  # share of the range over which a jump takes place
SIZES = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # prior sizes of a curve, in units that show
BENDS = (0.03, 0.3, 3.0)  # prior sizes of its bending, in units of its size
LENGTHS = (0.03, 0.1)  # over which a curve with narrow features changes, shares of the range


class Basis(Protocol):
    """Shapes whose sum is a curve."""

    @property
    def bends(self) -> tuple[float, ...]:
        """Further parameters of the prior that are tried."""
        ...

    def shapes(self, values: Array) -> Array:
        """(rows, coefficients) over values of the variable."""
        ...

    def prior(self, size: float, bend: float) -> Array:
        """Precision of the coefficients of a curve of a size."""
        ...


@dataclass(frozen=True, eq=False)
class Knots:
    """Values at knots and, where `jumps`, the half of a jump at 0."""

    at: Array  # (COUNT,), evenly over the covered range
    jumps: bool

    @property
    def bends(self) -> tuple[float, ...]:
        return BENDS

    @property
    def width(self) -> float:
        """Of a jump, in units of the variable."""
        return JUMP * float(self.at[-1] - self.at[0])

    def hats(self, values: Array) -> Array:
        """Weights (rows, COUNT) of the values at the knots."""
        return hats((values - self.at[0]) / (self.at[1] - self.at[0]), len(self.at))

    def shapes(self, values: Array) -> Array:
        hats = self.hats(values)
        if not self.jumps:
            return hats
        return np.column_stack([hats, np.tanh(values / self.width)])

    def seen(self, law_at: Array, either_side: tuple[float, float]) -> Array:
        """Coefficients of a function: its values at the knots, and just below and above 0."""
        if not self.jumps:
            return law_at
        jump = (either_side[1] - either_side[0]) / 2
        return np.append(law_at - jump * np.tanh(self.at / self.width), jump)

    @cached_property
    def _covariances(self) -> tuple[Array, Array]:
        """Of a straight line and of what bends (twice integrated white noise)."""
        x = np.linspace(0.0, 1.0, len(self.at))
        low, high = np.minimum.outer(x, x), np.maximum.outer(x, x)
        bent = low**2 * (3 * high - low) / 2
        return 1 + np.outer(2 * x - 1, 2 * x - 1), bent

    def prior(self, size: float, bend: float) -> Array:
        straight, bent = self._covariances
        covariance = size**2 * (straight + bend**2 * bent + 1e-6 * np.eye(len(self.at)))
        if self.jumps:
            covariance = np.pad(covariance, (0, 1))
            covariance[-1, -1] = size**2
        return np.asarray(np.linalg.inv(covariance))


@dataclass(frozen=True, eq=False)
class FineKnots(Knots):
    """The same with a prior of narrow features: a straight line and what is alike over a length."""

    @property
    def bends(self) -> tuple[float, ...]:
        return LENGTHS

    def prior(self, size: float, bend: float) -> Array:
        x = np.linspace(0.0, 1.0, len(self.at))
        apart = np.sqrt(3) * np.abs(np.subtract.outer(x, x)) / bend
        straight, _ = self._covariances
        covariance = size**2 * (straight + (1 + apart) * np.exp(-apart) + 1e-6 * np.eye(len(x)))
        if self.jumps:
            covariance = np.pad(covariance, (0, 1))
            covariance[-1, -1] = size**2
        return np.asarray(np.linalg.inv(covariance))


@dataclass(frozen=True)
class Wave:
    """A sine and a cosine; in each of several records of their own where it runs on between."""

    period: float  # in units of the variable
    phases: int = 1  # records with a phase of their own

    @property
    def bends(self) -> tuple[float, ...]:
        return (1.0,)

    def shapes(self, values: Array) -> Array:
        return waves_of(values, np.array([self.period]))

    def prior(self, size: float, bend: float) -> Array:
        return np.eye(2 * self.phases) / size**2


def waves_of(values: Array, periods: Array) -> Array:
    """Sines and cosines of several periods, those of one behind the other: (rows, 2 periods)."""
    phase = 2 * np.pi * values[:, None] / periods
    return np.stack([np.sin(phase), np.cos(phase)], axis=2).reshape(len(values), -1)


def knots_over(values: Array, weights: Sequence[Array]) -> Knots | None:
    """Knots over the range that some values cover under one of several weights; None: they do not
    vary.
    """
    order = np.argsort(values)
    ends = [e for w in weights if (e := _ends(values[order], w[order])) is not None]
    low, high = min((e[0] for e in ends), default=0.0), max((e[1] for e in ends), default=0.0)
    if not np.isfinite([low, high]).all() or high - low <= 1e-9 * max(abs(low), abs(high), 1e-12):
        return None
    jumps = min(-low, high) > 0.05 * (high - low)
    return Knots(np.linspace(low, high, COUNT), jumps)


def _ends(rising: Array, weights: Array) -> tuple[float, float] | None:
    """Values between which all but a small share of the weight lies; None: there is none."""
    below = np.cumsum(weights)
    if not below[-1] > 0:
        return None
    share = below / below[-1]
    low, high = np.searchsorted(share, [EDGE, 1 - EDGE])
    return float(rising[low]), float(rising[high])


def finer(knots: Knots) -> FineKnots:
    """More of them over the same range."""
    return FineKnots(np.linspace(knots.at[0], knots.at[-1], FINE), knots.jumps)
