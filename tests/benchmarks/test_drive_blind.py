"""The second plant's blind check: its table and calibration error from answers made up by hand."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.drive_blind import as_json, main
from pneugantry.engine.chances import Chances


def answer(verdict: str, cost: float, probability: float) -> dict[str, Any]:
    """One that weighed a stiffness of this cost against nothing."""
    causes = [{"effect": "stiffness", "axis": "", "probability": probability}]
    return {
        "verdict": verdict,
        "where": [{"block": "joint"}],
        "causes": causes if probability else [],
        "answer_set": [["stiffness"]] if probability else [[]],
        "gap": {"shrink": 0.9},
        "seconds": 3.0,
        "weighed": [
            {"effects": [], "cost": 0.0},
            {"effects": ["stiffness"], "cost": cost},
        ],
        "stands_out": 0.0,
        "probabilities": {"none": 1 - probability, "unknown": 0.0},
    }


def test_the_table_counts_and_weights_that_believe_too_much_show_as_an_error() -> None:
    cause = {"effect": "stiffness", "axis": "", "block": "joint", "known": True}
    truths = {
        "1": {"kind": "one", "causes": [cause]},
        "2": {"kind": "none", "causes": []},
        "3": {"kind": "none", "causes": []},
    }
    answers = {
        "1": answer("identified", -500.0, 1.0),
        "2": answer("none", 0.0, 0.0),
        "3": answer("identified", -60.0, 0.84),
    }
    found = as_json(truths, answers, Chances(temper=20.0, entry=80.0))
    assert found["kinds"] == {"none": 2, "one": 1}
    assert found["table"]["cause right, one effect"] == 1.0
    assert found["table"]["false cause on none"] == 0.5
    assert len(found["confusions"]) == 1
    assert found["errors"]["calibrated"] < found["errors"]["defaults"]


@pytest.mark.parametrize(("option", "value"), [("--cases", "0")])
def test_no_cases_are_refused_in_one_line(
    option: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([option, value, "--rigs", "0"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
