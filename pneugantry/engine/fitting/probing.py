"""Points about the end of a fit, where what only large residuals tell may be better."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement

import numpy as np

from pneugantry.engine.fitting.noise import Noise
from pneugantry.engine.fitting.problem import Problem, Solution, inside
from pneugantry.engine.fitting.weighing import Weighing
from pneugantry.engine.plant import Array
from pneugantry.engine.views.simulation import Point

__all__ = ["probed"]

FARTHEST = 6.0  # prior spreads to which a point about an end may be moved
PROBES = (-30.0, -10.0, -3.0, 3.0, 10.0, 30.0)  # standard deviations
ALIKE = 0.8  # correlation from which on two coordinates are moved as one


def probed(problem: Problem, start: Solution, of_views: Noise) -> Solution | None:
    """The best of some points about a solution: each coordinate moved by some of its standard
    deviations, the others following so that the parabola hardly rises; and optima that lie side by
    side, the others kept. Tried is what only large
    residuals tell: records where these cost a view much. None where no point is better.
    """
    sim, rules, point = problem.simulation, problem.rules, start.point
    weighing = Weighing(of_views, rules)
    normal, _ = weighing.normal(point, start.residuals, start.columns)
    covariance: Array = np.asarray(np.linalg.inv(normal + problem.prior.square))
    sigma = np.sqrt(np.diag(covariance))
    spreads = np.array([c.spread for c in point.coordinates])
    farthest = np.maximum(np.abs(point.theta), FARTHEST * spreads)
    best: tuple[float, Array] | None = None
    for view in dict.fromkeys(c[0] for c in problem.cells):
        own = {
            c: r
            for c, r in start.residuals.items()
            if c[0] == view and weighing.tails({c: r}) > rules.entry
        }
        if not own:
            continue
        columns = {k: c for k, c in start.columns.items() if k[0] in own}
        curved, slope = weighing.normal(point, own, columns)
        rest = normal + problem.prior.square - curved
        read = {name for _, name in columns}
        index = [i for i, c in enumerate(point.coordinates) if c.name in read]
        moves = [k * covariance[:, i] / sigma[i] for i in _apart(covariance, index) for k in PROBES]
        moves += _side_by_side(point, index)
        moves = [m for m in moves if np.all(np.abs(point.theta + m) <= farthest)]
        tried = [inside(point.moved(point.theta + m)) for m in moves]
        found = sim.run({c: [t.values(c[1]) for t in tried] for c in own})
        before = weighing.costs(own)[view]
        for i, move in enumerate(moves):
            after = weighing.costs({c: found[c][i] for c in own})[view]
            fall = before - after - float(move @ rest @ move - 2 * slope @ move)
            if best is None or fall > best[0]:
                best = fall, move
    if best is None or best[0] < rules.entry:
        return None
    moved = inside(point.moved(point.theta + best[1]))
    residuals = sim.residuals(moved, problem.cells)
    return Solution(moved, residuals, start.columns, tangents=start.tangents)


def _apart(covariance: Array, index: Sequence[int]) -> list[int]:
    """Coordinates of which no two move each other `ALIKE` much: one stands for the others."""
    sigma = np.sqrt(np.diag(covariance))
    kept: list[int] = []
    for i in index:
        if all(abs(covariance[i, j]) < ALIKE * sigma[i] * sigma[j] for j in kept):
            kept.append(i)
    return kept


def _side_by_side(point: Point, index: Sequence[int]) -> list[Array]:
    """Moves (coordinates,) to optima that lie side by side: by a step of one coordinate, or there
    and back by steps of two that make up for each other; within bounds.
    """
    steps = [(i, point.coordinates[i].step) for i in index if point.coordinates[i].step]
    moves = []
    for (i, own), (j, other) in combinations_with_replacement(steps, 2):
        for way in (-1.0, 1.0):
            move = np.zeros(len(point.theta))
            move[j] -= way * other * (i != j)
            move[i] += way * own
            moves.append(inside(point.moved(point.theta + move)).theta - point.theta)
    return [m for m in moves if np.any(m)]
