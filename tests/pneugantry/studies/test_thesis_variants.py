"""Variants of what the thesis does not print, short."""

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from pneugantry.thesis.conditions import CHOICE, NO_FRICTION, Run
from pneugantry.thesis.runner import Results, run_one
from pneugantry.thesis.tables import ablation_run
from pneugantry.thesis.variants import (
    VARIANTS,
    Tried,
    printed_no_lag,
    variant_lines,
    variant_report,
    variant_runs,
)
from pneugantry.thesis.verdicts import Range, Share
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile

SCHEMAS = Path(__file__).parents[3] / "docs" / "reference" / "schemas"
BY_NAME = {v.name: v for v in VARIANTS}


def test_a_case_overrides_what_its_variant_sets():
    setting = BY_NAME["LuGre on z"].setting(0)
    run = setting.applied(ablation_run("incline_7", "no Coulomb friction"))
    assert dict(run.plant)["axis_z.friction.law"] == dict(NO_FRICTION)["axis_z.friction.law"]
    assert dict(setting.applied(Run()).plant) == {"axis_z.friction.law": 4.0}
    assert setting.applied(Run()).finish == "random"


def test_the_first_variant_is_the_choice_and_every_run_of_it_is_asked_once_a_draw():
    assert VARIANTS[0].choice == CHOICE
    assert len(BY_NAME) == len(VARIANTS)
    one, two = (set(variant_runs(VARIANTS[0], draws)) for draws in (1, 2))
    assert one < two
    assert all(v.source for v in VARIANTS)


def test_without_lag_the_printed_contact_damping_leaves_more_error_than_the_choice():
    """What conclusion 4 hangs on: docs/results/thesis.md."""
    fmu, results = FmuFile.read(build_fmu().path), Results()
    rmse = []
    for name in ("K_c 5e4, C_c 150", "K_c 5e4, C_c 30"):
        run = ablation_run("incline_7", "no lag").changed(choice=BY_NAME[name].choice)
        results.done[run] = run_one(run, fmu)
        rmse.append(results[run].rmse_fn)
    printed = printed_no_lag()["incline_7"]
    assert printed == 1.2
    assert abs(rmse[1] - printed) < abs(rmse[0] - printed)


def test_report_keeps_to_its_schema():
    tried = Tried(
        VARIANTS[0],
        {4: Share(1, 2), 13: Share(2, 2)},
        Range(0.5, 0.4, 0.6),
        {"incline_7": 1.0},
        dict.fromkeys((-5.0, -10.0, -15.0, -20.0, -25.0), (0.1, 0.2)),
    )
    report = json.loads(json.dumps(variant_report([tried])))
    schema = json.loads((SCHEMAS / "thesis_variants.json").read_text(encoding="utf-8"))
    Draft202012Validator(schema).validate(report)
    assert report["variants"][0]["held"] == {"4": 1, "13": 2}
    assert any("50%" in line for line in variant_lines([tried]))
    assert report["variants"][0]["pull"][1] == {
        "angle": -10.0,
        "cut_f_n": pytest.approx(0.1),
        "cut_v_t": pytest.approx(0.2),
    }
