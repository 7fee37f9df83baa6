"""A descent along a valley, on residuals that a solver's jumps roughen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np

from pneugantry.engine.fitting.descent import _Ahead, _along_valley, descend
from pneugantry.engine.fitting.noise import Whitener
from pneugantry.engine.fitting.problem import Problem, Solution, Tangent, newton, prior
from pneugantry.engine.fitting.weighing import Weighing
from pneugantry.engine.hypotheses.hypothesis import Coordinate
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.simulation import Cell, Point, Simulation
from pneugantry.engine.views.view import View

NAMES = ("a", "b", "c")
CELLS: tuple[Cell, ...] = (("view", "rough"), ("view", "smooth"))
ROWS, JUMP, OFTEN = 400, 1e-5, 3e6
WEAK = 1e-3  # what the smooth record shows, of the rough one


class Rough(Simulation):
    """Two records of a linear model, whose parameters a and b move them almost alike; one says
    little.
    """

    def __init__(self, bent: float = 0.0) -> None:
        records = [cast(Record, SimpleNamespace(name=c[1], rows=ROWS, period=1e-3)) for c in CELLS]
        super().__init__([], records, Rules())
        self.jump, self.bent, self.ran = JUMP, bent, list[Cell]()
        draw = np.random.default_rng(5)
        a, b, c = draw.standard_normal((3, ROWS))
        self.slopes = 300 * np.stack([a, a + 1e-3 * b, c])
        self.pattern = c  # a column that errs by it tilts the valley towards another parameter
        self.noise = {cell: 0.5 * draw.standard_normal(ROWS) for cell in CELLS}

    def simulated(
        self, jobs: Mapping[Cell, Sequence[Mapping[str, float]]]
    ) -> dict[Cell, list[Array]]:
        self.ran += [cell for cell, own in jobs.items() for _ in own]
        return {cell: [self.residual(cell, p) for p in own] for cell, own in jobs.items()}

    def residual(self, cell: Cell, values: Mapping[str, float]) -> Array:
        theta, rough = np.array([values[n] for n in NAMES]), cell == CELLS[0]
        found = (1.0 if rough else WEAK) * theta @ self.slopes + self.noise[cell]
        if rough:
            found = found + self.jump * np.sin(OFTEN * theta[0]) * self.pattern
            found = found + self.bent * abs(theta[0] - 2.0) * self.pattern
        return np.asarray(found[:, None])

    def in_cell(self, c: Coordinate, cell: Cell) -> bool:
        return True

    def step(self, c: Coordinate, theta: float, fine: bool) -> float:
        return self.rules.difference * self.rules.fine


def problem_of(sim: Rough) -> tuple[Problem, Solution, Weighing]:
    """Far off along the valley."""
    coordinates = tuple(Coordinate(n, 0.0, 1.0, spread=3.0) for n in NAMES)
    problem = Problem(sim, sim.rules, CELLS, prior(coordinates))
    point = Point(coordinates, np.array([2.0, -2.0, 0.0]), {})
    residuals = sim.residuals(point, CELLS)
    columns = sim.columns(point, residuals, CELLS, set(NAMES))
    weighing = Weighing({c: (Whitener(np.zeros(0), 0.5),) for c in CELLS}, sim.rules)
    return problem, Solution(point, residuals, columns), weighing


def test_a_valley_is_followed_though_jumps_spoil_its_columns() -> None:
    sim = Rough()
    problem, start, weighing = problem_of(sim)
    wrong = start.columns[CELLS[0], "a"][:, 0] - sim.slopes[0]
    assert np.linalg.norm(wrong) > 5 * np.linalg.norm(sim.slopes[1] - sim.slopes[0])
    end = descend(problem, start, weighing.noise, 0.01)
    both = np.hstack([sim.slopes, WEAK * sim.slopes]) / 0.5
    exact = -np.linalg.solve(
        both @ both.T + np.eye(3) / 9, both @ np.concatenate([*sim.noise.values()]) / 0.5
    )
    np.testing.assert_allclose(end.point.theta, exact, atol=0.05)


def test_only_what_misses_is_made_anew() -> None:
    sim = Rough()
    problem, start, weighing = problem_of(sim)
    sim.ran.clear()
    renewed = _along_valley(_Ahead(problem, start, weighing))
    assert renewed is not None
    assert sim.ran.count(CELLS[0]) > sim.ran.count(CELLS[1]) == 2
    along = np.array([1.0, -1.0, 0.0])
    told = along @ np.stack([renewed.columns[CELLS[0], n][:, 0] for n in NAMES])
    np.testing.assert_allclose(told, along @ sim.slopes, atol=0.02)
    for n in NAMES:
        assert renewed.columns[CELLS[1], n] is start.columns[CELLS[1], n]


def test_a_kink_is_no_wrong_column() -> None:
    """The first of two steps hardly passes it."""
    sim = Rough(bent=200.0)
    sim.jump = 0.0
    problem, start, weighing = problem_of(sim)
    point = start.point.moved(start.point.theta + np.array([0.01, -0.01, 0.0]))
    residuals = sim.residuals(point, CELLS)
    columns = sim.columns(point, residuals, CELLS, set(NAMES))
    for known in (columns, start.columns):
        at = Solution(point, residuals, known)
        assert _along_valley(_Ahead(problem, at, weighing)) is None


def test_where_no_step_is_worth_it_nothing_is_simulated() -> None:
    sim = Rough()
    problem, start, weighing = problem_of(sim)
    end = descend(problem, start, weighing.noise, 0.01)
    made = sim.columns(end.point, end.residuals, CELLS, set(NAMES))
    sim.ran.clear()
    at = Solution(end.point, end.residuals, made)
    smooth = replace(problem, cells=CELLS[1:])
    own = Solution(at.point, {CELLS[1]: at.residuals[CELLS[1]]}, at.columns)
    assert _along_valley(_Ahead(smooth, own, weighing)) is None
    assert not sim.ran


class Struck(Rough):
    """Both records are met alike, but in one an axis breaks away or not, by what a + 0.7 b, which
    is all that moves it, has in its seventh digit.
    """

    def __init__(self) -> None:
        super().__init__()
        self.slopes = np.stack([self.slopes[0], 0.7 * self.slopes[0], self.slopes[2]])

    def residual(self, cell: Cell, values: Mapping[str, float]) -> Array:
        theta = np.array([values[n] for n in NAMES])
        found = theta @ self.slopes + self.noise[cell]
        if cell == CELLS[0]:
            up = np.sin(7e5 * (theta[0] + 0.7 * theta[1]) + 0.3) < 0
            found = found + (0.1 * self.pattern if up else 0.0)
        return np.asarray(found[:, None])


def test_a_step_passes_an_event_that_columns_take_for_its_own() -> None:
    """The columns of a record in which a small step of one parameter brings an event hide the line
    along which nothing happens; those of the other record show it.
    """
    sim = Struck()
    problem, start, weighing = problem_of(sim)
    point = start.point.moved(np.array([21.0, -30.0, 0.0]))
    residuals = sim.residuals(point, CELLS)
    columns = sim.columns(point, residuals, CELLS, set(NAMES))
    ahead = _Ahead(problem, Solution(point, residuals, columns), weighing)
    bare = problem.prior.cost(point.theta)
    end = descend(problem, ahead.state, weighing.noise, 0.01)
    assert ahead.towards(np.full(3, 1e-9), 1.0).predicted < 0.1 * bare
    assert problem.prior.cost(end.point.theta) < 0.01 * bare


def test_columns_of_another_point_are_made_anew_where_a_step_by_them_fails() -> None:
    sim = Rough()
    sim.jump = 0.0
    sim.views = {"view": cast(View, SimpleNamespace(remembers=False))}
    problem, start, weighing = problem_of(sim)
    problem = replace(problem, fine=False)
    turned = {k: -c for k, c in start.columns.items()}
    away = start.point.moved(start.point.theta + 1.0)
    tangents = {c: Tangent(away, start.residuals[c]) for c in CELLS}
    wrong = replace(start, columns=turned)
    led = [
        descend(problem, replace(wrong, tangents=t), weighing.noise, 0.01) for t in ({}, tangents)
    ]
    costs = [sum(weighing.costs(s.residuals).values()) for s in (wrong, *led)]
    assert costs[2] < costs[1] - 10  # nothing told the first that its columns may be wrong
    assert led[1].elsewhere(CELLS) == set()


def test_columns_beyond_all_numbers_tell_no_step() -> None:
    """A reading without an error that grows with itself may be as large as it likes."""
    cells = (("view", "wild"), ("view", "quiet"))
    weighing = Weighing({c: (Whitener(np.zeros(0), 1.0),) for c in cells}, Rules())
    point = Point(tuple(Coordinate(n, 0.0, 1.0) for n in "ab"), np.zeros(2), {})
    residuals = {c: np.ones((50, 1)) for c in cells}
    columns = {
        (c, n): np.full((50, 1), size)
        for c, size in zip(cells, (1e200, 1.0), strict=True)
        for n in "ab"
    }
    normal, gradient = weighing.normal(point, residuals, columns)
    quiet, slope = weighing.normal(point, {cells[1]: residuals[cells[1]]}, columns)
    np.testing.assert_array_equal(normal, quiet)
    np.testing.assert_array_equal(gradient, slope)
    endless = {**columns, (cells[0], "a"): np.full((50, 1), np.inf)}
    assert np.isfinite(weighing.normal(point, residuals, endless)[0]).all()


def test_a_step_is_the_least_where_no_other_is_told() -> None:
    point = Point(tuple(Coordinate(n, 0.0, 1.0) for n in "ab"), np.zeros(2), {})
    alike = np.array([[1e40, 1e40], [1e40, 1e40]])
    np.testing.assert_allclose(newton(point, alike, np.full(2, -2e40)).theta, [1.0, 1.0])
