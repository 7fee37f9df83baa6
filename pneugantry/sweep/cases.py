"""The cases of a study: every combination of a grid, or the points of a Latin hypercube or Sobol
sample.
"""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import qmc

__all__ = ["Axis", "Case", "grid_cases", "sample_cases"]

Case = dict[str, Any]  # dotted name -> value


@dataclass(frozen=True)
class Axis:
    """One varied parameter of a sample: a span, or values to choose from."""

    low: float = 0.0
    high: float = 1.0
    log: bool = False
    whole: bool = False  # whole numbers, both ends included
    choices: tuple[Any, ...] = ()

    def at(self, u: float) -> Any:
        """The value at u in [0, 1)."""
        if self.choices:
            return self.choices[min(int(u * len(self.choices)), len(self.choices) - 1)]
        if self.whole:
            return min(int(self.low) + int(u * (self.high - self.low + 1)), int(self.high))
        if self.log:
            return min(
                max(math.exp(math.log(self.low) + u * math.log(self.high / self.low)), self.low),
                self.high,
            )
        return self.low + u * (self.high - self.low)


def grid_cases(values: Mapping[str, Sequence[Any]]) -> list[Case]:
    """Every combination; the last name varies fastest."""
    return [
        dict(zip(values, combination, strict=True))
        for combination in itertools.product(*values.values())
    ]


def sample_cases(method: str, axes: Mapping[str, Axis], n: int, seed: int) -> list[Case]:
    """n points in the axes' box. method: "latin_hypercube" or "sobol" (scrambled); the same seed
    gives the same points.
    """
    generator = np.random.default_rng(seed)
    kinds = {"latin_hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol}
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # Sobol's balance wants a power of two: the spec's reader says so
        points = kinds[method](len(axes), seed=generator).random(n)
    return [
        {name: axis.at(float(u)) for (name, axis), u in zip(axes.items(), point, strict=True)}
        for point in points
    ]
