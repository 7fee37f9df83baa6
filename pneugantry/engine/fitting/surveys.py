"""Views by themselves: descents by steps that look over events, races between them, and surveys of
points where a view stands above its noise.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from pneugantry.engine.fitting import noise
from pneugantry.engine.fitting.cell_noise import CellNoise
from pneugantry.engine.fitting.descent import descend
from pneugantry.engine.fitting.problem import Parabola, Problem, Solution, inside, standing
from pneugantry.engine.fitting.weighing import LARGE
from pneugantry.engine.hypotheses.hypothesis import Coordinate
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.simulation import Cell, Point, Simulation

__all__ = ["ROUGH", "End", "Pace", "Surveys", "in_view"]

SIZES = (2.0, 5.0, 10.0)  # of a survey's points, in prior spreads of tolerance
BESIDE = 0.4  # share of these sizes beside an effect, which takes the rest
WINNOWED = 8  # of a survey's points one is simulated over all records
ROUGH = 8.0  # fall of -2 log posterior that ends a descent of which another follows


@dataclass(frozen=True, eq=False)
class End:
    """Where a view by itself came to."""

    problem: Problem
    solution: Solution
    lowest: float  # of what is known there, too
    contends: bool  # with what is known


class Pace:
    """How a descent falls towards a bar, by `standing`."""

    def __init__(self, problem: Problem, bar: float, own: bool = False) -> None:
        """own: whether the descent goes by this measure. By another one a step may raise it, and
        after one that led nowhere columns are made anew: neither tells then.
        """
        self.problem, self.bar, self.own = problem, bar, own
        self.last, self.over = math.inf, False

    def behind(self, steps: int, solution: Solution) -> bool:
        """Whether it is farther above the bar than `patience` falls like its last."""
        if self.bar == math.inf:
            return False
        before, self.last = self.last, standing(self.problem, solution)
        fall = before - self.last
        if self.own or fall > 0:
            self.over = steps > 1 and self.last - self.bar > self.problem.rules.patience * fall
        return self.over


class Surveys:
    """Fits of single views, and surveys of points where one stands above its noise."""

    def __init__(self, simulation: Simulation, noise_of: CellNoise, rules: Rules) -> None:
        self.simulation, self.noise, self.rules = simulation, noise_of, rules

    def problem(self, cells: Collection[Cell], known: Parabola, fine: bool = True) -> Problem:
        return Problem(self.simulation, self.rules, tuple(cells), known, fine)

    def ends(
        self,
        starts: Sequence[Solution],
        known: Parabola,
        cells: Sequence[Cell],
        rivals: Sequence[Solution],
        views: Sequence[str],
        near: bool = False,
    ) -> list[End]:
        """Of each view by itself the least that a descent from a start comes to. All views descend
        from the first at once, then from the others, which race what that came to. near: a descent
        has to come near all rivals, not only the first.
        """
        problems = {
            v: self.problem([c for c in cells if c[0] == v], known, fine=False) for v in views
        }
        bars = {v: [standing(p, in_view(r, v)) for r in rivals] for v, p in problems.items()}

        def down(task: tuple[str, Solution, float]) -> tuple[float, Solution]:
            view, start, bar = task
            end = self.raced(problems[view], in_view(start, view), bar)
            return standing(problems[view], end), end

        base = {v: own[0] if own else math.inf for v, own in bars.items()}
        if near:
            base = {v: min(b, min(bars[v]) + self.rules.hopeless) for v, b in base.items()}
        tasks = [(v, starts[0], base[v]) for v in views]
        first = dict(zip(views, self.simulation.side_by_side(down, tasks), strict=True))
        tasks = [(v, s, min(base[v], first[v][0])) for v in views for s in starts[1:]]
        others = self.simulation.side_by_side(down, tasks)
        found = []
        for v in views:
            own = [first[v], *(end for t, end in zip(tasks, others, strict=True) if t[0] == v)]
            least, solution = min(own, key=lambda e: e[0])
            contends = least - min(bars[v], default=math.inf) < self.rules.hopeless
            found.append(End(problems[v], solution, min(base[v], least), contends))
        return found

    def raced(self, problem: Problem, start: Solution, bar: float) -> Solution:
        """A view's descent by steps that look over events, given up where it is behind (`Pace`)."""
        pace = Pace(problem, bar, own=True)
        return descend(problem, start, None, ROUGH, pace.behind)

    def surveyed(
        self,
        problem: Problem,
        starts: Sequence[Solution],
        found: Solution,
        bar: float | None,
        share: int = 1,
    ) -> Solution:
        """The least of a view's descents: found, and those from the best of many points, where it
        stands above the noise: stick-slip has many optima. Points are tried in parts: once a
        descent from afar comes to the same end, there is but one. Where something is known already
        (a bar), the record that is met worst tells, by itself, which descents are worth the others.
        """
        best, least = found, standing(problem, found)
        if not self.rules.followed or self.quiet(problem, found):
            return best
        worst = self.simulation.worst_met(problem.cells, starts[0].residuals)
        alone = self.problem([worst], problem.prior, fine=False)
        near = math.inf
        if bar is not None and len(problem.cells) > 1:
            near = standing(alone, self.raced(alone, _in_cell(found, worst), math.inf))
        for points in self._scattered(problem, starts, share):
            start = self._foremost(problem, points, worst).point
            if near < math.inf:
                there = self.raced(alone, self.coarsely(alone, start), near)
                ahead = near - standing(alone, there)
                if abs(ahead) < ROUGH:
                    break
                if ahead < 0:
                    continue
                start = there.point
            lowest = least if bar is None else min(bar, least)
            other = self.raced(problem, self.coarsely(problem, start), lowest)
            before, cost = least, standing(problem, other)
            if cost < least:
                best, least = other, cost
            if abs(cost - before) < ROUGH:
                break
        return best

    def coarsely(self, problem: Problem, point: Point) -> Solution:
        """A point with residuals, and columns that look over events."""
        names = set(problem.prior.names)
        found = self.simulation.linearised(point, problem.cells, names, fine=False)
        return Solution(point, *found)

    def _scattered(
        self, problem: Problem, starts: Sequence[Solution], share: int
    ) -> list[list[Point]]:
        """Points drawn over a view's tolerance, and over effects about where they start, in as many
        parts as are to be followed.
        """
        count, draw = share * self.rules.survey, np.random.default_rng(0)
        among = [(i, c) for i, c in enumerate(starts[0].point.coordinates) if self._in(c, problem)]
        tolerance, effects = [i for i, c in among if c.scales], [i for i, c in among if c.effect]
        theta = np.array([starts[k % len(starts)].point.theta for k in range(count)])
        size = np.resize(np.array(SIZES), count)[:, None] * (BESIDE if effects else 1.0)
        theta[:, tolerance] = size * draw.standard_normal((count, len(tolerance)))
        theta[:, effects] += draw.standard_normal((count, len(effects)))
        points = [inside(starts[0].point.moved(t)) for t in theta]
        parts = np.array_split(np.arange(count), share * self.rules.followed)
        return [[points[i] for i in part] for part in parts]

    def _foremost(self, problem: Problem, points: Sequence[Point], worst: Cell) -> Solution:
        """The best of some points, without columns. One cell tells which of them are simulated in
        the others.
        """
        few = self.ranked(problem, points, [worst])[: max(len(points) // WINNOWED, 1)]
        return self.ranked(problem, [s.point for s in few], problem.cells)[0]

    def ranked(
        self, problem: Problem, points: Sequence[Point], cells: Sequence[Cell]
    ) -> list[Solution]:
        """Points by how they stand in some cells, the best first; without columns."""
        runs = self.simulation.run({c: [p.values(c[1]) for p in points] for c in cells})
        made = [
            Solution(point, {c: own[i] for c, own in runs.items()}, {})
            for i, point in enumerate(points)
        ]
        return sorted(made, key=lambda s: standing(problem, s))

    def quiet(self, problem: Problem, found: Solution) -> bool:
        """Whether a view's residuals are no more than the sensors' noise, in each record and in
        all, or nothing that is off by a share or an effect's moves them.
        """
        if not any(c.scales or c.effect for c in found.point.coordinates if self._in(c, problem)):
            return True
        white = self.noise.white(found.residuals, {c: self.noise.floor(c) for c in problem.cells})
        signals = [[w for (_, k), w in white.items() if k == c] for c in {k for _, k in white}]
        usual, rules = max(self.noise.usual(c) for c in problem.cells), self.rules
        most = rules.quiet * usual
        return not any(
            noise.surely_above(most, rows, rules.doubt)
            for rows in (*signals, *([w] for w in white.values()))
        ) and all(
            noise.loss(w[np.abs(w) > LARGE] / usual, rules.tails).sum() < rules.hopeless
            for w in white.values()
        )

    def _in(self, c: Coordinate, problem: Problem) -> bool:
        return any(self.simulation.in_cell(c, cell) for cell in problem.cells)


def in_view(solution: Solution, view: str) -> Solution:
    """The part of one view."""
    return Solution(
        solution.point,
        {c: r for c, r in solution.residuals.items() if c[0] == view},
        {k: c for k, c in solution.columns.items() if k[0][0] == view},
        tangents={c: t for c, t in solution.tangents.items() if c[0] == view},
    )


def _in_cell(solution: Solution, cell: Cell) -> Solution:
    """The part of one cell."""
    columns = {k: c for k, c in solution.columns.items() if k[0] == cell}
    return Solution(solution.point, {cell: solution.residuals[cell]}, columns)
