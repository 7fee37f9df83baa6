"""The FMU's own solver against a tight integration of the same derivatives, itself and CVode:
benchmarks/solver_check.py in short.
"""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import solver_check
from benchmarks.solver_check import (
    CONVERGED,
    MODES,
    accuracy,
    convergence,
    cvode,
    event_gap,
    in_sigma,
    own_solver,
    printed,
    programme,
    reference,
    replays,
)
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile

MOST = 0.01  # sigma, what is granted to the default step
SHORT = (  # log, law on z, seconds, changes of mode that must occur
    (
        "free_motion",
        "vdfm",
        2.2,
        ("axis_x.friction.stick", "axis_z.friction.stick", "axis_z.at_high"),
    ),
    ("contact_steps", "vdfm", 1.3, ("axis_z.friction.stick", "contact.touching")),
    ("contact_steps", "ddfm", 0.8, ("contact.touching",)),
    ("contour_straight", "vdfm", 3.7, ("axis_z.friction.stick", "contact.touching")),
)


@pytest.fixture(scope="module")
def fmus():
    return {fmi: build_fmu(fmi=fmi).path for fmi in ("2.0", "3.0")}


@pytest.fixture(scope="module")
def file(fmus):
    return FmuFile.read(fmus["2.0"])


@pytest.fixture(scope="module")
def logs():
    return replays()


@pytest.mark.parametrize(("log", "law", "stop", "changing"), SHORT)
def test_trajectory_and_event_instants_are_those_of_a_tight_integration(
    log, law, stop, changing, file, logs
):
    run = logs[log].with_law(law).until(stop)
    own, ref = own_solver(file, run, modes=True), reference(file, run)
    error, where = in_sigma(own.outputs, ref.outputs)
    assert error < MOST, where
    assert {MODES[i] for _, i, _ in own.events} >= set(changing)
    events, gap = event_gap(own, ref)
    assert events >= len(changing)
    assert gap <= 1e-6


def test_the_reference_is_converged_itself(file, logs):
    run = logs["contact_steps"].with_law("ddfm").until(0.6)
    assert in_sigma(reference(file, run).outputs, reference(file, run, rtol=1e-9).outputs)[0] < 1e-4


@pytest.mark.parametrize(
    ("log", "law", "stop"), [("free_motion", "ddfm", 2.9), ("contact_steps", "lugre", 0.8)]
)
def test_the_error_falls_sixteenfold_as_the_step_is_halved(log, law, stop, file, logs):
    found = convergence(file, logs[log].with_law(law).until(stop))
    assert found["ratios"]
    assert all(13 < ratio < 19 for ratio in found["ratios"]), found
    assert found["floor"] < 1e-5


@pytest.mark.parametrize("law", ["vdfm", "ddfm"])
def test_the_default_step_is_converged_on_every_log(law, file, logs):
    for run in logs.values():
        run = run.with_law(law)
        fine = own_solver(file, run, {"solver.max_step": 2e-4, "solver.tolerance": 1e6})
        error, where = in_sigma(own_solver(file, run).outputs, fine.outputs)
        assert error < MOST, (run.name, where)


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize(
    ("log", "law", "stop"),
    [("contact_steps", "vdfm", 1.3), ("contact_steps", "ddfm", 1), ("free_motion", "vdfm", 2)],
)
def test_cvode_through_model_exchange_gives_the_same_trajectory(
    fmi, log, law, stop, fmus, file, logs
):
    run = logs[log].with_law(law).until(stop)
    error, where = in_sigma(cvode(fmus[fmi], run), own_solver(file, run).outputs)
    assert error < MOST, where


def test_fmi_3_steps_bit_for_bit_as_fmi_2(fmus, file, logs):
    run = logs["contact_steps"].until(1.3)
    assert np.array_equal(
        own_solver(FmuFile.read(fmus["3.0"]), run).outputs, own_solver(file, run).outputs
    )


def test_the_error_control_bites_where_the_step_is_too_long(file, logs):
    run = logs["contact_steps"].with_law("ddfm").until(0.8)
    converged = own_solver(file, run, CONVERGED).outputs
    tolerances = (1e6, 1e-4, 1e-7)
    errors = [
        in_sigma(own_solver(file, run, {"solver.tolerance": t}).outputs, converged)[0]
        for t in tolerances
    ]
    assert errors[0] > errors[1] > 10 * errors[2]


def test_the_study_prints_its_figures_and_runs_without_a_campaign(
    tmp_path, monkeypatch, capsys, fmus, file
):
    runs = {name: run.until(0.6) for name, run in programme().items()}
    assert accuracy(file, runs["contact_steps"])["error"] < MOST
    monkeypatch.setattr(
        solver_check,
        "replays",
        lambda campaign: {name: runs[name] for name in ("contact_steps", "free_motion")},
    )
    monkeypatch.setattr(solver_check, "build_fmu", lambda fmi, out: SimpleNamespace(path=fmus[fmi]))
    monkeypatch.setattr(solver_check, "CONVERGENCE", (("contact_steps", "ddfm"),))
    monkeypatch.setattr(solver_check, "CVODE", (("contact_steps", "vdfm", 0.3),))
    solver_check.main(
        ["--campaign", str(tmp_path / "none"), "--json", str(tmp_path / "figures.json")]
    )
    table = json.loads((tmp_path / "figures.json").read_text())
    assert printed(table) == capsys.readouterr().out.rstrip("\n")
    assert table["campaign"] == "own programme"
    assert all(math.isfinite(row["gap"]) for row in table["accuracy"].values())
