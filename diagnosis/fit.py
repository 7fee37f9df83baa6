"""Bounded Gauss-Newton fit with priors, and the evidence of a fit by Laplace's approximation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.catalogue import Parameter

__all__ = ["Coordinate", "Fit", "effect_coordinate", "fit", "tolerance_coordinate"]

Array = NDArray[np.float64]
MAX_STEPS = 10
FARTHEST = 15.0  # standard deviations that tolerance may be off
ENOUGH = 0.5  # fall of the objective below which a fit ends


@dataclass(frozen=True)
class Coordinate:
    """A parameter as the fit sees it: theta, 0 at the neutral value, prior N(0, spread^2)."""

    name: str
    neutral: float
    scale: float  # value change, or log change, of theta = 1
    logarithmic: bool
    spread: float
    low: float
    high: float
    start: float = 0.0  # theta
    step: float = 0.02  # theta, of the difference quotient

    def value(self, theta: float) -> float:
        raw = self.neutral * math.exp(self.scale * theta) if self.logarithmic else self.neutral + self.scale * theta
        return min(max(raw, self.low), self.high)

    def theta(self, value: float) -> float:
        if self.logarithmic:
            return math.log(max(value, 1e-300) / self.neutral) / self.scale
        return (value - self.neutral) / self.scale

    @property
    def bounds(self) -> tuple[float, float]:
        """In theta."""
        if self.logarithmic:
            low = self.theta(self.low) if self.low > 0 else -40.0 / self.scale
            return low, self.theta(self.high)
        return self.theta(self.low), self.theta(self.high)

    def interval(self, theta: float, sigma: float) -> tuple[float, float]:
        """95 % interval of the value."""
        ends = (self.value(theta - 1.96 * sigma), self.value(theta + 1.96 * sigma))
        return min(ends), max(ends)


def tolerance_coordinate(name: str, nominal: float, share: float) -> Coordinate:
    """A nominal parameter that is off by `share` (RMS, relative) on any rig."""
    reach = math.exp(FARTHEST * share)
    return Coordinate(name, nominal, share, True, 1.0, nominal / reach, nominal * reach, step=0.05)


def effect_coordinate(p: Parameter, nominal: float | None, start: float | None = None) -> Coordinate:
    """A parameter of an effect; `start`: a starting value, else a usual size off neutral where neutral is a bound."""
    neutral = p.neutral if nominal is None or not p.relative else nominal
    logarithmic = p.relative or p.positive
    scale = p.scale if p.relative or not p.positive else 1.0
    made = Coordinate(p.name, neutral, scale, logarithmic, 2.0, p.low, p.high)
    at_bound = not logarithmic and neutral in (p.low, p.high)
    theta = made.theta(start) if start is not None else (0.3 if at_bound else 0.0)
    return Coordinate(p.name, neutral, scale, logarithmic, 2.0, p.low, p.high, start=theta)


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted hypothesis. `evidence` is -2 log evidence up to a constant of the data: smaller is better."""

    coordinates: tuple[Coordinate, ...]
    theta: Array
    covariance: Array  # of theta
    misfit: float  # sum of squares of the tempered residual
    evidence: float

    @property
    def values(self) -> dict[str, float]:
        return {c.name: c.value(t) for c, t in zip(self.coordinates, self.theta, strict=True)}

    @property
    def penalty(self) -> float:
        """What the priors charge."""
        return float(sum((t / c.spread) ** 2 for c, t in zip(self.coordinates, self.theta, strict=True)))

    def sigma(self, name: str) -> float:
        """Standard deviation of a coordinate's theta."""
        i = [c.name for c in self.coordinates].index(name)
        return math.sqrt(max(float(self.covariance[i, i]), 0.0))


def fit(residual: Callable[[dict[str, float]], Array], coordinates: Sequence[Coordinate], start: Array | None = None) -> Fit:
    """Minimises |residual|^2 + prior; `residual` takes values by name and gives a vector whose noise is 1.

    Derivatives by differences, kept up to date by Broyden's rule while steps succeed. Always returns the best point seen.
    """
    coordinates = tuple(coordinates)
    n = len(coordinates)
    spread = np.array([c.spread for c in coordinates])
    low, high = (np.array([c.bounds[i] for c in coordinates]) for i in (0, 1))
    theta = np.clip(np.array([c.start for c in coordinates]) if start is None else start, low, high)

    def at(point: Array) -> Array:
        return residual({c.name: c.value(t) for c, t in zip(coordinates, point, strict=True)})

    r = at(theta)
    objective = float(r @ r + np.sum((theta / spread) ** 2))
    jacobian = _differences(at, theta, r, coordinates, low, high)
    fresh, damping = True, 1e-3
    for _ in range(MAX_STEPS if n else 0):
        gradient = jacobian.T @ r + theta / spread**2
        hessian = jacobian.T @ jacobian + np.diag(1 / spread**2)
        step = _bounded_step(hessian, gradient, theta, low, high, damping)
        trial = np.clip(theta + step, low, high)
        r_trial = at(trial)
        objective_trial = float(r_trial @ r_trial + np.sum((trial / spread) ** 2))
        if objective_trial < objective:
            moved = trial - theta
            jacobian = jacobian + np.outer(r_trial - r - jacobian @ moved, moved) / max(float(moved @ moved), 1e-300)
            gain = objective - objective_trial
            theta, r, objective, damping = trial, r_trial, objective_trial, max(damping * 0.1, 1e-9)
            if gain < ENOUGH:
                if fresh:
                    break
                jacobian, fresh = _differences(at, theta, r, coordinates, low, high), True
            else:
                fresh = False
        elif not fresh:
            jacobian, fresh = _differences(at, theta, r, coordinates, low, high), True
        else:
            damping *= 30
            if damping > 1e6 or np.max(np.abs(step)) < 1e-4:
                break
    if not fresh:
        jacobian = _differences(at, theta, r, coordinates, low, high)
    hessian = jacobian.T @ jacobian + np.diag(1 / spread**2)
    _, logdet = np.linalg.slogdet(hessian * np.outer(spread, spread)) if n else (1.0, 0.0)
    covariance = np.linalg.inv(hessian) if n else np.zeros((0, 0))
    return Fit(coordinates, theta, covariance, float(r @ r), objective + float(logdet))


def _bounded_step(hessian: Array, gradient: Array, theta: Array, low: Array, high: Array, damping: float) -> Array:
    """Damped Newton step; coordinates that it would push through a bound they sit on stay."""
    free = np.ones(len(theta), dtype=bool)
    step = np.zeros(len(theta))
    for _ in range(len(theta) + 1):
        h = hessian[np.ix_(free, free)]
        step[:] = 0.0
        step[free] = -np.linalg.solve(h + damping * np.diag(np.diag(h)), gradient[free])
        stuck = free & (((theta <= low) & (step < 0)) | ((theta >= high) & (step > 0)))
        if not stuck.any():
            break
        free &= ~stuck
        if not free.any():
            return np.zeros(len(theta))
    return step


def _differences(at: Callable[[Array], Array], theta: Array, r: Array, coordinates: Sequence[Coordinate], low: Array, high: Array) -> Array:
    columns = []
    for i, c in enumerate(coordinates):
        step = c.step if theta[i] + c.step <= high[i] else -c.step
        moved = theta.copy()
        moved[i] += step
        columns.append((at(moved) - r) / step)
    return np.array(columns).T.reshape(len(r), len(coordinates))
