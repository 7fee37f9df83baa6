"""A whole diagnosis of a small plant, and the decision by itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from test_search import CATALOGUE, PERIOD, SIGMA, fitter_of, parts, plant, record

from pneugantry.engine.answer.confirm import Gap, values_on
from pneugantry.engine.answer.confirmed import Confirmed, confirm
from pneugantry.engine.answer.decide import Decision, Evidence, Outstanding, decide, outstanding
from pneugantry.engine.answer.evidence import (
    _compared,
    _costs,
    _turned,
    evidence_of,
    left_by,
    left_in_views,
    settled,
    vouched,
)
from pneugantry.engine.answer.predict import Predictor, Unseen
from pneugantry.engine.answer.result import to_json
from pneugantry.engine.chances import Chances
from pneugantry.engine.fitting.autoregression import quoted
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.fitting.probing import probed
from pneugantry.engine.fitting.problem import Problem, Solution, prior
from pneugantry.engine.fitting.weighing import Weighing
from pneugantry.engine.hypotheses.hypothesis import Coordinate, Hypothesis
from pneugantry.engine.plant import Data, Nuisance, Plant, Record, Signal
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found, _cut_short, run
from pneugantry.engine.selection.excess import Excess
from pneugantry.engine.selection.search import Search, search
from pneugantry.engine.task import Task
from pneugantry.engine.views.build import build_views
from pneugantry.engine.views.simulation import Point

__all__ = ["parts", "plant"]  # fixtures


def diagnosed(plant: Plant, tmp: Path, catalogue: object = CATALOGUE, **truth: float) -> Found:
    rules = Rules()
    data = Data((record("one", 1, **truth), record("two", 2, **truth)), record("held", 3, **truth))
    views = build_views(plant, list(SIGMA), tmp, PERIOD, rules)
    return run(Task(plant, views, data, catalogue, tmp), rules)  # type: ignore[arg-type]


def test_an_effect_is_named_located_and_its_gap_shrinks(plant: Plant, parts: Path) -> None:
    found = diagnosed(plant, parts, drag=2.0).diagnosis
    assert found.verdict == "identified"
    assert [c.key for c in found.causes][:1] == ["drag"]
    assert found.causes[0].probability > 0.9
    assert found.where[0].block == "mechanics"
    size = found.causes[0].parameters["drag"]
    assert size.low < 2.0 < size.high
    assert found.gap is not None
    assert found.gap.record == "held"
    assert found.gap.shrink > 0.98
    assert to_json(found)["probabilities"]["none"] < 0.05


def test_a_sound_rig_is_called_sound(plant: Plant, parts: Path) -> None:
    found = diagnosed(plant, parts).diagnosis
    assert found.verdict == "none"
    assert found.where == ()
    assert found.answer_set == ((),)
    assert found.probabilities["none"] > 0.9


def test_what_the_catalogue_lacks_is_unknown_in_its_block(plant: Plant, parts: Path) -> None:
    few = {k: e for k, e in CATALOGUE.items() if k not in ("leak", "slow_current")}
    found = diagnosed(plant, parts, few, leak=0.3).diagnosis
    assert found.verdict == "unknown"
    assert found.where[0].block == "current"
    assert found.probabilities["unknown"] > 0.9


def test_a_record_that_no_fit_saw_speaks_for_the_effect_that_is_there(
    plant: Plant, parts: Path
) -> None:
    fitter = fitter_of(plant, parts, drag=2.0)
    null = fitter.null()
    named = {}
    for key in ("drag", "current_bias"):
        effect = CATALOGUE[key]
        named[key] = fitter.again(
            fitter.explore(null.hypothesis.plus(effect, effect.forms[0]), null)
        )
    views = list(fitter.simulation.views.values())
    held = Predictor(fitter, views, record("held", 3, drag=2.0))
    gains = dict(zip(named, held.gains(list(named.values()), null), strict=True))
    held.close()
    fitter.close()
    assert gains["drag"] > 5
    assert gains["current_bias"] < 2


def test_what_a_record_says_of_a_fit_is_found_once(
    plant: Plant, parts: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever it is compared with."""
    fitter = fitter_of(plant, parts, drag=2.0)
    null, begun = fitter.null(), list[Fit]()
    drag, leak = (
        fitter.explore(null.hypothesis.plus(e, e.forms[0]), null)
        for e in (CATALOGUE["drag"], CATALOGUE["leak"])
    )
    views, held = list(fitter.simulation.views.values()), record("held", 3, drag=2.0)
    kept, afresh = (Unseen(fitter, views, (held,)) for _ in range(2))
    own = Predictor._starts
    monkeypatch.setattr(Predictor, "_starts", lambda p, fit: (begun.append(fit), own(p, fit))[1])
    first, both = kept.gains([drag], null), kept.gains([drag, leak], null)
    assert begun == [null, drag, leak]
    assert afresh.gains([drag, leak], null) == pytest.approx(both, abs=1e-6)
    assert both[0] == pytest.approx(first[0], abs=1.0)
    assert kept.excesses(drag, 1.0)[0].level == 1.0
    assert begun == [null, drag, leak, null, drag, leak]
    for unseen in (kept, afresh):
        unseen.close()
    fitter.close()


def test_what_a_record_alone_has_is_read_from_it_before_it_is_replayed(
    plant: Plant, parts: Path
) -> None:
    """As if the friction were another in each record, by 0.2 (rms)."""

    def own(name: str, seed: int, friction: float) -> Record:
        return replace(record(name, seed, F_c=friction), parameters={"F_c": 0.8})

    fitted = [own("log 1", 1, 0.8), own("log 2", 2, 0.7)]
    held, rules = own("held", 3, 0.95), Rules()
    for read in (True, False):
        alone = (Nuisance("F_c", 0.2, per_record=True, read=read),)
        rest = tuple(n for n in plant.nuisances if n.parameter != "F_c")
        one = replace(plant, nuisances=(*rest, *alone))
        fitter = Fitter(one, build_views(one, list(SIGMA), parts, PERIOD, rules), fitted, rules)
        fit, predictor = (
            fitter.null(),
            Predictor(fitter, list(fitter.simulation.views.values()), held),
        )
        told = predictor.told(fit)
        predictor.close()
        fitter.close()
        if not read:
            assert told is held
            assert 0.65 < values_on(fit, told)["F_c"] < 0.8  # as the other records have it
            continue
        assert told.parameters["F_c"] == pytest.approx(0.95, abs=0.03)
        assert "F_c" not in values_on(fit, told)
        assert told.told == {"F_c"}


def test_what_is_too_sure_of_itself_foretells_as_widely_as_the_best_of_all(
    plant: Plant, parts: Path
) -> None:
    """Its parameters are off by more than its covariance, divided by 1000, tells."""
    fitter = fitter_of(plant, parts)
    null = fitter.null()
    sigma = np.sqrt(np.diag(null.covariance))
    off = replace(null.point, theta=null.point.theta + 3 * sigma)
    views = list(fitter.simulation.views.values())
    held = Predictor(fitter, views, record("held", 3))
    narrow = replace(null, covariance=null.covariance / 1000, point=off)
    honest, _ = held.predictions([null])
    alone, _ = held.predictions([narrow])
    beside, _ = held.predictions([null, narrow])
    held.close()
    fitter.close()
    assert honest[0].wider == 1.0
    assert alone[0].wider >= 30.0
    assert [f.wider for f in beside] == [1.0, 1.0]  # the wrong one is not let off
    assert beside[1].cost > beside[0].cost + 10


class Costed:
    """A fit of some evidence; the more it falls, the more of that is doubted."""

    def __init__(self, evidence: float) -> None:
        self.evidence = evidence

    def gain(self, base: Costed, rules: Rules) -> float:
        fall = base.evidence - self.evidence
        return fall - 0.2 * abs(fall)

    def sure_fall(self, rival: Costed, temper: float) -> float:
        return 0.9 * (rival.evidence - self.evidence)


class InStretches:
    """A fit of some cost in each of a record's stretches."""

    def __init__(self, stretches: Sequence[float], cost: float = 0.0) -> None:
        self.stretches = {("view", "record"): np.array(stretches)}
        self.evidence = float(sum(stretches)) + cost


def sure_fall_of(falls: Sequence[float], simpler: float = 0.0) -> float:
    fit, rival = InStretches([-f for f in falls], simpler), InStretches([0.0 for _ in falls])
    return Fit.sure_fall(cast(Fit, fit), cast(Fit, rival), 6.0)


def test_what_many_stretches_tell_of_a_rival_counts_and_what_one_tells_hardly() -> None:
    assert sure_fall_of([1.0] * 100) == pytest.approx(88.7, abs=0.1)
    assert sure_fall_of([100.0]) == pytest.approx(18.8, abs=0.1)
    assert sure_fall_of([100.0], simpler=60.0) == pytest.approx(0.4 * sure_fall_of([100.0]))
    assert sure_fall_of([-100.0]) == -sure_fall_of([100.0])


@pytest.mark.parametrize("falls", [[3.0] * 10, [40.0, -10.0, 5.0], [120.0, 30.0]])
def test_a_rival_is_as_likely_as_in_the_mean_over_other_stretches(falls: list[float]) -> None:
    fall = np.random.default_rng(1).normal(sum(falls), np.linalg.norm(falls), 100_000)
    expected = np.mean(1 / (1 + np.exp(fall / 12)))
    assert 1 / (1 + np.exp(sure_fall_of(falls) / 12)) == pytest.approx(expected, abs=0.02)


def test_rivals_are_held_against_each_other_not_each_against_what_leaves_most() -> None:
    told = {(): 0.0, ("a",): -1000.0, ("b",): -300.0, ("a", "c"): -1800.0, ("b", "c"): -1900.0}
    fits = {k: cast(Fit, Costed(e)) for k, e in told.items()}
    costs = _costs(fits, Rules(), 6.0)
    assert costs["b", "c"] < costs["a", "c"]  # though over ("a",) it would be -1440 and -1520
    assert costs["a",] == pytest.approx(-800.0)
    assert costs["b",] == pytest.approx(-800.0 + 0.9 * 700.0)
    assert costs["a", "c"] - costs["b", "c"] == pytest.approx(90.0)


class Rough(Costed):
    """A fit of some effects, of all views together or not."""

    hypothesis = None

    def __init__(self, evidence: float, *keys: str, whole: bool) -> None:
        super().__init__(evidence)
        self.keys, self.whole = keys, whole


class Finisher:
    """Fits of all views together are 80 of -2 log evidence worse."""

    rules = Rules()

    def __init__(self) -> None:
        self.finished: list[tuple[str, ...]] = []

    def again(self, fit: Rough) -> Rough:
        self.finished.append(fit.keys)
        return Rough(fit.evidence + 80.0, *fit.keys, whole=True)

    def together(
        self, call: Callable[[Rough], Rough], fits: Sequence[Rough], _: Sequence[object]
    ) -> list[Rough]:
        return [call(f) for f in fits]


def test_likeliest_fits_are_held_against_each_other_with_all_views_together() -> None:
    finisher = Finisher()
    tried = [
        Rough(0.0, whole=True),
        Rough(-1000.0, "a", whole=False),
        Rough(-930.0, "a", whole=True),
        Rough(-990.0, "b", "a", whole=True),
        Rough(-10.0, "hopeless", whole=False),
    ]
    fits = _compared(cast(Fitter, finisher), cast(list[Fit], tried), 6.0)
    assert finisher.finished == [("a",)]
    assert fits["a",].evidence == -930.0
    assert _costs(fits, Rules(), 6.0)["a", "b"] < _costs(fits, Rules(), 6.0)["a",]


def test_only_what_lost_against_an_effect_more_is_turned() -> None:
    before = {(): 0.0, ("a",): -50.0, ("a", "b"): -40.0, ("b",): -5.0, ("c",): -60.0}
    assert _turned(before, before) == []
    after = {**before, ("a", "b"): -90.0}
    assert _turned(before, after) == [(("a",), ("a", "b"))]


def test_what_a_held_out_record_turns_round_is_fitted_again_from_there(
    plant: Plant, parts: Path
) -> None:
    """The fit of the drag stands in a wrong place of the same evidence, that beside a leak in the
    right one.
    """
    fitter = fitter_of(plant, parts, drag=2.0)
    null, drag, leak = fitter.null(), CATALOGUE["drag"], CATALOGUE["leak"]
    right = fitter.again(fitter.explore(null.hypothesis.plus(drag, drag.forms[0]), null))
    pair = fitter.again(fitter.explore(right.hypothesis.plus(leak, leak.forms[0]), right))
    theta = right.point.theta.copy()
    theta[[c.name for c in right.point.coordinates].index("m")] += 8.0
    wrong = replace(right, point=right.point.moved(theta), settled=False)
    data = Data(tuple(fitter.simulation.records.values()), record("held", 3, drag=2.0))
    task = Task(plant, list(fitter.simulation.views.values()), data, CATALOGUE, parts)
    unseen = Unseen(fitter, task.views, data.unseen)
    found = evidence_of(fitter, task, unseen, Search(null, wrong, (), (wrong, pair)))
    unseen.close()
    fitter.close()
    costs = {e.fit.keys: e.cost for e in found}
    own = next(e.fit for e in found if e.fit.keys == ("drag",))
    assert own.values(None)["m"] == pytest.approx(right.values(None)["m"], rel=1e-3)
    assert min(costs, key=lambda k: costs[k]) == ("drag",)


def fit_of(evidence: float, *keys: str) -> Evidence:
    """A fit that is nothing but its effects and its evidence."""
    effects = tuple((CATALOGUE[k], CATALOGUE[k].forms[0]) for k in keys)
    nothing = np.zeros((0, 0))
    point = Point((), np.zeros(0), {})
    fit = Fit(Hypothesis(effects), point, {}, {}, {}, {}, nothing, 1.0, {}, evidence)
    return Evidence(fit, evidence)


def test_probabilities_of_all_answers_sum_to_one() -> None:
    found = decide(
        [fit_of(0.0), fit_of(-300.0, "drag"), fit_of(-290.0, "mass")], Outstanding(0.1), Chances()
    )
    assert sum(a.probability for a in found.answers) == pytest.approx(1.0)
    assert found.chosen == ("drag",)
    assert found.verdict == "ambiguous"


def test_an_effect_that_may_be_there_besides_makes_nothing_ambiguous() -> None:
    more = fit_of(-325.0, "drag", "mass")
    found = decide([fit_of(0.0), fit_of(-300.0, "drag"), more], Outstanding(0.0), Chances())
    assert 0.1 < sum(a.probability for a in found.answers if "mass" in a.keys) < 0.5
    assert found.verdict == "identified"


def test_evidence_decides_between_none_and_an_effect() -> None:
    chances = Chances()
    for gain, verdict in ((chances.entry / 3, "none"), (chances.entry * 3, "identified")):
        found = decide([fit_of(0.0), fit_of(-gain, "drag")], Outstanding(0.0), chances)
        assert found.verdict == verdict
    level = decide([fit_of(0.0), fit_of(-chances.entry, "drag")], Outstanding(-9.0), chances)
    assert level.none == pytest.approx(0.5)


def test_none_is_said_only_where_it_is_likelier_than_all_else() -> None:
    """Two hypotheses, each a little less likely than none: together they outweigh it."""
    chances = Chances(imitated=0.0)
    near = [fit_of(-0.9 * chances.entry, k) for k in ("drag", "mass")]
    found = decide([fit_of(0.0), *near], Outstanding(-9.0), chances)
    assert found.answers[0].keys == found.chosen == ()
    assert found.none < 0.5
    assert found.verdict == "ambiguous"
    assert found.located.keys == ("drag",)  # what may be there has a place
    one = decide([fit_of(0.0), near[0]], Outstanding(-9.0), chances)
    assert one.verdict == "none"
    assert one.located is one.best


def test_what_stands_out_is_unknown_beside_what_is_known() -> None:
    found = decide([fit_of(0.0), fit_of(-500.0, "drag")], Outstanding(2.0), Chances())
    assert found.verdict == "unknown"
    assert found.chosen == ("drag",)
    assert {a.keys for a in found.answers[:2]} == {("drag", "unknown"), ("unknown",)}
    assert sum(a.probability for a in found.answers) == pytest.approx(1.0)
    assert sum(a.probability for a in found.answers if "drag" in a.keys) < 0.6


def test_an_effect_that_cannot_look_like_what_stands_out_is_believed() -> None:
    found = decide([fit_of(0.0), fit_of(-500.0, "drag")], Outstanding(2.0), Chances(), doubtful=())
    assert found.verdict == "unknown"
    assert sum(a.probability for a in found.answers if "drag" in a.keys) > 0.99
    assert found.answers[0].keys == ("drag", "unknown")


def test_beside_an_effect_unknown_asks_for_more() -> None:
    """A rig owes no effect its textbook form: what is left of it is no second one."""
    chances, found = Chances(), [fit_of(0.0), fit_of(-500.0, "drag")]
    most = Outstanding(0.5, before=2.0)  # 3 % of the variance
    assert decide([fit_of(0.0)], most, chances).verdict == "unknown"
    assert decide(found, most, chances).verdict == "identified"


@pytest.mark.parametrize("before", [0.55, 0.9, None])
def test_an_effect_that_leaves_most_of_what_stood_out_only_looks_like_it(
    before: float | None,
) -> None:
    found = [fit_of(0.0), fit_of(-500.0, "drag")]
    assert decide(found, Outstanding(0.5, before=before), Chances()).verdict == "unknown"


def test_what_one_effect_imitates_takes_the_others_not_away() -> None:
    found = [fit_of(0.0), fit_of(-500.0, "drag"), fit_of(-900.0, "drag", "mass")]
    made = decide(found, Outstanding(-9.0), Chances(imitated=0.1))
    held = {k: sum(a.probability for a in made.answers if k in a.keys) for k in ("drag", "mass")}
    assert held == pytest.approx({"drag": 1 - 0.19 / 2, "mass": 1 - 0.19 / 2})
    assert made.unknown == pytest.approx(0.19)


def test_what_the_effect_has_done_little_to_is_what_tells() -> None:
    """A large part is left of little, a small one of much: the first is something else."""
    left = Excess(1.0, {}, {("a", "v"): 2.0, ("b", "v"): 1.5}, {})
    null = replace(left, whole={("a", "v"): 9.0, ("b", "v"): 1.5})
    assert outstanding([left], Chances()).channel == ("a", "v")
    beside = outstanding([left], Chances(), null=null)
    assert beside.channel == ("b", "v")
    assert beside.before == beside.score


def test_what_something_unknown_may_well_look_like_is_not_identified() -> None:
    """At 0.6 a cause is no more than likely; where it cannot look like what stands out, it is."""
    chances = Chances()
    found = [fit_of(0.0), fit_of(-500.0, "drag")]
    left = Outstanding(0.54, before=1.25)  # near the share at which both are as likely
    made = decide(found, left, chances)
    assert 0.2 < made.unknown < 0.5
    assert made.verdict == "ambiguous"
    assert [a.keys for a in made.answers[:2]] == [("drag",), ("unknown",)]
    assert decide(found, left, chances, doubtful=()).verdict == "identified"


def test_a_parameter_bent_far_beyond_tolerance_counts_for_unknown() -> None:
    chances = Chances()
    quiet = Excess(1.0, {}, {("view", "v"): 1.0}, {})
    mass = Coordinate("m", 1.0, 0.02, spread=1.5, scales=True)
    bent = {}
    for theta in (3.0, 12.0):
        fit = replace(fit_of(0.0).fit, point=Point((mass,), np.array([theta]), {}))
        bent[theta] = outstanding([quiet], chances, fit=fit).score
    assert bent[3.0] == 0.0
    assert bent[12.0] > chances.unknown_at


@pytest.mark.parametrize(
    ("spread", "parted", "stands_out"),
    [(None, None, True), ((2.0, 9.0), None, False), (None, 3.0, False), ((7.9, 8.5), None, True)],
)
def test_what_a_replay_leaves_counts_where_no_missed_event_explains_it(
    spread: tuple[float, float] | None, parted: float | None, stands_out: bool
) -> None:
    quiet = Excess(1.0, {}, {("view", "v"): 1.0}, {})
    gap = Gap(100.0, 8.0, 1.0, 0.99, (0.98, 0.99), "held", {}, spread, parted)
    chances = Chances()
    there = replace(quiet, whole={("view", "v"): 2.0})  # in a view of the record, too
    found = outstanding([quiet, there], chances, gap)
    assert (found.score > chances.unknown_at) == stands_out
    assert found.channel == ("view", "v")
    assert outstanding([quiet, there], chances).score == 0.0
    assert outstanding([quiet, quiet], chances, gap).score == 0.0  # it has missed an event


@pytest.mark.parametrize(
    ("leaving", "parted", "lost"), [(1.0, 3.0, True), (0.95, 3.0, False), (1.0, None, False)]
)
def test_an_answer_has_lost_a_record_that_none_of_its_values_follows(
    leaving: float, parted: float | None, lost: bool
) -> None:
    gap = Gap(100.0, 8.0, 1.0, 0.99, (0.98, 0.99), "held", {}, None, parted, leaving=leaving)
    own = record("held", 3)
    assert Confirmed(None, None, None, gap, own).lost == lost
    assert not Confirmed(None, None, None, None, own).lost


@pytest.mark.parametrize(("drag", "keeps"), [(2.0, True), (0.0, False)])
def test_what_is_doubted_counts_where_it_alone_keeps_the_unseen_record(
    plant: Plant, parts: Path, drag: float, keeps: bool
) -> None:
    """The answer is made to be none, and its replay to have left the record after 1 s."""
    fitter = fitter_of(plant, parts, drag=drag)
    data = Data(tuple(fitter.simulation.records.values()), record("held", 3, drag=drag))
    task = Task(plant, list(fitter.simulation.views.values()), data, CATALOGUE, parts)
    found = search(fitter, fitter.null(), CATALOGUE)
    none = [Evidence(found.null, 0.0)]
    unseen = Unseen(fitter, task.views, data.unseen)
    confirmed = confirm(fitter, task, unseen, found.null, found.null)
    unseen.close()
    assert confirmed.gap is not None
    assert vouched(fitter, task, found, none, confirmed.pair) == []  # the answer keeps it as well
    early = replace(confirmed.gap, augmented=1.2)
    left = replace(confirmed.gap, parted=1.0, leaving=1.0, early=early)
    assert confirmed.nominal is not None
    kept = vouched(fitter, task, found, none, (confirmed.nominal, left))
    fitter.close()
    assert [v.fit.keys for v in kept][:1] == ([("drag",)] if keeps else [])
    assert all(v.cost < -fitter.rules.effect for v in kept)


@pytest.mark.parametrize(("leak", "explained"), [(0.0, True), (0.3, False)])
def test_what_is_doubted_counts_where_it_explains_all_that_stands_out(
    plant: Plant, parts: Path, leak: float, explained: bool
) -> None:
    """The answer is made to be none, as if few stretches told of drag; a leak is not known."""
    known = {k: e for k, e in CATALOGUE.items() if k not in ("leak", "slow_current")}
    fitter = fitter_of(plant, parts, drag=2.0, leak=leak)
    data = Data(tuple(fitter.simulation.records.values()), None)
    task = Task(plant, list(fitter.simulation.views.values()), data, known, parts)
    found = search(fitter, fitter.null(), known)
    left = left_by(fitter, Unseen(fitter, task.views, data.unseen), found.null)[0]
    stood = left_in_views(fitter, found.null)
    kept = settled(fitter, task, found, [Evidence(found.null, 0.0)], left, stood)
    assert [e.fit.keys for e in kept] == ([("drag",)] if explained else [])
    assert all(e.cost == e.fit.evidence - found.null.evidence for e in kept)


def test_nothing_doubted_counts_where_nothing_stands_out(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts, drag=2.0)
    data = Data(tuple(fitter.simulation.records.values()), None)
    task = Task(plant, list(fitter.simulation.views.values()), data, CATALOGUE, parts)
    found = search(fitter, fitter.null(), CATALOGUE)
    left = left_by(fitter, Unseen(fitter, task.views, data.unseen), found.best)[0]
    stood = left_in_views(fitter, found.null)
    assert settled(fitter, task, found, [Evidence(found.best, 0.0)], left, stood) == []


def test_effects_that_share_a_parameter_fit_it_once(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts)
    drag = CATALOGUE["drag"]
    twin = replace(drag, name="twin")
    names = [
        c.name
        for c in fitter.coordinates.of(
            Hypothesis(((drag, drag.forms[0]), (twin, twin.forms[0]))), 1.0
        )
    ]
    fitter.close()
    assert len(names) == len(set(names))


def test_an_answer_that_replays_worse_is_none() -> None:
    found = decide([fit_of(0.0), fit_of(-500.0, "drag")], Outstanding(0.0), Chances(), worse=True)
    assert found.verdict == "unknown"


def test_a_better_point_about_an_end_is_found_where_residuals_stand_out(
    plant: Plant, parts: Path
) -> None:
    fitter = fitter_of(plant, parts)
    null = fitter.null()
    known, cells = prior(null.point.coordinates), tuple(fitter.simulation.cells)
    problem = Problem(fitter.simulation, fitter.rules, cells, known)
    ended = Solution(null.point, null.residuals, null.columns)
    assert probed(problem, ended, null.noise) is None
    at = [c.name for c in null.point.coordinates].index("F_c")
    theta = null.point.theta.copy()
    theta[at] -= 5.0  # spreads: 10 % of the friction
    away = null.point.moved(theta)
    start = Solution(away, *fitter.simulation.linearised(away, cells, set(known.names)))
    better = probed(problem, start, null.noise)
    fitter.close()
    assert better is not None
    weighing = Weighing(null.noise, fitter.rules)
    before, after = (sum(weighing.costs(x.residuals).values()) for x in (start, better))
    assert after < before - 10


def wandering(name: str, seed: int, **truth: float) -> Record:
    """A record whose speed has an error of 0.03 m/s that lasts 0.3 s; only it is measured."""
    own, signal = record(name, seed, **truth), Signal("v", "v", 0.0, error=0.03, lasting=0.3)
    whiten = quoted(0.0, signal.error, signal.lasting / PERIOD)
    error = whiten.drawn(np.random.default_rng(seed).standard_normal(own.rows))
    return replace(own, signals={"v": own.signals["v"] + error})


@pytest.mark.parametrize(("drag", "verdict"), [(0.0, "none"), (6.0, "identified")])
def test_an_error_that_is_quoted_is_noise_and_an_effect_is_not(
    plant: Plant, parts: Path, drag: float, verdict: str
) -> None:
    rules, few = Rules(), {k: CATALOGUE[k] for k in ("drag", "mass", "leak")}
    erring = replace(plant, signals=(Signal("v", "v", SIGMA["v"], error=0.03, lasting=0.3),))
    data = Data(
        tuple(wandering(n, k, drag=drag) for k, n in enumerate(("one", "two"))),
        wandering("held", 3, drag=drag),
    )
    views = build_views(erring, ["v"], parts, PERIOD, rules)
    found = run(Task(erring, views, data, few, parts), rules).diagnosis
    assert found.verdict == verdict
    assert [c.key for c in found.causes if c.probability > 0.5] == (["drag"] if drag else [])


def test_an_effect_that_does_nothing_brings_nothing_on_a_record_that_no_fit_saw(
    plant: Plant, parts: Path
) -> None:
    fitter = fitter_of(plant, parts, drag=2.0)
    null = fitter.null()
    idle = CATALOGUE["leak"]
    same = fitter.explore(null.hypothesis.plus(idle, idle.forms[0]), null)
    views = list(fitter.simulation.views.values())
    held = Predictor(fitter, views, record("held", 3, drag=2.0))
    (gain,) = held.gains([same], null)
    held.close()
    fitter.close()
    assert abs(gain) < 5


def test_a_search_that_was_cut_short_says_what_is_left_only_where_the_answer_does() -> None:
    def said(verdict: str, cut: bool) -> str:
        fit = cast(Fit, None)
        decision = Decision(verdict, (), (), 0.0, 0.5, fit)
        return " ".join(_cut_short(Search(fit, fit, (), (), cut=cut), decision))

    assert said("unknown", False) == ""
    assert "explains all" in said("unknown", True)
    assert "cut short" in said("identified", True)
    assert "explains all" not in said("identified", True)
