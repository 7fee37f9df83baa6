"""What a search does not simulate, for it knows already what would come of it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_search import CATALOGUE, effect, fitter_of, parts, plant

from pneugantry.engine.answer.evidence import _rivals
from pneugantry.engine.chances import Chances
from pneugantry.engine.fitting.descents import Descents
from pneugantry.engine.fitting.fit import Fit, Race, as_of
from pneugantry.engine.fitting.problem import Problem, Solution, prior, standing
from pneugantry.engine.fitting.surveys import Pace, in_view
from pneugantry.engine.hypotheses.hypothesis import Hypothesis
from pneugantry.engine.plant import Plant
from pneugantry.engine.rules import Rules
from pneugantry.engine.selection import contenders, trials
from pneugantry.engine.selection.contenders import _unbent, contending
from pneugantry.engine.selection.excess import unexplained
from pneugantry.engine.selection.rivals import _outdone, exchanged
from pneugantry.engine.selection.scouts import Scouts
from pneugantry.engine.selection.screening import MANY, Candidate, screen
from pneugantry.engine.selection.trail import Trail
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


def test_a_rival_has_a_share_of_what_is_ahead_to_bring(
    plant: Plant, parts: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fitter = fitter_of(plant, parts, drag=40.0)
    null = fitter.null()
    ahead = fitter.explore(hypothesis("drag"), null)
    own, known, cells = fitter.beside_base(hypothesis("mass"), null)
    problem = fitter.surveys.problem(cells, known)
    start, end = (standing(problem, as_of(f, own)) for f in (null, ahead))

    def bar(worth: float, than: Fit = ahead) -> float:
        return fitter.bar_of(Race(than, worth), null, own, known, cells) - fitter.rules.hopeless

    assert start > end + 1000
    assert [bar(w) for w in (0.0, 0.5, 1.0)] == pytest.approx([start, (start + end) / 2, end])
    assert bar(1.0, null) == pytest.approx(start)
    bars, jointly = list[float](), Descents.jointly

    def led(self: Descents, at: Solution, *args: Any) -> Solution:
        bars.append(args[-1])
        return jointly(self, at, *args)

    monkeypatch.setattr(Descents, "jointly", led)
    fitter.explore(hypothesis("mass"), null, race=Race(ahead, 0.5))
    fitter.explore(hypothesis("mass"), null)
    fitter.close()
    assert set(bars) == {bar(0.5) + fitter.rules.hopeless, math.inf}


def test_a_rise_by_another_measure_does_not_end_a_descent(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts)
    point = Point((), np.zeros(0), {})
    cells = tuple(fitter.simulation.cells)
    problem = fitter.surveys.problem(cells, prior(()))
    residuals = fitter.simulation.residuals(point, cells)
    fitter.close()

    def told(own: bool, sizes: tuple[float, ...]) -> list[bool]:
        pace = Pace(problem, -math.inf, own)
        ends = [Solution(point, {c: k * r for c, r in residuals.items()}, {}) for k in sizes]
        return [pace.behind(i, end) for i, end in enumerate(ends)]

    assert told(True, (9.0, 8.0, 8.0)) == [False, False, True]
    assert told(False, (9.0, 8.0, 8.0, 8.1)) == [False] * 4
    assert told(False, (9.0, 8.0, 7.0)) == [False, False, True]


def test_the_same_effects_a_little_better_are_no_other_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nor do they hide another that is better by less."""

    def fit(key: str, evidence: float) -> Any:
        return SimpleNamespace(hypothesis=hypothesis(key), evidence=evidence)

    best, again, other = fit("drag", 1000.0), fit("drag", 993.0), fit("mass", 994.0)
    trail: Any = SimpleNamespace(
        fitter=SimpleNamespace(rules=Rules()), tried=[], replaced=lambda old, new: new
    )
    for name in ("_rivals", "_joined", "_in_place"):
        monkeypatch.setattr(f"pneugantry.engine.selection.rivals.{name}", lambda *args: [])

    def answer(*found: Any) -> Any:
        monkeypatch.setattr("pneugantry.engine.selection.rivals._rivals", lambda *args: found)
        return exchanged(trail, best)

    much = fit("drag", 980.0)
    assert answer(again) is best
    assert answer(again, other) is other
    assert answer(again, other, much) is much


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


def test_what_a_fit_leaves_is_found_once(
    plant: Plant, parts: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor is a record's noise drawn again for each fit."""
    fitter, done = fitter_of(plant, parts, drag=2.0), list[Fit]()
    null, own = fitter.null(), fitter.loud
    monkeypatch.setattr(fitter, "loud", lambda fit: (done.append(fit), own(fit))[1])
    other = replace(null, settled=True)
    told = [unexplained(fitter, fit) for fit in (null, null, other)]
    name = next(iter(fitter.simulation.records))
    assert fitter.noise.noisier(name) is fitter.noise.noisier(name)
    assert fitter.noise.noisier(name, ", draw 0") is not fitter.noise.noisier(name)
    fitter.close()
    assert told == 3 * [["v"]]
    assert done == [null, other]


@pytest.mark.parametrize("left", [[], ["v"]])
def test_beside_what_leaves_nothing_a_rival_has_all_of_its_gain_to_bring(
    plant: Plant, parts: Path, monkeypatch: pytest.MonkeyPatch, left: list[str]
) -> None:
    fitter = fitter_of(plant, parts, drag=2.0)
    null, raced = fitter.null(), list[Race | None]()
    ahead = fitter.explore(hypothesis("drag"), null)
    monkeypatch.setattr(trials, "unexplained", lambda *args: left)
    monkeypatch.setattr(fitter, "explore", lambda h, base, starts, race, **more: raced.append(race))
    trials.explored(fitter, null, [(hypothesis("mass"), [])], ahead)
    trials.explored(fitter, null, [(hypothesis("mass"), [])], None)
    fitter.close()
    told = [race and (race.ahead is ahead, race.worth) for race in raced]
    assert told == [(True, fitter.rules.hopeful if left else 1.0), None]


def test_other_equations_are_tried_in_turn(
    plant: Plant, parts: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fitter = fitter_of(plant, parts)
    null = fitter.null()
    other = replace(CATALOGUE["drag"].forms[0], settings={"cubic": 0.0})
    in_turn = [Hypothesis().plus(CATALOGUE[k], other) for k in ("drag", "mass")]
    told = [(h, [{}]) for h in (in_turn[0], hypothesis("leak"), in_turn[1])]
    seen = list[tuple[list[str], float | None]]()

    def explored(fitter: Any, base: Fit, own: Any, ahead: Any, worth: Any) -> list[Any]:
        keys = [h.keys[0] for h, _ in own]
        seen.append((keys, ahead and ahead.evidence))
        return [SimpleNamespace(evidence=-float(len(seen))) for _ in own]

    monkeypatch.setattr(trials, "explored", explored)
    trials.added(fitter, null, told, None)
    fitter.close()
    assert seen == [(["leak"], None), (["drag"], -1.0), (["mass"], -2.0)]


def test_a_search_takes_for_unknown_what_the_decision_does() -> None:
    rules, chances = Rules(), Chances()
    assert math.log(rules.unexplained) == pytest.approx(chances.unknown_at, rel=0.01)
    assert chances.bent * (rules.bent - chances.bent_from) == pytest.approx(chances.unknown_at)


@pytest.mark.parametrize(("spreads", "open_to_it"), [(4.0, False), (6.0, True)])
def test_a_view_is_open_where_a_bent_parameter_is_as_likely_something_unknown(
    plant: Plant, parts: Path, spreads: float, open_to_it: bool
) -> None:
    """From 3 spreads on it is far off all the same, and unbent where effects are tried."""
    fitter = fitter_of(plant, parts)
    null = fitter.null()
    theta, names = null.point.theta.copy(), [c.name for c in null.point.coordinates]
    theta[names.index("C")] = spreads * null.scale
    bent = replace(null, point=null.point.moved(theta))
    found, far = unexplained(fitter, bent), fitter.far_off(bent)
    fitter.close()
    assert ("v" in found) == open_to_it
    assert far == {"C"}


def test_what_is_hopelessly_behind_what_leaves_nothing_is_not_unbent(
    plant: Plant, parts: Path
) -> None:
    fitter = fitter_of(plant, parts, drag=2.0)
    null = fitter.null()
    right, wrong = (fitter.explore(hypothesis(k), null) for k in ("drag", "leak"))
    theta, names = wrong.point.theta.copy(), [c.name for c in wrong.point.coordinates]
    theta[names.index("C")] = 10 * null.scale
    bent = replace(wrong, point=wrong.point.moved(theta))
    found = []
    for worse in (0.5, 2.0):
        least = right.evidence + worse * fitter.rules.hopeless
        behind = replace(bent, cost=bent.cost + least - bent.evidence)
        found.append(_unbent(fitter, null, [behind], [right, behind]))
    fitter.close()
    assert not unexplained(fitter, right)
    assert [[f.keys for f in own] for own in found] == [[("leak",)], []]


def test_beside_what_leaves_nothing_only_what_contends_is_looked_at_further(
    plant: Plant, parts: Path
) -> None:
    fitter = fitter_of(plant, parts, drag=2.0)
    null = fitter.null()
    right, wrong = (fitter.explore(hypothesis(k), null) for k in ("drag", "leak"))
    fits = [right]
    for worse in (0.5, 2.0):
        least = right.evidence + worse * fitter.rules.hopeless
        fits.append(replace(wrong, cost=wrong.cost + least - wrong.evidence))
    found = [trials.contending_with(fitter, best, fits) for best in (right, null, None)]
    fitter.close()
    assert unexplained(fitter, null)
    assert found == [fits[:2], fits, fits]


def test_what_is_predicted_to_gain_much_less_is_no_rival(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts)
    gains = {"drag": 2700.0, "mass": 2300.0, "leak": 1500.0}
    screened = [Candidate(e := CATALOGUE[k], e.forms[0], {}, g, 0.0) for k, g in gains.items()]

    def chosen(**more: float) -> list[str]:
        told = trials.predicted(fitter, screened, 20.0, ("gain",), **more)
        return [own[0].effect.key for own in told]

    found = chosen(), chosen(short=500.0)
    fitter.close()
    assert found == (["drag", "mass", "leak"], ["drag", "mass"])


def test_what_has_all_of_a_gain_to_bring_comes_near_it_in_each_view(
    plant: Plant, parts: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fitter = fitter_of(plant, parts, drag=40.0)
    null, bars = fitter.null(), list[float]()
    ahead = fitter.explore(hypothesis("drag"), null)
    own, known, cells = fitter.beside_base(hypothesis("mass"), null)
    (view,) = {c[0] for c in cells}
    problem = fitter.surveys.problem(cells, known, fine=False)
    start, end = (standing(problem, in_view(as_of(f, own), view)) for f in (null, ahead))

    def raced(problem: Problem, at: Solution, bar: float) -> Solution:
        bars.append(bar)
        return at

    monkeypatch.setattr(fitter.surveys.__class__, "raced", lambda self, *args: raced(*args))
    for race in (None, Race(ahead, 0.5), Race(ahead, 1.0), Race(null, 1.0)):
        fitter.explore(hypothesis("mass"), null, race=race, thorough=False)
    fitter.close()
    spare = fitter.rules.hopeless
    assert start > end + 2 * spare
    assert bars == pytest.approx([start, start, end + spare, start])


def test_an_answer_is_ahead_of_what_other_effects_lead_to(
    plant: Plant, parts: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fitter, effects = fitter_of(plant, parts, drag=2.0), list(CATALOGUE.values())
    null, raced, explore = fitter.null(), list[Race | None](), fitter.explore
    answer = explore(hypothesis("drag"), null)
    monkeypatch.setattr(
        fitter, "explore", lambda h, base, *args, **more: (raced.append(args[1]), answer)[1]
    )
    forms = trials.main_forms(fitter, effects)
    told = [Candidate(e, f, {}, *(2 * [100.0 * (e.key == "mass")])) for e, f in forms]
    monkeypatch.setattr(contenders, "other_forms", lambda *args, ahead: raced.append(ahead) or [])
    monkeypatch.setattr(contenders, "_scouted", lambda *args, **more: [])
    monkeypatch.setattr(contenders, "_open", lambda *args: [])
    for ahead in (None, answer):
        contending(Trail(fitter, CATALOGUE, [null]), null, told, forms, ahead)
    fitter.close()
    assert raced[:3] == [None, None, None]
    first, *others = raced[3:]
    assert first is not None
    assert (first.ahead, first.worth) == (answer, 1.0)
    assert others == [answer, answer]


@pytest.mark.parametrize(("behind", "outdone"), [(400.0, False), (800.0, False), (1200.0, True)])
def test_what_was_outdone_beside_fewer_effects_is_not_tried_beside_more(
    behind: float, outdone: bool
) -> None:
    """Unless the others brought as much: it may have lacked just them. The answer's second effect
    brings 600 beside the first.
    """

    def fit(evidence: float, *keys: str) -> Any:
        return SimpleNamespace(hypothesis=hypothesis(*keys), evidence=evidence)

    best, alone = fit(-2600.0, "drag", "mass"), fit(-2000.0, "drag")
    tried = [best, alone, fit(-2000.0 + behind, "leak"), fit(0.0, "leak"), fit(0.0)]
    trail: Any = SimpleNamespace(tried=tried, fitter=SimpleNamespace(rules=Rules()))
    own, other = (next(iter(hypothesis(k).forms)) for k in ("drag", "leak"))
    assert _outdone(trail, best, own, other) == outdone


def test_an_effect_more_that_costs_what_one_must_bring_is_not_judged() -> None:
    rules = Rules()
    costs = {("a",): -900.0, ("a", "b"): -890.0, ("a", "c"): -870.0, ("d",): -850.0, (): 0.0}
    assert _rivals(costs, rules) == [("a",), ("a", "b"), ("d",)]


def test_what_is_outweighed_is_not_judged() -> None:
    rules = Rules()
    near, far = (-900.0 + k * rules.outweighed for k in (0.9, 1.1))
    assert _rivals({("a",): -900.0, ("b",): near, ("c",): far}, rules) == [("a",), ("b",)]
    assert math.exp(-rules.outweighed / (2 * Chances().temper)) < 0.01


def test_where_a_fit_has_led_is_not_asked_twice(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts, drag=2.0)
    null = fitter.null()
    near = fitter.explore(hypothesis("drag"), null)
    thorough = fitter.again(near, thorough=True)
    before = fitter.simulation.seconds
    again = fitter.again(near)
    spent = fitter.simulation.seconds - before
    other = fitter.again(replace(near, settled=False))
    fitter.close()
    assert again is thorough
    assert spent == 0.0
    assert other is not again
