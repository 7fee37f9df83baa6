"""Evidence counted by the stretches that bear it out, and the contest it decides."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pneugantry.diagnosis.bench import BLOCK, Choice, Outcome
from pneugantry.diagnosis.decide import Hypothesis, Weights, _answers, _left_views, contest, decide
from pneugantry.diagnosis.evidence import (
    QUIET,
    Search,
    Trial,
    advantage,
    borne_out,
    misfit,
    steady_strength,
    strength,
    trouble,
)
from pneugantry.diagnosis.fit import Fit, tolerance_coordinate
from pneugantry.engine.catalogue import Effect, read_catalogue

Array = NDArray[np.float64]
CATALOGUE = read_catalogue()
VIEW = "valve_z"
STRETCHES = 100


def outcome(blocks: Array, *keys: str) -> Outcome:
    fit = Fit((), np.zeros(0), np.zeros((0, 0)), float(blocks.sum()), {})
    choice = Choice(tuple((CATALOGUE[key], CATALOGUE[key].forms[0]) for key in keys))
    count = BLOCK * len(blocks)
    return Outcome(
        choice,
        fit,
        {VIEW: float(blocks.sum())},
        {VIEW: count},
        {VIEW: 1.0},
        (VIEW,),
        {VIEW: 1.0},
        {VIEW: blocks},
    )


def searched(null: Array, *trials: tuple[Array, tuple[str, ...]]) -> Search:
    found = Search({VIEW: outcome(null)}, {VIEW}, lengths={VIEW: 1.0})
    for blocks, keys in trials:
        o = outcome(blocks, *keys)
        gain = found.null[VIEW].evidence(found.lengths) - o.evidence(found.lengths)
        (found.singles if len(keys) == 1 else found.pairs).append(Trial(o.choice, o, gain))
    return found


def noise(seed: int, size: float = 1.0) -> Array:
    return size * np.random.default_rng(seed).chisquare(BLOCK, STRETCHES)


def test_evidence_that_every_stretch_bears_out_stands_whole() -> None:
    assert borne_out(np.full(50, 3.0)) == 1.0
    assert strength(np.full(50, 3.0)) == pytest.approx(150.0)


def test_evidence_of_one_stretch_is_worth_four() -> None:
    one = np.zeros(50)
    one[7] = 4000.0
    assert strength(one) == pytest.approx(4.0)


def test_one_stretch_that_is_far_ahead_does_not_make_the_others_say_less() -> None:
    differences = np.full(50, 2.0)
    differences[7] = 4000.0
    assert strength(differences) < 5.0
    assert steady_strength(differences) == pytest.approx(100.0)
    assert steady_strength(-differences) == pytest.approx(-100.0)
    alone = np.where(differences > 2, differences, 0.0)
    assert steady_strength(alone) == pytest.approx(4.0)
    assert steady_strength(np.zeros(0)) == 0.0


def test_an_offset_of_one_standard_deviation_is_trouble_for_all_that_it_is_one_and_the_same() -> (
    None
):
    """Its residual is one long correlated stretch: in its own independent samples it would count as
    a few.
    """
    offset = np.random.default_rng(2).standard_normal((STRETCHES, BLOCK)) + 1.0
    null = outcome((offset**2).sum(axis=1))
    null.lengths[VIEW] = 5000.0
    assert misfit(null, VIEW) < QUIET < trouble(null, VIEW)
    assert trouble(outcome(noise(2)), VIEW) <= QUIET


def test_evidence_of_noise_keeps_its_size() -> None:
    """Under the truth a difference G of -2 log likelihood has the spread 2 sqrt(G): nothing is
    cut.
    """
    generator = np.random.default_rng(1)
    shift = 0.3  # a mean that one hypothesis knows, in each of 4,000 stretches
    x = generator.standard_normal(4000) + shift
    difference = x**2 - (x - shift) ** 2
    assert strength(difference) == pytest.approx(difference.sum(), rel=0.1)


def test_advantage_changes_its_sign_with_the_sides() -> None:
    found = searched(
        noise(1, 1.5), (noise(2), ("valve_lag/z",)), (noise(3, 1.2), ("valve_delay/z",))
    )
    a, b = (t.outcome for t in found.singles)
    assert advantage(found, a, b) == pytest.approx(-advantage(found, b, a))
    assert advantage(found, a, None) > advantage(found, b, None) > 0


def test_an_effect_that_explains_all_is_identified_and_one_that_explains_nothing_is_not() -> None:
    found = searched(
        noise(1, 2.0), (noise(2), ("valve_lag/z",)), (noise(1, 1.99), ("valve_delay/z",))
    )
    decision = decide(found)
    assert decision.verdict == "identified"
    assert decision.hypotheses[0].keys == ("valve_lag/z",)
    assert decision.hypotheses[0].probability > 0.9
    assert decision.answer_set == [["valve_lag/z"]]


def test_two_effects_that_explain_alike_share_the_answer() -> None:
    null = noise(1, 2.0)
    decision = decide(searched(null, (noise(2), ("valve_lag/z",)), (noise(2), ("valve_delay/z",))))
    assert decision.verdict == "ambiguous"
    assert sorted(decision.answer_set) == [["valve_delay/z"], ["valve_lag/z"]]


def test_what_no_effect_explains_is_unknown() -> None:
    decision = decide(searched(noise(1, 4.0), (noise(1, 3.9), ("valve_lag/z",))))
    assert decision.verdict == "unknown"
    assert decision.unknown_view == VIEW


def test_a_second_effect_must_pay_its_cost() -> None:
    single = noise(2)
    pair = single - np.full(STRETCHES, 0.02)
    found = searched(
        noise(1, 2.0), (single, ("valve_lag/z",)), (pair, ("valve_lag/z", "valve_delay/z"))
    )
    decision = decide(found)
    assert decision.hypotheses[0].keys == ("valve_lag/z",)
    costs = [
        Weights().cost(t.choice if t is not None else None)
        for t in (None, found.singles[0], found.pairs[0])
    ]
    assert costs == sorted(costs)
    assert costs[0] == 0.0


def test_a_rough_form_of_what_the_catalogue_lacks_makes_it_unknown_and_says_what_it_resembles() -> (
    None
):
    decision = decide(
        searched(
            noise(1, 2.0), (noise(2), ("swinging_spool/z",)), (noise(1, 1.9), ("valve_lag/z",))
        )
    )
    assert decision.verdict == "unknown"
    assert decision.resembles is CATALOGUE["swinging_spool/z"]
    assert decision.answer_set == [["unknown"]]
    assert not any("swinging_spool/z" in h.keys for h in decision.hypotheses)


def test_a_rough_form_no_better_than_an_effect_of_the_catalogue_gives_way() -> None:
    null, same = noise(1, 2.0), noise(2)
    decision = decide(searched(null, (same, ("swinging_spool/z",)), (same, ("valve_delay/z",))))
    assert decision.verdict == "identified"
    assert decision.hypotheses[0].keys == ("valve_delay/z",)


def test_the_log_that_no_fit_has_seen_tells_two_like_effects_apart() -> None:
    found = searched(noise(1, 2.0), (noise(2), ("valve_lag/z",)), (noise(2), ("valve_delay/z",)))
    found.held_out = outcome(noise(4, 2.0))
    found.singles[0].held_out, found.singles[1].held_out = outcome(noise(5)), outcome(noise(5, 1.5))
    decision = decide(found)
    assert decision.verdict == "identified"
    assert decision.hypotheses[0].keys == found.singles[0].choice.keys


def test_unknown_stands_in_the_answer_set_by_its_probability() -> None:
    ranked = [
        Hypothesis((key,), p, None)
        for key, p in (("valve_lag/z", 0.8), ("valve_gain/z", 0.01), ("valve_offset/z", 0.01))
    ]
    assert _answers(ranked, 0.18) == [["valve_lag/z"], ["unknown"]]
    assert _answers(ranked, 0.001) == [["valve_lag/z"], ["valve_gain/z"], ["valve_offset/z"]]
    assert _answers(ranked[:1], 0.9) == [["unknown"], ["valve_lag/z"]]


def test_what_only_the_unseen_log_shows_is_unknown() -> None:
    found = searched(noise(2))
    found.troubled = set()
    assert decide(found).verdict == "none"
    found.held_out = outcome(noise(4, 2.0))
    decision = decide(found)
    assert decision.verdict == "unknown"
    assert decision.unknown_view == VIEW


def test_what_the_readings_show_by_themselves_is_the_verdict_whatever_an_effect_explains() -> None:
    found = searched(noise(1, 2.0), (noise(2), ("valve_lag/z",)))
    odd = Effect("excess_noise", "", "sensors", "more noise", (), outside=True)
    decision = decide(found, odd=odd)
    assert decision.verdict == "unknown"
    assert decision.resembles is odd
    assert decision.answer_set == [["unknown"]]
    assert decision.hypotheses[0].probability < 0.05


def test_the_views_in_which_something_is_left_are_named() -> None:
    assert decide(searched(noise(1, 2.0), (noise(3, 1.9), ("valve_lag/z",)))).left == {VIEW}
    assert decide(searched(noise(1, 2.0), (noise(2), ("valve_lag/z",)))).left == frozenset()


def test_what_a_hypothesis_alone_disturbs_is_not_left_by_the_rig() -> None:
    found = searched(noise(2), (noise(1, 2.0), ("valve_lag/z",)))
    assert _left_views(found, found.singles[0], Weights()) == frozenset()


def test_a_fit_that_leaves_more_than_tolerance_alone_is_no_hypothesis() -> None:
    null = noise(2)
    found = searched(null, (null + 1.0, ("valve_lag/z",)))
    found.held_out, found.singles[0].held_out = outcome(noise(4, 1.2)), outcome(noise(4))
    assert [t for t, _ in contest(found)] == [None]


def test_less_strained_tolerance_is_no_evidence_against_the_likelihood() -> None:
    """Evidence is cut view by view and may change its sign thereby; the side that the likelihood
    takes does not.
    """
    mass = tolerance_coordinate("axis_z.m", 2.0, 0.02)
    strained = Fit((mass,), np.array([6 * mass.spread]), np.diag([mass.spread**2]), 0.0, {})
    even, burst = np.full(STRETCHES, float(BLOCK)), np.full(STRETCHES, float(BLOCK))
    found = searched(even)
    found.null = {
        "valve_x": _both(even, even, strained),
        "valve_z": _both(even, even, Fit((), np.zeros(0), np.zeros((0, 0)), 0.0, {})),
    }
    found.lengths = {"valve_x": 1.0, "valve_z": 1.0}
    burst[5] += 60.0
    stuck = _both(even - 0.05, burst, Fit((), np.zeros(0), np.zeros((0, 0)), 0.0, {}))
    assert advantage(found, stuck, None) < 4.0  # 36 of tolerance that it does not strain
    calm = _both(even - 0.05, even, stuck.fit)
    assert advantage(found, calm, None) > 36.0


def _both(of_x: Array, of_z: Array, fit: Fit) -> Outcome:
    blocks = {"valve_x": of_x, "valve_z": of_z}
    counts = {view: BLOCK * len(b) for view, b in blocks.items()}
    squares = {view: float(b.sum()) for view, b in blocks.items()}
    return Outcome(
        Choice(),
        fit,
        squares,
        counts,
        dict.fromkeys(blocks, 1.0),
        tuple(blocks),
        dict.fromkeys(blocks, 1.0),
        blocks,
    )
