"""A view above the noise is started from other points as well."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.fitting.problem import Problem, Solution, newton, prior, standing
from pneugantry.engine.hypotheses.hypothesis import Coordinate, Hypothesis
from pneugantry.engine.plant import Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.build import build_views
from pneugantry.engine.views.simulation import Point
from pneugantry.engine.views.synthetic import Nominal, noisy


@pytest.fixture
def fitter(cart: Plant, push: Record, cache: Path) -> Iterator[Fitter]:
    record = noisy(cart, Nominal(cart, ["f", "v"], cache).record(push))
    views = build_views(cart, ["force", "speed"], cache, 2e-3, Rules())
    made = Fitter(cart, views, [replace(record, name="push")], Rules())
    yield made
    made.close()


def at(fitter: Fitter, theta: float) -> tuple[Solution, object]:
    """The speed's view with all coordinates at one value, and its problem."""
    coordinates = fitter.coordinates.of(Hypothesis(), 1.0)
    cells = [c for c in fitter.simulation.cells if "speed" in fitter.simulation.views[c[0]].signals]
    problem = fitter.surveys.problem(cells, prior(coordinates), fine=False)
    point = Point(coordinates, np.full(len(coordinates), theta), {})
    return Solution(point, fitter.simulation.residuals(point, cells), {}), problem


def test_a_view_at_its_noise_is_not_surveyed(fitter: Fitter) -> None:
    found, problem = at(fitter, 0.0)
    fitter.surveys.quiet(problem, found)  # brings the sensors' noise through the view, once
    before = fitter.simulation.seconds
    assert fitter.surveys.surveyed(problem, [found], found, None) is found
    assert fitter.simulation.seconds == before


@pytest.mark.parametrize("bar", [None, math.inf])
def test_a_better_optimum_is_found_and_the_same_each_time(
    fitter: Fitter, bar: float | None
) -> None:
    """Where no descent has led: all parameters 15 spreads off."""
    found, problem = at(fitter, 15.0)
    other = fitter.surveys.surveyed(problem, [found], found, bar)
    assert standing(problem, other) < standing(problem, found) - 1000
    again = fitter.surveys.surveyed(problem, [found], found, bar)
    assert np.array_equal(again.point.theta, other.point.theta)


def test_a_step_stops_at_a_bound_and_the_rest_goes_on_without_it() -> None:
    """Not where the free step would lead: the least of a parabola among x >= 0, y is at x = 0."""
    coordinates = (Coordinate("x", 0.0, 1.0, low=0.0), Coordinate("y", 0.0, 1.0))
    square, pull = np.array([[2.0, 1.8], [1.8, 2.0]]), np.array([-1.0, 1.0])
    theta = np.array([0.5, 0.0])
    end = newton(Point(coordinates, theta, {}), square, square @ theta - pull)
    assert np.linalg.solve(square, pull)[0] < 0
    assert end.theta == pytest.approx([0.0, 0.5])


@pytest.mark.parametrize("bar", [None, math.inf])
def test_beside_a_bar_one_record_tells_which_descents_are_worth_the_others(
    cart: Plant, push: Record, cache: Path, monkeypatch: pytest.MonkeyPatch, bar: float | None
) -> None:
    clean = Nominal(cart, ["f", "v"], cache).record(push)
    records = [replace(noisy(cart, clean), name=name) for name in ("push", "again")]
    views = build_views(cart, ["force", "speed"], cache, 2e-3, Rules())
    fitter = Fitter(cart, views, records, Rules())
    found, problem = at(fitter, 15.0)
    raced, race = [], fitter.surveys.raced

    def watched(problem: Problem, start: Solution, bar: float) -> Solution:
        raced.append(len(problem.cells))
        return race(problem, start, bar)

    monkeypatch.setattr(fitter.surveys, "raced", watched)
    other = fitter.surveys.surveyed(problem, [found], found, bar)
    fitter.close()
    assert standing(problem, other) <= standing(problem, found)
    assert raced[0] == (2 if bar is None else 1)
    assert (1 in raced) == (bar is not None)
