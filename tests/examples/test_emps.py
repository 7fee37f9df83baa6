"""The measured axis: rungs beside the published ones, and a short diagnosis."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from examples.emps import closed_loop, idim
from examples.emps.__main__ import DATA, PLANT, PUBLISHED_PARAMETERS
from pneugantry.engine.answer.result import to_json
from pneugantry.engine.hypotheses.catalogue import read_catalogue
from pneugantry.engine.plant import Data, Record
from pneugantry.engine.run import run
from pneugantry.plants.described import described_task
from pyfmi_runner.build import build_fmu
from pyfmi_runner.driven import DrivenFmu
from pyfmi_runner.fmu import FmuFile

ROOT = Path(__file__).resolve().parents[2]

measured = pytest.mark.skipif(
    not DATA.is_dir(), reason="../shared/real/emps is not on this machine"
)


def test_the_nominal_axis_is_a_mass_in_its_loop_without_friction() -> None:
    file = FmuFile.read(build_fmu("EMPS.Axis", ROOT / "models" / "EMPS.mo").path)
    reference = np.full(3000, 0.01)
    nominal, pushed = DrivenFmu(file).run(
        ["offset"], np.array([[0.0], [10.0]]), {"q_ref": reference}, ["q", "u", "friction.F"], 1e-3
    )
    assert nominal[-1, :2] == pytest.approx([0.01, 0.0], abs=1e-6)
    assert not nominal[:, 2].any()
    assert pushed[-1, 1] == pytest.approx(10.0 / 35.1507, rel=1e-4)  # the loop holds the force
    assert 0.01 - pushed[-1, 0] == pytest.approx(10.0 / 35.1507 / 160.18 / 243.45, rel=1e-3)


def test_every_effect_names_parameters_of_the_model_and_sits_at_its_neutral() -> None:
    variables = FmuFile.read(build_fmu("EMPS.Axis", ROOT / "models" / "EMPS.mo").path).variables
    for effect in read_catalogue(PLANT.parent / "effects").values():
        for form in effect.forms:
            assert set(form.settings) <= set(variables)
            for p in form.parameters:
                assert p.name in variables
                assert (
                    p.relative or p.positive or float(variables[p.name].start or 0.0) == p.neutral
                ), p.name


@measured
def test_the_inverse_models_rungs_are_the_published_ones() -> None:
    rungs = idim.ladder(
        *(idim.read_axis(DATA / f"{name}.mat") for name in ("DATA_EMPS", "DATA_EMPS_PULSES"))
    )
    assert [rungs[r].train for r in ("offset", "asymmetric")] == pytest.approx(
        [0.04083, 0.03112], abs=1e-3
    )
    assert rungs["offset"].pulses == pytest.approx(0.05982, abs=0.003)
    assert rungs["offset"].parameters == pytest.approx(PUBLISHED_PARAMETERS["offset"], rel=5e-3)
    errors = [rungs[r].pulses for r in idim.RUNGS]
    assert errors == sorted(errors, reverse=True)


@measured
def test_the_loops_rungs_fall_on_both_records() -> None:
    _, task = described_task(PLANT)
    rungs = closed_loop.ladder(task)
    for log, last in (("train", 0.03), ("pulses", 0.04)):
        errors = [rungs[r].errors[log] for r in idim.RUNGS]
        assert errors == sorted(errors, reverse=True)
        assert errors[-1] < last


def cut(record: Record, rows: int) -> Record:
    """The first rows of a record."""
    return replace(
        record,
        inputs={n: v[:rows] for n, v in record.inputs.items()},
        signals={n: v[:rows] for n, v in record.signals.items()},
    )


@pytest.fixture(scope="module")
def half() -> dict[str, Any]:
    """Diagnosis of half of each record, among six effects."""
    described, task = described_task(PLANT)
    some = (
        "viscous_friction",
        "coulomb_friction",
        "offset",
        "friction_direction",
        "payload",
        "cable_spring",
    )
    assert task.data.held_out is not None
    data = Data((cut(task.data.fitted[0], 12600),), cut(task.data.held_out, 12600))
    task = replace(task, data=data, catalogue={k: task.catalogue[k] for k in some})
    return to_json(run(task, described.rules).diagnosis)


@measured
@pytest.mark.slow
def test_half_the_record_shows_viscous_coulomb_offset_and_then_the_asymmetry(
    half: dict[str, Any],
) -> None:
    assert {step["effect"] for step in half["steps"]} >= {"viscous_friction", "coulomb_friction"}
    assert half["gap"]["log"] == "pulses"
    assert half["gap"]["shrink"] > 0.99


@measured
@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="what six effects leave counts for the only view, u, as logarithms do: 0.54 of the gap "
    "(0.48 until rows that do not count were left out of the fits)",
)
def test_half_the_record_s_gap_lies_in_the_friction(half: dict[str, Any]) -> None:
    assert half["where"][0]["block"] == "friction"
