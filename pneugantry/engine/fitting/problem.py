"""What is fitted, and where a descent stands."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pneugantry.engine.fitting.weighing import FAILED, Weighing, flat_noise
from pneugantry.engine.hypotheses.hypothesis import Coordinate
from pneugantry.engine.plant import Array
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.simulation import Cell, Columns, Point, Residuals, Simulation

__all__ = [
    "Parabola",
    "Problem",
    "Solution",
    "Tangent",
    "inside",
    "newton",
    "predicted",
    "prior",
    "standing",
]


@dataclass(frozen=True, eq=False)
class Parabola:
    """A cost near its least, theta' square theta - 2 pull' theta + a constant, of the coordinates
    named.
    """

    names: tuple[str, ...]
    square: Array
    pull: Array

    def among(self, names: Sequence[str]) -> Parabola:
        """The same over other coordinates, these among them."""
        square, pull = np.zeros((len(names), len(names))), np.zeros(len(names))
        index = [names.index(n) for n in self.names]
        square[np.ix_(index, index)] = self.square
        pull[index] = self.pull
        return Parabola(tuple(names), square, pull)

    def plus(self, other: Parabola) -> Parabola:
        added = other.among(self.names)
        return Parabola(self.names, self.square + added.square, self.pull + added.pull)

    def of(self, free: Collection[str], theta: Array) -> Parabola:
        """The same over some coordinates, the others kept at theta."""
        own = np.array([n in free for n in self.names])
        names = tuple(n for n in self.names if n in free)
        pull = self.pull[own] - self.square[np.ix_(own, ~own)] @ theta[~own]
        return Parabola(names, self.square[np.ix_(own, own)], pull)

    def cost(self, theta: Array) -> float:
        return float(theta @ self.square @ theta - 2 * self.pull @ theta)

    def least(self) -> Array:
        return np.asarray(np.linalg.solve(self.square, self.pull))


@dataclass(frozen=True, eq=False)
class Problem:
    """What is fitted, to which cells; `prior`: what else is known of the coordinates."""

    simulation: Simulation
    rules: Rules
    cells: tuple[Cell, ...]
    prior: Parabola
    fine: bool = True  # columns by small steps: exact between events; else they look over them


@dataclass(frozen=True, eq=False)
class Tangent:
    """Where the columns of a cell were made, by small steps."""

    point: Point
    residual: Array


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a descent stands; residuals and columns of all cells, those that it leaves included."""

    point: Point
    residuals: Residuals
    columns: Columns
    settled: bool = False  # no step from this point led down, under columns that predict it
    tangents: Mapping[Cell, Tangent] = field(default_factory=dict)  # none: not by small steps

    def with_columns(self, made: Columns, cells: Collection[Cell], fine: bool) -> Solution:
        """The same with columns of this point in some cells. fine: by small steps."""
        tangents = {c: t for c, t in self.tangents.items() if c not in cells}
        if fine:
            tangents |= {c: Tangent(self.point, self.residuals[c]) for c in cells}
        return Solution(self.point, self.residuals, {**self.columns, **made}, tangents=tangents)

    def elsewhere(self, cells: Collection[Cell]) -> set[str]:
        """Views with columns of other points."""
        theta, own = self.point.theta, {c: t for c, t in self.tangents.items() if c in cells}
        return {c[0] for c, t in own.items() if not np.array_equal(t.point.theta, theta)}


def standing(problem: Problem, solution: Solution) -> float:
    """-2 log posterior under white noise of the residuals' own size."""
    residuals = {c: solution.residuals[c] for c in problem.cells if c in solution.residuals}
    if not all(np.isfinite(r).all() for r in residuals.values()):
        return FAILED
    flat = flat_noise(problem.simulation, residuals)
    cost = sum(Weighing(flat, problem.rules).costs(residuals).values())
    cost += sum(2 * len(r) * math.log(w.sigma) for cell, r in residuals.items() for w in flat[cell])
    return cost + problem.prior.cost(solution.point.theta)


def prior(coordinates: Sequence[Coordinate]) -> Parabola:
    """-2 log prior."""
    precision = np.array([c.spread for c in coordinates]) ** -2.0
    names = tuple(c.name for c in coordinates)
    return Parabola(names, np.diag(precision), np.zeros(len(names)))


def inside(point: Point) -> Point:
    """A point with what lies beyond its bounds brought back to them."""
    theta = point.theta.copy()
    for i, c in enumerate(point.coordinates):
        if not c.logarithmic or c.low > 0:
            value = c.value(theta[i])
            if value in (c.low, c.high):
                theta[i] = c.theta(value)
    return point.moved(theta)


def predicted(state: Solution, cells: Sequence[Cell], made: Array) -> Residuals:
    """Residuals of some cells after a step, as their columns tell."""
    found = {c: state.residuals[c].copy() for c in cells}
    for c, step in zip(state.point.coordinates, made, strict=True):
        for cell in cells:
            if (cell, c.name) in state.columns:
                found[cell] += step * state.columns[cell, c.name]
    return found


def newton(point: Point, square: Array, slope: Array) -> Point:
    """Where a slope ends; what would pass a bound stops at it, and the rest goes on as it tells."""
    step, free = np.zeros(len(slope)), np.full(len(slope), True)
    while True:
        pull = slope[free] + square[np.ix_(free, ~free)] @ step[~free]
        step[free] = -_solved(square[np.ix_(free, free)], pull)
        wanted = point.theta + step
        reached = inside(point.moved(wanted))
        stopped = free & (reached.theta != wanted)
        if not stopped.any():
            return reached
        step[stopped] = (reached.theta - point.theta)[stopped]
        free &= ~stopped


def _solved(square: Array, pull: Array) -> Array:
    """The least step where columns of very different size leave no other."""
    try:
        return np.asarray(np.linalg.solve(square, pull))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(square, pull)[0])
