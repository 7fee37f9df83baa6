"""Least squares over replayed logs by Gauss-Newton steps with a kept Jacobian (chord method).

A Jacobian costs ten to forty replays of a log, a residual one. Near the answer the derivatives
hardly change, so they are taken again only where a step no longer brings the fall that was
predicted. Every log adds up its own normal equations, so no matrix of all logs is ever factorised.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pneugantry.analysis.identify.replayed import Plants, ReplayedLog

__all__ = ["Found", "Goal", "Prior", "descend"]

Array = NDArray[np.float64]
KEPT = 0.25  # share of the predicted fall that a step must bring for the Jacobian to serve on
SLOW = 0.1  # share of the predicted fall that may be predicted once more by the same Jacobian
DAMPING = 1e-3  # of the curvature's diagonal, where a step of a fresh Jacobian brings nothing
DAMPINGS = 6  # each ten times the one before
CHORDS = 8  # steps with one Jacobian, at most


@dataclass(frozen=True)
class Goal:
    """When a descent ends. The sum of squares is of residuals with noise 1: a fall of 1 is one
    standard deviation.
    """

    share: float  # of the sum of squares, by which a further step may be predicted to fall
    fall: float  # of it, in addition
    jacobians: int  # at most
    central: bool = False
    near: float = math.inf  # standard deviations from where the last Jacobian was taken, at most

    def reached(self, predicted: float, square: float) -> bool:
        return predicted <= self.share * square + self.fall


@dataclass(frozen=True, eq=False)
class Prior:
    """Of theta: centre and standard deviation; least and largest value."""

    centre: Array
    sigma: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class Found:
    """Theta, and where the logs' Jacobians were last taken."""

    theta: Array
    at: Array

    @property
    def fresh(self) -> bool:
        return self.at is self.theta


@dataclass(frozen=True, eq=False)
class _Here:
    """Sum of squares at theta, and half its gradient by a Jacobian that may be an older one."""

    theta: Array
    square: float
    gradient: Array


class _Sums:
    """Normal equations of some logs with the prior; the Jacobian is that of `at`."""

    def __init__(
        self, logs: Sequence[ReplayedLog], plants: Plants, prior: Prior, at: Array, central: bool
    ) -> None:
        self._logs, self._plants, self._prior = logs, plants, prior
        self.at, self._central = at, central
        found = plants.each(lambda log: log.curvature(at, central), logs)
        self._curvature = sum(found, np.diag(prior.sigma**-2))

    def here(self, theta: Array) -> _Here:
        found = self._plants.each(lambda log: log.slope(theta, self.at, self._central), self._logs)
        off = (theta - self._prior.centre) / self._prior.sigma
        gradient = sum((g for g, _ in found), off / self._prior.sigma)
        return _Here(theta, float(off @ off) + sum(s for _, s in found), gradient)

    def step(self, here: _Here, damping: float = 0.0) -> Array:
        """To the least sum of squares of the straight model, within the bounds."""
        low, high, gradient = self._prior.low, self._prior.high, here.gradient
        held = ((here.theta <= low) & (gradient > 0)) | ((here.theta >= high) & (gradient < 0))
        free = np.flatnonzero(~held)
        scale = np.sqrt(np.diag(self._curvature))[free]
        matrix = self._curvature[np.ix_(free, free)] / np.outer(scale, scale)
        matrix[np.diag_indices_from(matrix)] += damping
        step = np.zeros(len(gradient))
        step[free] = -np.linalg.solve(matrix, gradient[free] / scale) / scale
        return np.asarray(np.clip(here.theta + step, low, high) - here.theta)

    def predicted_fall(self, here: _Here, step: Array) -> float:
        """Fall of the sum of squares that the straight model predicts."""
        return float(-2 * here.gradient @ step - step @ self._curvature @ step)

    def between(self, theta: Array, other: Array) -> float:
        """Standard deviations between two points."""
        off = theta - other
        return math.sqrt(off @ self._curvature @ off)


def descend(
    logs: Sequence[ReplayedLog], plants: Plants, start: Found, prior: Prior, goal: Goal
) -> Found:
    """The least sum of squares over the samples that count. Raises RunError where the FMU fails."""
    found = start
    for _ in range(goal.jacobians):
        sums = _Sums(logs, plants, prior, found.at, goal.central)
        found, done = _chords(sums, found, goal)
        if done and sums.between(found.theta, found.at) <= goal.near:
            break
        found = Found(found.theta, found.theta)
    return found


def _chords(sums: _Sums, start: Found, goal: Goal) -> tuple[Found, bool]:
    """(found, whether no fall is left) by steps with one Jacobian."""
    here = sums.here(start.theta)
    for k in range(CHORDS):
        step = sums.step(here)
        predicted = sums.predicted_fall(here, step)
        if goal.reached(predicted, here.square):
            return Found(here.theta, sums.at), True
        there = sums.here(here.theta + step)
        if here.square - there.square < KEPT * predicted:
            if k == 0 and start.fresh:
                return _damped(sums, here)
            better = there if there.square < here.square else here
            return Found(better.theta, sums.at), False
        here, left = there, sums.predicted_fall(there, sums.step(there))
        if left > SLOW * predicted and not goal.reached(left, here.square):
            break
    return Found(here.theta, sums.at), False


def _damped(sums: _Sums, here: _Here) -> tuple[Found, bool]:
    """One step, damped until it brings its share; done where none does."""
    damping = DAMPING
    for _ in range(DAMPINGS):
        step = sums.step(here, damping)
        there = sums.here(here.theta + step)
        if here.square - there.square >= KEPT * sums.predicted_fall(here, step):
            return Found(there.theta, sums.at), False
        damping *= 10
    return Found(here.theta, sums.at), True
