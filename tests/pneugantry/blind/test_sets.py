"""Sets of cases on disk: campaign as a rig's computer writes it, truth beside it, repeatable."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from modelica_fmu.errors import InputError
from pneugantry.blind import set_names
from pneugantry.blind.sets import SETS, TRUTH, named_set, write_case
from pneugantry.cli import main
from pneugantry.truth.case import CaseSet
from pneugantry.truth.odd_rigs import ODD_RIGS, OddRigs
from pneugantry.truth.parameters import CHANNELS
from pyfmi_runner.plant import SHAPES
from pyfmi_runner.workpiece import WORKPIECES

QUICK = CaseSet("quick", {"one": 1.0}, logs=("contact_steps",), missing=("f_ax",))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_case(tmp_path_factory.mktemp("set"), QUICK, 78950)


def test_a_case_is_a_campaign_with_its_truth_beside_it(written: Path) -> None:
    assert {path.name for path in written.iterdir()} == {
        "campaign.toml",
        "contact_steps.parquet",
        TRUTH,
    }
    truth = json.loads((written / TRUTH).read_text())
    assert truth["schema"] == "truth/1"
    assert (truth["set"], truth["kind"], truth["seed"]) == ("quick", "one", 78950)
    assert len(truth["causes"]) == 1
    assert truth["tolerance"]["standoff"] != 0.0


def test_the_campaign_says_the_stand_off_that_the_rig_does_not_have(written: Path) -> None:
    described = tomllib.loads((written / "campaign.toml").read_text())["log"]["contact_steps"]
    assert described["standoff"] == 0.04


def test_the_missing_channel_is_no_column_and_readings_are_rounded(written: Path) -> None:
    frame = pd.read_parquet(written / "contact_steps.parquet")
    assert list(frame.columns) == ["time", "u_x", "u_z", *[c for c in CHANNELS if c != "f_ax"]]
    steps = frame["f_z"].astype(float) / 0.01
    assert (steps - steps.round()).abs().max() < 1e-2


def test_a_seed_gives_the_same_campaign_again(written: Path, tmp_path: Path) -> None:
    again = write_case(tmp_path, QUICK, 78950)
    for name in (TRUTH, "campaign.toml"):
        assert (again / name).read_text() == (written / name).read_text()
    pd.testing.assert_frame_equal(
        pd.read_parquet(again / "contact_steps.parquet"),
        pd.read_parquet(written / "contact_steps.parquet"),
    )


def test_every_named_set_plans_its_seeds() -> None:
    for name, case_set in SETS.items():
        if isinstance(case_set, CaseSet):
            kinds = {case_set.plan(seed).kind for seed in range(78900, 78960)}
            beside = {"none": "one", "one": "two"}  # what every rig has
            expected = {beside[k] if case_set.always else k for k in case_set.mixture}
            assert kinds == expected, name


def test_odd_rigs_are_off_in_one_thing_each() -> None:
    odd = OddRigs()
    plans = {rig.name: odd.plan(place) for place, rig in enumerate(ODD_RIGS)}
    assert plans["standoff"].standoff == 5e-4
    plain = plans["standoff"].rig
    assert np.allclose(
        plans["dead_points"].rig.axis["offset"] / plain.axis["offset"], [1.016, 0.988]
    )
    assert np.std(list(plans["wide_tolerance"].tolerance.values())) > 0.03
    assert [c.size for c in plans["supply_cycling"].causes] == [0.03]
    for name, field, value in (("noise", "noise", 1.4), ("hum", "hum", 0.1)):
        assert plans[name].rig.sensor[field].max() == value
    assert {plan.kind for plan in plans.values()} == {"none", "one", "unknown"}
    with pytest.raises(ValueError, match=r"seed must be 0\.\.8"):
        odd.plan(9)


def test_an_unknown_set_is_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="expected one of plain, nuisance"):
        named_set("ordinary")
    assert main(["blind", "--set", "ordinary"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_help_names_every_set_and_every_workpiece_and_no_other() -> None:
    assert list(set_names.SETS) == list(SETS)
    assert tuple(SHAPES) == WORKPIECES
