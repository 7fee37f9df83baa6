"""A curve of a variable in an equation, and all those that were tried."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.plant import Array
from pneugantry.engine.views.simulation import Cell
from pneugantry.learn.curves.curve import Basis, Wave
from pneugantry.learn.curves.memory import Remembered
from pneugantry.learn.equations.points import Point
from pneugantry.learn.screening.linear import Base, Estimate, Response
from pneugantry.learn.screening.regressors import Regressor

__all__ = ["Candidate", "Course", "Screen"]


@dataclass(frozen=True, eq=False)
class Course:
    """A regressor over the records."""

    values: Mapping[str, Array]
    factors: Mapping[str, Array] | None  # by which its term is multiplied
    periods: Mapping[str, float] = field(default_factory=dict)  # of rows, s
    sensor: str = ""  # whose view has it, where it is not what is measured

    def shapes(self, basis: Basis | Remembered) -> dict[str, Array]:
        """Shapes (rows, coefficients) of each record."""
        if isinstance(basis, Remembered):
            found = {r: basis.walked(v, self.periods[r]) for r, v in self.values.items()}
        else:
            found = {r: basis.shapes(v) for r, v in self.values.items()}
        if isinstance(basis, Wave) and basis.phases > 1:
            found = {r: _among(s, k, basis.phases) for k, (r, s) in enumerate(found.items())}
        own = self.factors
        return found if own is None else {r: s * own[r][:, None] for r, s in found.items()}


@dataclass(frozen=True, eq=False)
class Candidate:
    """A curve of a variable in an equation."""

    point: Point
    regressor: Regressor
    basis: Basis | Remembered
    answer: Estimate  # coefficients of the curve: of the addend, or of what its factor is times
    gain: float  # of -2 log density of logs left out
    unit: float  # of the curve: the size that changes residuals by one noise level
    size: float  # of the curve's prior, in its own unit
    bend: float  # its further parameter, see `Basis.bends`
    response: Response  # without its products
    course: Course
    alike: tuple[Point, ...] = ()  # equations whose addend does the same

    @property
    def base(self) -> Base:
        """What it was tried beside."""
        return self.response.base

    @property
    def points(self) -> frozenset[Point]:
        """Equations whose addend does the same, its own one among them."""
        return frozenset((self.point, *self.alike))

    @property
    def columns(self) -> dict[Cell, Array]:
        """Of its coefficients, whitened."""
        return self.response.columns(self.course.shapes(self.basis))


@dataclass(frozen=True, eq=False)
class Screen:
    """All that was tried, the best first."""

    fit: Fit
    candidates: tuple[Candidate, ...]
    series: Mapping[Regressor, Mapping[str, Array]]  # by record
    tried: int = 0  # curves


def _among(shapes: Array, k: int, count: int) -> Array:
    """Shapes (rows, n) as the k-th of so many records' own ones."""
    n = shapes.shape[1]
    return np.pad(shapes, ((0, 0), (n * k, n * (count - 1 - k))))
