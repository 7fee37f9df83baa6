"""What a search does not simulate, for it knows already what would come of it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_search import CATALOGUE, effect, fitter_of, parts, plant

from pneugantry.engine.fitting.fit import Race, as_of
from pneugantry.engine.fitting.problem import Solution, prior, standing
from pneugantry.engine.hypotheses.hypothesis import Hypothesis
from pneugantry.engine.plant import Plant
from pneugantry.engine.selection.scouts import Scouts
from pneugantry.engine.selection.screening import MANY, screen
from pneugantry.engine.views.simulation import Point

__all__ = ["parts", "plant"]


def hypothesis(*keys: str) -> Hypothesis:
    found = Hypothesis()
    for key in keys:
        found = found.plus(CATALOGUE[key], CATALOGUE[key].forms[0])
    return found


def test_two_hypotheses_differ_by_what_only_one_has() -> None:
    both, first = hypothesis("drag", "leak"), hypothesis("drag")
    assert both.beyond(first).keys == first.beyond(both).keys == ("leak",)
    assert set(hypothesis("mass").beyond(first).keys) == {"mass", "drag"}
    other = replace(CATALOGUE["drag"].forms[0], name="other")
    reformed = Hypothesis().plus(CATALOGUE["drag"], other)
    assert [f.name for _, f in reformed.beyond(first).effects] == ["other", "plain"]


def test_beside_a_second_effect_the_first_one_s_views_are_left_as_they_are(
    plant: Plant, parts: Path
) -> None:
    fitter = fitter_of(plant, parts, leak=0.1, drag=2.0)
    null = fitter.null()
    base = fitter.explore(hypothesis("leak"), null)
    near = fitter.explore(hypothesis("leak", "drag"), base)
    end = fitter.again(near)
    fitter.close()
    kept = {c[0] for c in base.residuals if near.residuals[c] is base.residuals[c]}
    assert kept == {"i", "s"}
    assert near.values(None)["drag"] == pytest.approx(2.0, rel=0.1)
    assert near.evidence - end.evidence < 10


def test_a_scout_tells_what_a_view_gains(plant: Plant, parts: Path) -> None:
    """More than the fit that it is to spare."""
    fitter = fitter_of(plant, parts, drag=2.0)
    null = fitter.null()
    scouts = Scouts(fitter, null, ["v"])
    keys = ("drag", "current_scale", "leak", "mass")
    gains = dict(zip(keys, scouts.gains([(hypothesis(k), []) for k in keys]), strict=True))
    fit = fitter.explore(hypothesis("drag"), null)
    fitter.close()
    assert gains["drag"] > null.evidence - fit.evidence > fitter.rules.effect
    assert gains["leak"] == 0  # the view of the speed does not read it
    assert gains["mass"] < fitter.rules.effect  # tolerance has it already
    assert gains["current_scale"] < 0.5 * gains["drag"]


@pytest.mark.parametrize("short", [1e4, -500.0])
def test_a_descent_that_does_not_come_near_what_is_ahead_is_given_up(
    plant: Plant, parts: Path, short: float
) -> None:
    """short: by how much the least lies above the bar (a fit has `Rules.hopeless` to spare)."""
    fitter = fitter_of(plant, parts, drag=40.0)
    own, cells = fitter.coordinates.of(hypothesis("drag"), 1.0), tuple(fitter.simulation.cells)
    known, point = prior(own), Point(own, np.full(len(own), 2.0), {})
    problem = fitter.surveys.problem(cells, known)
    start = Solution(point, fitter.simulation.residuals(point, cells), {})

    def led(bar: float) -> tuple[float, float]:
        before = fitter.simulation.evaluations
        end = fitter.descents.jointly(start, known, cells, bar)
        return standing(problem, end), fitter.simulation.evaluations - before

    least, whole = led(math.inf)
    raced, less = led(least - short)
    fitter.close()
    if short > 0:
        assert raced > least + 100
        assert less < 0.8 * whole
    else:
        assert (raced, less) == (least, whole)


def test_a_rival_has_a_share_of_what_is_ahead_to_bring(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts, drag=40.0)
    null = fitter.null()
    ahead = fitter.explore(hypothesis("drag"), null)
    own, known, cells = fitter.beside_base(hypothesis("mass"), null)
    rivals = [as_of(f, own) for f in (null, ahead)]
    none, half, all_ = (
        fitter.bar(rivals, Race(ahead, worth), known, cells) for worth in (0.0, 0.5, 1.0)
    )
    fitter.close()
    fall = none - all_
    assert none - half == pytest.approx(fall / 2)
    assert fall > 1000
    again = fitter.bar(rivals[:1] * 2, Race(null, 1.0), known, cells)
    assert again == pytest.approx(none)


def test_what_is_settled_is_not_fitted_again(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts)
    null = fitter.null()
    before = fitter.simulation.seconds
    again = fitter.again(null)
    spent = fitter.simulation.seconds - before
    fitter.close()
    assert null.settled
    assert spent == 0
    assert again.evidence == pytest.approx(null.evidence, abs=1e-6)
    assert np.array_equal(again.point.theta, null.point.theta)


def test_columns_serve_where_they_foretell_what_is_there(plant: Plant, parts: Path) -> None:
    """Those of a cell that moved beyond are made anew."""
    fitter = fitter_of(plant, parts)
    null, cells = fitter.null(), tuple(fitter.simulation.cells)
    at = Solution(null.point, null.residuals, null.columns, tangents=null.tangents)
    known = prior(null.point.coordinates)
    first = fitter.descents.with_columns(replace(at, tangents={}), known, cells)
    names, sigma = [c.name for c in null.point.coordinates], null.sigma("F_c")

    def moved(size: float) -> tuple[Solution, float]:
        theta = null.point.theta.copy()
        theta[names.index("F_c")] += size
        point = null.point.moved(theta)
        there = replace(first, point=point, residuals=fitter.simulation.residuals(point, cells))
        before = fitter.simulation.seconds
        return fitter.descents.with_columns(there, known, cells), fitter.simulation.seconds - before

    (near, spent), (far, more) = moved(1e-3 * sigma), moved(300 * sigma)
    fitter.close()
    assert set(first.tangents) == set(cells)
    assert spent == 0
    assert all(near.columns[k] is first.columns[k] for k in first.columns)
    assert near.elsewhere(cells) == {c[0] for c in cells}
    assert more > 0
    assert {c[0] for c in cells if far.tangents[c].point is far.point} == {"v"}


def test_of_very_many_starts_few_are_simulated_in_every_record(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts, drag=2.0)
    null, own = fitter.null(), effect("drag", "drag", "mechanics", 2.0)
    form = own.forms[0]
    starts = tuple(float(s) for s in np.linspace(-5, 5, 60))
    many = replace(form, parameters=(replace(form.parameters[0], starts=starts),))
    before = fitter.simulation.seconds
    found = screen(fitter, null, [(own, many)], {})
    spent = fitter.simulation.seconds - before
    each = sum(r.rows * r.period for r in fitter.simulation.records.values())
    fitter.close()
    kept = [c.starts["drag"] for c in found if c.starts]
    assert kept
    assert min(kept) > 0  # towards the rig's
    assert spent < (len(starts) / 2 + 2 * MANY) * each  # one record of two tells which go on
