"""The diagnosis on rigs of the independent truth plant (development seeds): nothing, and a valve's
delay.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from pneugantry.blind.score import score
from pneugantry.diagnosis.diagnose import diagnose, report_json
from pneugantry.engine.catalogue import read_catalogue
from pneugantry.truth.campaign import write
from pneugantry.truth.case import draw_case, plan_case, run_case
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.fmu import FmuFile


@pytest.fixture(scope="module")
def gantry() -> FmuFile:
    return FmuFile.read(build_fmu().path)


def test_tolerance_alone_is_no_cause(tmp_path: Path, gantry: FmuFile) -> None:
    campaign, _ = draw_case(1021, kind="none")
    write(tmp_path, campaign)
    result = report_json(diagnose(read_campaign(tmp_path), gantry, read_catalogue()))
    assert result["verdict"] == "none"
    assert result["causes"] == []
    assert result["answer_set"] == [[]]


def test_a_valves_delay_is_found_with_its_size_and_closes_the_gap(
    tmp_path: Path, gantry: FmuFile
) -> None:
    campaign, label = run_case(plan_case(1001, "one", 0.02, effects=(("valve_delay", "z"),)))
    write(tmp_path, campaign)
    result = report_json(diagnose(read_campaign(tmp_path), gantry, read_catalogue()))
    assert result["verdict"] == "identified"
    assert (result["causes"][0]["effect"], result["causes"][0]["axis"]) == ("valve_delay", "z")
    assert result["where"][0]["block"] == "valve_z"
    assert result["causes"][0]["parameters"]["valve_z.delay_time"]["value"] == pytest.approx(
        label["causes"][0]["size"], rel=0.05
    )
    assert result["gap"]["log"] == "contour_straight"
    assert result["gap"]["shrink"] > 0.95
    assert result["closed_loop"]["shrink"] > 0.9


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
