"""Bounded Gauss-Newton fit with priors, and the evidence of a fit by Laplace's approximation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pneugantry.engine.catalogue import Parameter

__all__ = [
    "Coordinate",
    "Fit",
    "Problem",
    "balanced",
    "both",
    "effect_coordinate",
    "fit",
    "predict",
    "tolerance_coordinate",
]

Array = NDArray[np.float64]
Columns = dict[tuple[str, str], Array]
MAX_STEPS = 6  # of a quick fit; a careful one takes twice as many
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
    effect: bool = False  # of an effect, not of tolerance
    multiplies: tuple[str, ...] = ()  # coordinates that it is an exact factor of

    def value(self, theta: float) -> float:
        raw = (
            self.neutral * math.exp(self.scale * theta)
            if self.logarithmic
            else self.neutral + self.scale * theta
        )
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
        """95 % interval of the value, within its bounds."""
        low, high = self.bounds
        ends = (
            self.value(max(theta - 1.96 * sigma, low)),
            self.value(min(theta + 1.96 * sigma, high)),
        )
        return min(ends), max(ends)


def tolerance_coordinate(name: str, nominal: float, share: float) -> Coordinate:
    """A nominal parameter that is off by `share` (RMS, relative) on any rig."""
    reach = math.exp(FARTHEST * share)
    return Coordinate(name, nominal, share, True, 1.0, nominal / reach, nominal * reach, step=0.05)


def effect_coordinate(
    p: Parameter, nominal: float | None, start: float | None = None
) -> Coordinate:
    """A parameter of an effect; `start`: a starting value, else a usual size off neutral where
    neutral is a bound.
    """
    neutral = p.neutral if nominal is None or not p.relative else nominal
    logarithmic = p.relative or p.positive
    scale = p.scale if p.relative or not p.positive else 1.0
    low, high = (p.low * neutral, p.high * neutral) if p.relative else (p.low, p.high)
    made = Coordinate(p.name, neutral, scale, logarithmic, 2.0, low, high)
    at_bound = not logarithmic and neutral in (p.low, p.high)
    theta = (
        made.theta(start * neutral if p.relative else start)
        if start is not None
        else (0.3 if at_bound else 0.0)
    )
    return Coordinate(
        p.name,
        neutral,
        scale,
        logarithmic,
        2.0,
        low,
        high,
        start=theta,
        effect=True,
        multiplies=p.multiplies,
    )


def balanced(coordinates: Sequence[Coordinate], theta: Array) -> Array:
    """The same plant with the least penalty: each factor shares out what it and the coordinates
    that it multiplies hold together.

    A fit would have to slide along such a ridge by difference quotients, whose noise stops it.
    """
    result = np.array(theta, dtype=np.float64)
    index = {c.name: i for i, c in enumerate(coordinates)}
    for factor in (
        c for c in coordinates if c.logarithmic and any(name in index for name in c.multiplies)
    ):
        members = [
            factor,
            *(coordinates[index[name]] for name in factor.multiplies if name in index),
        ]
        if not all(c.logarithmic for c in members):
            continue
        rows = [index[c.name] for c in members]
        slope = np.array(
            [(1.0 if c is factor else -1.0) / c.scale for c in members]
        )  # of theta by the logarithm that moves over
        spread = np.array([c.spread for c in members])
        moved = result[rows] - slope * (slope @ (result[rows] / spread**2)) / (
            slope @ (slope / spread**2)
        )
        if all(c.bounds[0] <= t <= c.bounds[1] for c, t in zip(members, moved, strict=True)):
            result[rows] = moved
    return result


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted hypothesis."""

    coordinates: tuple[Coordinate, ...]
    theta: Array
    covariance: Array  # of theta
    misfit: float  # sum of squares of the residual
    columns: Columns  # last Jacobian columns, by view and coordinate

    @property
    def values(self) -> dict[str, float]:
        return {c.name: c.value(t) for c, t in zip(self.coordinates, self.theta, strict=True)}

    @property
    def penalty(self) -> float:
        """What the priors charge."""
        return float(
            sum((t / c.spread) ** 2 for c, t in zip(self.coordinates, self.theta, strict=True))
        )

    def sigma(self, name: str) -> float:
        """Standard deviation of a coordinate's theta."""
        i = [c.name for c in self.coordinates].index(name)
        return math.sqrt(max(float(self.covariance[i, i]), 0.0))


def both(a: Fit, b: Fit) -> Fit:
    """Two fits that share no coordinate as one."""
    n = len(a.coordinates)
    covariance = np.zeros((n + len(b.coordinates),) * 2)
    covariance[:n, :n], covariance[n:, n:] = a.covariance, b.covariance
    theta = np.concatenate([a.theta, b.theta])
    return Fit(
        (*a.coordinates, *b.coordinates),
        theta,
        covariance,
        a.misfit + b.misfit,
        {**a.columns, **b.columns},
    )


class Problem(Protocol):
    """Residual vectors by view; a coordinate moves only the views that depend on it."""

    @property
    def views(self) -> Sequence[str]: ...
    def residual(self, view: str, values: Mapping[str, float]) -> Array: ...
    def depends(self, view: str, name: str) -> bool: ...


@dataclass(eq=False)
class _Point:
    """A point with its residuals by view."""

    theta: Array
    residuals: dict[str, Array]
    objective: float


class _Fitter:
    def __init__(self, problem: Problem, coordinates: Sequence[Coordinate]) -> None:
        self.problem, self.coordinates = problem, tuple(coordinates)
        self.spread = np.array([c.spread for c in self.coordinates])
        self.low, self.high = (np.array([c.bounds[i] for c in self.coordinates]) for i in (0, 1))
        self.seen: Columns = {}
        self.columns = {
            v: [i for i, c in enumerate(self.coordinates) if problem.depends(v, c.name)]
            for v in problem.views
        }

    def at(self, theta: Array) -> _Point:
        theta = np.clip(theta, self.low, self.high)
        values = {c.name: c.value(t) for c, t in zip(self.coordinates, theta, strict=True)}
        residuals = {v: self.problem.residual(v, values) for v in self.problem.views}
        return _Point(
            theta,
            residuals,
            sum(float(r @ r) for r in residuals.values())
            + float(np.sum((theta / self.spread) ** 2)),
        )

    def slopes(
        self, point: _Point, chord: float = 0.0, stale: Columns | None = None
    ) -> tuple[Array, Array]:
        """Gradient/2 and Gauss-Newton Hessian/2 of the objective, by differences; effects' steps
        are at least `chord`.

        `stale`: columns from elsewhere, by view and coordinate, that are good enough for a step.
        """
        n = len(self.coordinates)
        gradient, hessian = point.theta / self.spread**2, np.diag(1 / self.spread**2)
        values = {c.name: c.value(t) for c, t in zip(self.coordinates, point.theta, strict=True)}
        for view, columns in self.columns.items():
            if not columns:
                continue
            r = point.residuals[view]
            jacobian = np.empty((len(r), len(columns)))
            for k, i in enumerate(columns):
                c = self.coordinates[i]
                if stale is not None and not c.effect and (view, c.name) in stale:
                    jacobian[:, k] = stale[view, c.name]
                    continue
                step = max(c.step, chord) if c.effect else c.step
                step = step if point.theta[i] + step <= self.high[i] else -step
                moved = self.problem.residual(
                    view, {**values, c.name: c.value(point.theta[i] + step)}
                )
                jacobian[:, k] = (moved - r) / step
                self.seen[view, c.name] = jacobian[:, k].copy()
            gradient[columns] += jacobian.T @ r
            hessian[np.ix_(columns, columns)] += jacobian.T @ jacobian
        return gradient.reshape(n), hessian


def fit(
    problem: Problem,
    coordinates: Sequence[Coordinate],
    start: Array | None = None,
    stale: Columns | None = None,
    careful: bool = True,
) -> Fit:
    """Minimises the sum of squares plus prior by damped Gauss-Newton steps. Always returns the best
    point seen.

    `stale`: Jacobian columns of the tolerance that serve from the start; without them the first
    ones serve on. Where progress ends all columns are taken anew, once, in a careful fit twice; the
    columns of the effects are always new.
    """
    fitter = _Fitter(problem, coordinates)
    point = fitter.at(np.array([c.start for c in fitter.coordinates]) if start is None else start)
    if not fitter.coordinates:
        return Fit((), point.theta, np.zeros((0, 0)), point.objective, {})
    tolerance = {c.name for c in fitter.coordinates if not c.effect}
    kept = {key: column for key, column in (stale or {}).items() if key[1] in tolerance}
    gradient, hessian = fitter.slopes(point, stale=kept)
    damping, renewals = (
        1e-8,
        2 if careful else 1,
    )  # little: tolerance slides along ridges that the data leave open
    for _ in range(2 * MAX_STEPS if careful else MAX_STEPS):
        trial = fitter.at(
            point.theta
            + _bounded_step(hessian, gradient, point.theta, fitter.low, fitter.high, damping)
        )
        gain = point.objective - trial.objective
        if gain > 0:
            point, damping = trial, max(damping * 1e-2, 1e-9)
        kept = {
            key: column for key, column in {**kept, **fitter.seen}.items() if key[1] in tolerance
        }
        if gain < ENOUGH + (2e-5 if careful else 1e-3) * point.objective:
            if renewals == 0 and (gain >= 0 or damping > 1e2):
                break
            if renewals > 0:
                kept, renewals, damping = {}, renewals - 1, (1e-8 if gain > 0 else 1e-3)
            else:
                damping = max(damping * 1e3, 1e-4)
        gradient, hessian = fitter.slopes(point, stale=kept)
    misfit = point.objective - float(np.sum((point.theta / fitter.spread) ** 2))
    covariance: Array = np.asarray(np.linalg.pinv(hessian), dtype=np.float64)
    return Fit(fitter.coordinates, point.theta, covariance, misfit, {**kept, **fitter.seen})


def predict(
    problem: Problem,
    coordinates: Sequence[Coordinate],
    start: Array,
    stale: Columns | None = None,
    chord: float = 0.3,
) -> float:
    """Objective that one Gauss-Newton step from `start` promises: a score test with usual sizes as
    steps.
    """
    fitter = _Fitter(problem, coordinates)
    point = fitter.at(start)
    gradient, hessian = fitter.slopes(point, chord, stale)
    step = _bounded_step(hessian, gradient, point.theta, fitter.low, fitter.high, 1e-9)
    return float(point.objective + 2 * gradient @ step + step @ hessian @ step)


def _bounded_step(
    hessian: Array, gradient: Array, theta: Array, low: Array, high: Array, damping: float
) -> Array:
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
