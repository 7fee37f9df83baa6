"""Curves of one variable: straight between knots over the range that the data cover, level beyond;
smooth as far as the evidence says.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pneugantry.engine.plant import Array

__all__ = ["Knots", "knots_over"]

COUNT = 9
EDGE = 0.005  # share of the rows beyond each end of the covered range
SIZES = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # prior sizes of a curve, in units that show
BENDS = (0.03, 0.3, 3.0)  # prior sizes of its bending, in units of its size


@dataclass(frozen=True, eq=False)
class Knots:
    """Where a curve is defined."""

    at: Array  # (COUNT,), evenly over the covered range

    def hats(self, values: Array) -> Array:
        """Weights (rows, COUNT) of the curve's values at the knots."""
        step = self.at[1] - self.at[0]
        place = np.clip((values - self.at[0]) / step, 0.0, len(self.at) - 1.0)
        return np.asarray(np.maximum(1 - np.abs(place[:, None] - np.arange(len(self.at))), 0.0))

    @cached_property
    def _shapes(self) -> tuple[Array, Array]:
        """Covariances of a straight line and of what bends (twice integrated white noise)."""
        x = np.linspace(0.0, 1.0, len(self.at))
        low, high = np.minimum.outer(x, x), np.maximum.outer(x, x)
        bent = low**2 * (3 * high - low) / 2
        return 1 + np.outer(2 * x - 1, 2 * x - 1), bent

    def prior(self, size: float, bend: float) -> Array:
        """Precision of the values at the knots."""
        straight, bent = self._shapes
        covariance = size**2 * (straight + bend**2 * bent + 1e-6 * np.eye(len(self.at)))
        return np.asarray(np.linalg.inv(covariance))


def knots_over(values: Array, count: int = COUNT) -> Knots | None:
    """Knots over the range that some values cover; None: they do not vary."""
    low, high = np.quantile(values, (EDGE, 1 - EDGE))
    if not np.isfinite([low, high]).all() or high - low <= 1e-9 * max(abs(low), abs(high), 1e-12):
        return None
    return Knots(np.linspace(low, high, count))
