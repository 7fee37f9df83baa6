"""Weights of the decision from rigs whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from pneugantry.engine.calibration.weights import (
    Known,
    calibrated,
    error,
    fitted,
    known_case,
    log_score,
    reliability,
)
from pneugantry.engine.chances import Chances

DRAG = frozenset({"drag"})


def drawn(count: int, seed: int, gain: float) -> list[Known]:
    """Half the rigs have an effect that brings `gain` and more, half leave a chance gain below it;
    a quarter stand out by 0.4, the others by 0.1.
    """
    generator = np.random.default_rng(seed)
    cases = []
    for k in range(count):
        real, odd = k % 2 == 0, k % 4 > 1
        brought = gain * generator.uniform(1.0, 5.0) if real else gain * generator.uniform(0.0, 0.9)
        cases.append(
            Known(
                frozenset({"drag"} if real else ()),
                odd,
                (((), 0.0), (("drag",), -brought)),
                generator.normal(0.4 if odd else 0.1, 0.05),
                DRAG,
            )
        )
    return cases


@pytest.mark.parametrize("gain", [20.0, 120.0])
def test_the_entry_moves_to_where_true_and_chance_gains_part(gain: float) -> None:
    cases = drawn(200, 1, gain)
    found = fitted(cases, Chances())
    assert 0.8 * gain < found.entry < 1.2 * gain
    assert 0.15 < found.unknown_at < 0.35
    assert log_score(cases, found) > log_score(cases, Chances())


def test_what_is_named_beside_something_unknown_is_believed_as_often_as_it_is_true() -> None:
    odd = (((), 0.0), (("drag",), -1000.0))
    for real in (0, 10, 40):
        there = [DRAG if k < real else frozenset() for k in range(40)]
        cases = [Known(effects, True, odd, 5.0, DRAG) for effects in there]
        found = fitted(cases, Chances(beside=0.5)).beside
        assert found == pytest.approx(real / 40, abs=0.1)


def test_what_cannot_look_like_the_unknown_says_nothing_of_what_may() -> None:
    odd = (((), 0.0), (("drag",), -1000.0))
    cases = [Known(DRAG, True, odd, 5.0, frozenset())] * 40
    assert fitted(cases, Chances()).beside == pytest.approx(Chances().beside, abs=1e-3)
    (claim,) = (b for b in reliability(cases, [Chances()] * 40) if b.what == "effect")
    assert claim.said == pytest.approx(1.0)


def test_unseen_rigs_score_as_well() -> None:
    found = fitted(drawn(100, 1, 60.0), Chances())
    assert log_score(drawn(400, 2, 60.0), found) > -0.25


def test_a_case_is_read_from_truth_and_answer() -> None:
    truth = {
        "kind": "both",
        "causes": [
            {"effect": "drag", "axis": "x", "known": True},
            {"effect": "moth", "axis": "", "known": False},
        ],
    }
    answer = {"weighed": [{"effects": [], "cost": 0.0}, {"effects": ["drag/x"], "cost": -80.0}]}
    left = {"stands_out": 0.5, "stood_out": 0.9}
    case = known_case(truth, {**answer, **left, "doubtful": ["drag/x"]})
    assert (case.stands_out, case.stood_out) == (0.5, 0.9)
    assert case.doubtful == {"drag/x"}
    assert case.effects == {"drag/x"}
    assert case.unknown
    assert case.weighed == (((), 0.0), (("drag/x",), -80.0))


def test_rigs_left_out_show_what_weights_are_worth() -> None:
    cases = drawn(100, 3, 60.0)
    found = calibrated(cases, Chances())
    assert found.rigs == 100
    assert found.score > found.before
    assert error(found.reliability) < 0.1


def test_claims_are_counted_by_what_they_say() -> None:
    """Two rigs of which the weights are sure: one claim of each is right, one wrong."""
    sure = (((), 0.0), (("drag",), -1000.0))
    cases = [
        Known(DRAG, False, sure, -5.0, DRAG),
        Known(frozenset(), False, sure, -5.0, DRAG),
    ]
    table = {b.what: b for b in reliability(cases, [Chances()] * 2) if b.said > 0.5}
    assert table["effect"].claims == 2
    assert table["effect"].right == 0.5
    assert error(reliability(cases, [Chances()] * 2)) == pytest.approx(1 / 3, abs=0.01)
