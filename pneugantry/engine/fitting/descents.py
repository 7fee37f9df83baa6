"""Descents of several views: each by itself, then where they agree best, then all together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pneugantry.engine.fitting.cell_noise import CellNoise
from pneugantry.engine.fitting.descent import descend
from pneugantry.engine.fitting.fit import theta_in
from pneugantry.engine.fitting.noise import Noise
from pneugantry.engine.fitting.probing import probed
from pneugantry.engine.fitting.problem import (
    Parabola,
    Problem,
    Solution,
    inside,
    newton,
    predicted,
    standing,
)
from pneugantry.engine.fitting.surveys import ROUGH, End, Pace, Surveys
from pneugantry.engine.fitting.weighing import FAILED, Weighing
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.simulation import Cell, Point, Simulation

__all__ = ["Descents"]

DAMPED = (0.0, 1e-3, 1e-2, 0.1, 1.0)  # steps to the least of the views' parabolas that are tried
SIZES = (1.0, 0.25, 0.5, 1.5, 2.0, 2.5, 3.0, 4.0)  # of a start's effects, tried beside each other
SIZED = 4  # steps of an effect's size alone, at most


@dataclass(frozen=True, eq=False)
class Descents:
    """Over one plant's views and records. Arguments `known` and `cells`: what else is known of the
    coordinates, and what is fitted.
    """

    simulation: Simulation
    noise: CellNoise
    surveys: Surveys
    rules: Rules

    def by_view(
        self,
        starts: Sequence[Solution],
        known: Parabola,
        cells: Sequence[Cell],
        rivals: Sequence[Solution] = (),
        share: int = 1,
        near: bool = False,
    ) -> Solution:
        """Each view by itself, by steps that look over events, then where they agree best. rivals:
        solutions that are known; a descent far behind the first is given up, what ends hopelessly
        behind any is not surveyed. Where none is known, ends are made exact. share: of surveys, how
        much larger they are; 0: none. near: as of `ends`.
        """
        start = starts[0]
        views = [
            view
            for view in dict.fromkeys(c[0] for c in cells)
            if any(k[0][0] == view for k in start.columns)
        ]
        ends = self.surveys.ends(starts, known, cells, rivals, views, near)
        if not rivals:
            self.noise.level = self.noise.loudness([e.solution.residuals for e in ends])

        def ended(end: End) -> Solution:
            solution = end.solution
            if share > 1 or (share == 1 and end.contends):
                lowest = end.lowest if rivals else None
                solution = self.surveys.surveyed(end.problem, starts, solution, lowest, share)
            return solution if rivals else self.finely(end.problem, solution)

        return self.agreed(start, self.simulation.side_by_side(ended, ends), known, cells)

    def finely(self, problem: Problem, end: Solution) -> Solution:
        """A view's end, along the valleys that columns which look over events do not show."""
        start = self.with_columns(end, problem.prior, problem.cells)
        return descend(replace(problem, fine=True), start, None, ROUGH)

    def agreed(
        self, start: Solution, ends: Sequence[Solution], known: Parabola, cells: Sequence[Cell]
    ) -> Solution:
        """The best of some points between the ends of single views: each coordinate as the view has
        it that knows it best, and steps from there towards the least of the sum of the parabolas.
        The whole step may follow valleys of several views beyond where these are straight.
        """
        total, columns, tangents = known, dict(start.columns), dict(start.tangents)
        at, most = start.point.theta.copy(), np.zeros(len(known.names))
        for end in ends:
            parabola = self.parabola(end, self.noise.coloured(end.residuals)).among(known.names)
            sure = np.diag(parabola.square)
            at = np.where(sure > most, end.point.theta, at)
            most = np.maximum(sure, most)
            total = total.plus(parabola)
            columns |= end.columns
            tangents |= end.tangents
        between = start.point.moved(at)
        slope, scale = total.square @ at - total.pull, np.diag(np.diag(total.square))
        points = [between, *(newton(between, total.square + d * scale, slope) for d in DAMPED)]
        problem = self.surveys.problem(cells, known)
        best = self.surveys.ranked(problem, points, cells)[0]
        if standing(problem, best) >= FAILED:
            return start
        return Solution(best.point, best.residuals, columns, tangents=tangents)

    def jointly(
        self, start: Solution, known: Parabola, cells: Sequence[Cell], bar: float = math.inf
    ) -> Solution:
        """All views together, from new columns on; given up where that stays behind a bar."""
        if start.settled:
            return start
        return self.descended(self.with_columns(start, known, cells), known, cells, bar)

    def polished(self, start: Solution, known: Parabola, cells: Sequence[Cell]) -> Solution:
        """Jointly, and again from the best point about where that ends, until none is better.

        An event that a simulation misses (a break-away) shows in no derivative.
        """
        solution = self.jointly(start, known, cells)
        for _ in range(self.rules.turns):
            colour = self.noise.coloured(solution.residuals)
            turned = probed(self.surveys.problem(cells, known), solution, colour)
            if turned is None:
                break
            turned = self.descended(turned, known, cells)
            fall = self.cost(solution, known, colour) - self.cost(turned, known, colour)
            if fall > 0:
                solution = turned
            if fall < self.rules.entry:
                break
        return solution

    def descended(
        self, start: Solution, known: Parabola, cells: Sequence[Cell], bar: float = math.inf
    ) -> Solution:
        """All views together, under the colour that their residuals have; bar: as of `jointly`."""
        problem, solution = self.surveys.problem(cells, known), start
        for fall in (ROUGH, self.rules.converged):
            before, pace = solution.point, Pace(problem, bar)
            colour = self.noise.coloured(solution.residuals)
            solution = descend(problem, solution, colour, fall, pace.behind)
            if solution.point is before or pace.over:
                break
        return solution

    def renewed(
        self, start: Solution, known: Parabola, cells: Sequence[Cell], times: int
    ) -> Solution:
        """Converged with columns of where it is, on which score tests and the covariance rest; the
        noise's colour follows. times: at most.
        """
        if start.settled:
            return start
        solution = self.with_columns(start, known, cells)
        for _ in range(times):
            colour, at = self.noise.coloured(solution.residuals), solution
            solution = descend(self.surveys.problem(cells, known), at, colour, self.rules.converged)
            if solution.point is at.point:
                return replace(solution, settled=True)
            solution = self.with_columns(solution, known, cells)
            before, after = (self.cost(s, known, colour) for s in (at, solution))
            if before - after < self.rules.entry:
                break
        return solution

    def with_columns(self, at: Solution, known: Parabola, cells: Sequence[Cell]) -> Solution:
        """With columns by small steps in some cells. Those serve on that predict from where they
        were made what is there, to less than what all cells together may miss of a fall.
        """
        least = self.rules.converged / len(cells)
        old = [c for c in cells if not self._missed(at, c) < least]
        columns = self.simulation.columns(at.point, at.residuals, old, set(known.names))
        return at.with_columns(columns, old, fine=True)

    def _missed(self, at: Solution, cell: Cell) -> float:
        """By how much the columns of a cell miss what is there, squared in noise levels."""
        tangent = at.tangents.get(cell)
        own = [c for c in at.point.coordinates if self.simulation.in_cell(c, cell)]
        if tangent is None or any((cell, c.name) not in at.columns for c in own):
            return math.inf
        moved = at.point.theta - theta_in(tangent.point, at.point.coordinates)
        there = replace(at, residuals={cell: tangent.residual})
        missed = at.residuals[cell] - predicted(there, [cell], moved)[cell]
        colour = self.noise.colour(cell, at.residuals[cell])
        white = np.concatenate([w(missed[:, i]) for i, w in enumerate(colour)])
        return float(white @ white)

    def sized(self, start: Point, known: Parabola, cells: Sequence[Cell]) -> Point:
        """Effects, and what is of one record, fitted beside tolerance as it is, from the best of
        some sizes: free to move, that would make up for an effect of which the size is not known
        yet, and where events come and go with the size no slope tells it.
        """
        start = self._of_best_size(start, known, cells)
        free = [i for i, c in enumerate(start.coordinates) if c.effect or c.record is not None]
        own = tuple(start.coordinates[i] for i in free)
        point = Point(own, start.theta[free], start.values(None))
        names = {c.name for c in own}
        problem = self.surveys.problem(cells, known.of(names, start.theta), fine=False)
        found = self.simulation.linearised(point, cells, names, fine=False)
        end = descend(
            problem, Solution(point, *found), None, ROUGH, lambda steps, at: steps >= SIZED
        )
        theta = start.theta.copy()
        theta[free] = end.point.theta
        return start.moved(theta)

    def _of_best_size(self, start: Point, known: Parabola, cells: Sequence[Cell]) -> Point:
        """A start with its effects at that one of some sizes at which it stands best."""
        pairs = zip(start.coordinates, start.theta, strict=True)
        none = np.array([c.none if c.effect else t for c, t in pairs])
        if np.array_equal(none, start.theta):
            return start
        points = [inside(start.moved(none + size * (start.theta - none))) for size in SIZES]
        problem = self.surveys.problem(cells, known, fine=False)
        return self.surveys.ranked(problem, points, cells)[0].point

    def parabola(self, solution: Solution, of_views: Noise) -> Parabola:
        """-2 log likelihood of some cells about where a descent ended."""
        normal, gradient = Weighing(of_views, self.rules).normal(
            solution.point, solution.residuals, solution.columns
        )
        moved = [c.name for c in solution.point.coordinates]
        index = [i for i, n in enumerate(moved) if normal[i, i] > 0]
        square = normal[np.ix_(index, index)]
        pull = square @ solution.point.theta[index] - gradient[index]
        return Parabola(tuple(moved[i] for i in index), square, pull)

    def cost(self, solution: Solution, known: Parabola, colour: Noise) -> float:
        """-2 log posterior of all cells of a solution under a colour of the noise."""
        costs = Weighing(colour, self.rules).costs(solution.residuals)
        return sum(costs.values()) + known.cost(solution.point.theta)
