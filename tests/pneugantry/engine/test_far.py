"""What is far from a base: effects are sized first, what tolerance bore is unbent, and views that
ended apart are brought together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_frugal import hypothesis
from test_search import CATALOGUE, fitter_of, parts, plant

from pneugantry.engine.fitting import descents
from pneugantry.engine.fitting.descents import Descents
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.fitting.problem import Parabola, Solution, prior, standing
from pneugantry.engine.hypotheses.hypothesis import Hypothesis
from pneugantry.engine.plant import Plant
from pneugantry.engine.selection.rivals import _in_place
from pneugantry.engine.selection.trail import Trail
from pneugantry.engine.views.simulation import Cell, Point

__all__ = ["parts", "plant"]


def test_an_effect_is_sized_beside_tolerance_as_it_is(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts, drag=2.0)
    null = fitter.null()
    start = fitter.coordinates.first(hypothesis("drag"), null, {**null.nominal, "drag": 0.3})
    known, cells = prior(start.coordinates), [c for c in fitter.simulation.cells if c[0] == "v"]
    end = fitter.descents.sized(start, known, cells)
    fitter.close()
    still = [not c.effect and c.record is None for c in start.coordinates]
    assert np.array_equal(end.theta[still], start.theta[still])
    assert end.values(None)["drag"] == pytest.approx(2.0, rel=0.3)


@pytest.mark.parametrize("first", [0.6, 5.0])
def test_sizes_are_tried_where_no_slope_leads_to_one(
    plant: Plant, parts: Path, monkeypatch: pytest.MonkeyPatch, first: float
) -> None:
    """As beside break-aways that come and go with the size."""
    monkeypatch.setattr(descents, "descend", lambda problem, start, *rest: start)
    fitter = fitter_of(plant, parts, drag=2.0)
    null = fitter.null()
    start = fitter.coordinates.first(hypothesis("drag"), null, {**null.nominal, "drag": first})
    cells = [c for c in fitter.simulation.cells if c[0] == "v"]
    end = fitter.descents.sized(start, prior(start.coordinates), cells)
    fitter.close()
    assert end.values(None)["drag"] == pytest.approx(2.0, rel=0.3)


def test_what_is_known_holds_a_size_where_it_tells_of_it(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts, drag=2.0)
    start = fitter.coordinates.first(hypothesis("drag"), fitter.null(), {"drag": 0.3})
    own = prior(start.coordinates)
    at = own.names.index("drag")
    square, pull = own.square.copy(), own.pull.copy()
    square[at, at] += 1e9  # another view is sure of where it is
    pull[at] += 1e9 * start.theta[at]
    cells = [c for c in fitter.simulation.cells if c[0] == "v"]
    end = fitter.descents.sized(start, Parabola(own.names, square, pull), cells)
    fitter.close()
    assert end.values(None)["drag"] == pytest.approx(0.3, rel=0.02)


def test_a_parabola_of_some_coordinates_keeps_the_others() -> None:
    square = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, -1.0], [0.5, -1.0, 5.0]])
    whole = Parabola(("a", "b", "c"), square, np.array([1.0, -2.0, 0.5]))
    theta = np.array([0.3, 0.7, -0.4])
    some = whole.of({"a", "c"}, theta)
    at, by = np.array([1.1, -0.2]), np.array([0.1, 0.6])
    whole_at, whole_by = (whole.cost(np.array([x[0], 0.7, x[1]])) for x in (at, by))
    assert some.names == ("a", "c")
    assert some.cost(at) - some.cost(by) == pytest.approx(whole_at - whole_by)


def _apart(fitter: Fitter) -> tuple[Solution, Parabola, list[Solution]]:
    """The nominal plant, its prior, and each view's own end, of which one has a parabola whose
    least lies far off.
    """
    coordinates = fitter.coordinates.of(Hypothesis(), 1.5)
    known, cells = prior(coordinates), tuple(fitter.simulation.cells)
    point = Point(coordinates, np.zeros(len(coordinates)), {})
    start = Solution(point, *fitter.simulation.linearised(point, cells, set(known.names)))
    views = list(dict.fromkeys(c[0] for c in cells))
    ends = [e.solution for e in fitter.surveys.ends([start], known, cells, (), views)]

    def led_away(end: Solution) -> Solution:
        off = {c: r + 8.0 * end.columns.get((c, "m"), 0.0) for c, r in end.residuals.items()}
        return replace(end, residuals=off)

    return start, known, [led_away(e) for e in ends]


def test_views_that_ended_apart_go_no_farther_than_is_good(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts)
    start, known, ends = _apart(fitter)
    cells, total = fitter.simulation.cells, known
    for end in ends:
        total = total.plus(fitter.descents.parabola(end, fitter.noise.coloured(end.residuals)))
    problem = fitter.surveys.problem(cells, known)
    agreed = fitter.descents.agreed(start, ends, known, cells)
    whole = start.point.moved(total.least())
    least = Solution(whole, fitter.simulation.residuals(whole, cells), {})
    fitter.close()
    assert standing(problem, agreed) < standing(problem, least) - 100
    assert standing(problem, agreed) < standing(problem, start)


def test_an_end_that_is_behind_a_start_at_first_is_followed_all_the_same(
    plant: Plant, parts: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A descent of views by themselves goes by another measure, and may stop before the valley's
    floor: of the start, which was better then, no descent leads on.
    """
    fitter = fitter_of(plant, parts, drag=2.0)
    null, own = fitter.null(), hypothesis("drag")
    coordinates, begun = fitter.coordinates, list[float]()
    jointly = fitter.descents.jointly

    def stopped(starts: Sequence[Solution], *args: object) -> Solution:
        point = coordinates.first(own, null, {**null.nominal, "drag": 1.0})
        return Solution(point, fitter.simulation.residuals(point, fitter.simulation.cells), {})

    def led(at: Solution, known: Parabola, cells: Sequence[Cell], bar: float) -> Solution:
        begun.append(round(at.point.values(None)["drag"], 6))
        return at if begun[-1] == 0.0 else jointly(at, known, cells, bar)

    monkeypatch.setattr(Descents, "by_view", lambda self, *args: stopped(*args))
    monkeypatch.setattr(Descents, "jointly", lambda self, *args: led(*args))
    found = fitter.explore(own, null)
    fitter.close()
    assert begun == [0.0, 1.0]
    assert found.values(None)["drag"] == pytest.approx(2.0, rel=0.1)


def test_an_end_is_made_exact(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts)
    start, known, _ = _apart(fitter)
    problem = fitter.surveys.problem(
        [c for c in fitter.simulation.cells if c[0] == "v"], known, fine=False
    )
    theta = start.point.theta + 0.3
    moved = start.point.moved(theta)
    there = Solution(moved, fitter.simulation.residuals(moved, problem.cells), {})
    end = fitter.descents.finely(problem, there)
    fitter.close()
    assert standing(problem, end) < standing(problem, there) - 10


def test_an_answer_that_leaves_much_is_held_against_rivals_where_tolerance_is_unbent(
    plant: Plant, parts: Path
) -> None:
    fitter = fitter_of(plant, parts, drag=2.0)
    null = fitter.null()
    assert fitter.far_off(null)

    def beside(key: str, values: Mapping[str, float]) -> Fit:
        effect = CATALOGUE[key]
        return fitter.explore(null.hypothesis.plus(effect, effect.forms[0]), null, [values])

    wrong, right = beside("mass", {}), beside("drag", {"drag": 1.0})
    trail = Trail(fitter, CATALOGUE, [null, wrong])
    found = _in_place(trail, wrong)
    settled = _in_place(trail, right)
    fitter.close()
    assert {f.keys for f in found} <= {("drag",), ("friction",)}  # of its block
    best = min(found, key=lambda f: f.evidence)
    assert best.keys == ("drag",)
    assert best.evidence < right.evidence + fitter.rules.entry
    assert settled == []
