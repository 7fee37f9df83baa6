"""Scores: what counts as right, block by block and kind by kind, and what calibration means."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pneugantry.blind import check, sets
from pneugantry.blind.score import TARGETS, calibration_error, judged, score
from pneugantry.cli import main

Z = {"effect": "presliding", "axis": "z", "block": "friction_z", "known": True}
X = {"effect": "valve_lag", "axis": "x", "block": "valve_x", "known": True}
C = {"effect": "contact_stiffness", "axis": "", "block": "contact", "known": True}
SUPPLY = {
    "effect": "supply_cycling",
    "axis": "",
    "block": "valve_x",
    "blocks": ["valve_x", "valve_z"],
    "known": False,
}


def truth(kind: str, *causes: dict) -> dict[str, Any]:
    return {"kind": kind, "causes": list(causes), "visibility": 5.0}


def answer(verdict: str, *causes: tuple[dict, float], where: str = "", **more: Any) -> dict:
    named = [c for c, p in causes if p >= 0.5]
    keys = [f"{c['effect']}/{c['axis']}" if c["axis"] else c["effect"] for c in named]
    return {
        "verdict": verdict,
        "where": [{"block": where}] if where else [],
        "causes": [{**c, "probability": p} for c, p in causes],
        "answer_set": [keys],
        "gap": {"shrink": 0.9},
        "seconds": 4.0,
        **more,
    }


@pytest.mark.parametrize(
    ("case", "given", "right"),
    [
        (truth("one", Z), answer("identified", (Z, 0.9)), True),
        (truth("one", Z), answer("identified", (Z, 0.9), (X, 0.1)), True),
        (truth("one", Z), answer("identified", (Z, 0.9), (X, 0.8)), False),  # a spurious second
        (truth("one", Z), answer("unknown", (Z, 0.9)), False),  # not identified
        (truth("one", Z), answer("identified", (X, 0.9), (Z, 0.6)), False),
        (truth("two", Z, X), answer("identified", (Z, 0.9), (X, 0.9)), True),
        (truth("two", Z, X), answer("identified", (Z, 0.9)), False),
        (truth("three", Z, X, C), answer("identified", (Z, 0.9), (X, 0.9), (C, 0.7)), True),
        (truth("none"), answer("none"), True),
        (truth("none"), answer("unknown"), False),
        (truth("unknown", SUPPLY), answer("unknown"), True),
        (truth("unknown", SUPPLY), answer("unknown", (Z, 0.9)), False),
        (truth("both", Z, SUPPLY), answer("unknown", (Z, 0.9)), True),
        (truth("both", Z, SUPPLY), answer("identified", (Z, 0.9)), False),
    ],
)
def test_an_answer_is_right_when_it_names_the_truth_and_nothing_else(
    case: dict, given: dict, right: bool
) -> None:
    assert judged("case", case, given).right is right


def test_a_common_cause_has_two_right_blocks() -> None:
    case = truth("unknown", SUPPLY)
    for where, right in (("valve_x", True), ("valve_z", True), ("sensors", False), ("", False)):
        assert judged("case", case, answer("unknown", where=where)).block is right


def test_a_failed_diagnosis_says_why() -> None:
    said = judged("7", truth("none"), {**answer("failed"), "reason": "z.csv: z: is missing"})
    assert not said.right
    assert said.text.endswith(": z.csv: z: is missing")


def test_the_answer_set_must_hold_the_whole_truth() -> None:
    case = truth("both", Z, SUPPLY)
    assert judged("a", case, answer("unknown", answer_set=[["unknown", "presliding/z"]])).held
    assert not judged("b", case, answer("unknown", answer_set=[["unknown"]])).held
    assert judged("c", truth("none"), answer("none", answer_set=[[]])).held


def test_three_effects_are_judged_by_all_right_and_by_none_wrong() -> None:
    cases = {name: truth("three", Z, X, C) for name in "abc"}
    answers = {
        "a": answer("identified", (Z, 0.9), (X, 0.9), (C, 0.9)),
        "b": answer("identified", (Z, 0.9), (X, 0.9)),
        "c": answer("identified", (Z, 0.9), ({**X, "axis": "z"}, 0.9)),
    }
    table = score(cases, answers).table
    assert table["three effects, all right"] == pytest.approx(1 / 3)
    assert table["three effects, none wrong"] == pytest.approx(2 / 3)


def test_rows_without_a_case_are_not_a_number_and_every_target_has_a_row() -> None:
    result = score({"a": truth("none")}, {"a": answer("none", gap=None)})
    assert set(result.table) == set(TARGETS)
    assert result.table["false cause on none"] == 0.0
    assert np.isnan(result.table["cause right, one effect"])
    assert np.isnan(result.table["calibration error of P(none)"])
    assert np.isnan(result.table["shrink, median"])


def test_probabilities_of_none_and_unknown_are_scored_like_the_rest() -> None:
    cases = {"a": truth("none"), "b": truth("unknown", SUPPLY)}
    answers = {
        "a": answer("none", probabilities={"none": 0.9, "unknown": 0.05}),
        "b": answer("unknown", probabilities={"none": 0.1, "unknown": 0.8}),
    }
    table = score(cases, answers).table
    assert table["calibration error of P(none)"] == pytest.approx(0.1)
    assert table["calibration error of P(unknown)"] == pytest.approx((0.05 + 0.2) / 2)


def test_calibration_error_is_0_for_honest_and_large_for_boastful_claims() -> None:
    rng = np.random.default_rng(0)
    chances = rng.random(20_000)
    honest = [(float(p), bool(rng.random() < p)) for p in chances]
    assert calibration_error(honest) < 0.02
    assert calibration_error([(0.99, bool(rng.random() < 0.5)) for _ in range(2000)]) > 0.4


def test_a_faint_half_is_told_from_a_visible_one() -> None:
    cases = {str(k): {**truth("one", Z), "visibility": float(k)} for k in range(8)}
    answers = {str(k): answer("identified", (Z if k >= 4 else X, 0.9)) for k in range(8)}
    assert [share for _, share, _ in score(cases, answers).by_severity] == [0.0, 0.0, 1.0, 1.0]


def test_the_commands_results_keep_to_their_schemas(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    keeps_to_schema: Callable[[dict], None],
) -> None:
    """With cases that nobody simulates and answers that nobody computes."""
    cases = {"1": truth("one", Z), "2": truth("none")}
    answers = {"1": answer("identified", (Z, 0.9)), "2": answer("identified", (X, 0.8))}
    monkeypatch.setattr(check, "draw_cases", lambda *_: "5ea1")
    monkeypatch.setattr(check, "diagnose_cases", lambda *_: answers)
    monkeypatch.setattr(check, "unseal", lambda *_: cases)
    monkeypatch.setattr(sets, "write_cases", lambda *_: None)
    capsys.readouterr()
    assert main(["blind", "--cases", "2", "--out", str(tmp_path), "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    keeps_to_schema(found)
    assert len(found["confusions"]) == 1
    assert main(["blind", "--cases", "2", "--write", str(tmp_path), "--json", "-"]) == 0
    keeps_to_schema(json.loads(capsys.readouterr().out))


def test_the_score_counts_right_and_wrong_as_they_are() -> None:
    cause = {"effect": "presliding", "axis": "z", "block": "friction_z", "probability": 0.9}
    good = {
        "verdict": "identified",
        "where": [{"block": "friction_z"}],
        "causes": [cause],
        "answer_set": [["presliding/z"]],
        "gap": {"shrink": 0.9},
        "seconds": 10.0,
    }
    nothing = {
        "verdict": "none",
        "where": [],
        "causes": [],
        "answer_set": [[]],
        "gap": None,
        "seconds": 5.0,
    }
    labels = {
        "1": {"kind": "one", "causes": [cause], "visibility": 3.0},
        "2": {"kind": "none", "causes": []},
        "3": {"kind": "one", "causes": [cause]},
    }
    result = score(labels, {"1": good, "2": nothing, "3": nothing})
    assert result.table["cause right, one effect"] == 0.5
    assert result.table["false cause on none"] == 0.0
    assert result.table["answer set holds the truth"] == pytest.approx(2 / 3)
    assert len(result.confusions) == 1
