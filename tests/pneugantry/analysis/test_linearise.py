"""The linearised FMU against both interfaces, co-simulated steps and closed forms."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from modelica_fmu.errors import InputError, RunError
from pneugantry.analysis.finite_differences import agreement, differenced_model, stepped_model
from pneugantry.analysis.force_loop import force_loop
from pneugantry.analysis.gantry_points import (
    POINTS,
    axis_contact,
    contact_sliding,
    contact_stuck,
    free_sliding,
)
from pneugantry.analysis.linearise import (
    active_part,
    linearise,
    linearise_here,
    sampled,
    without_lag,
)
from pneugantry.analysis.operating_point import OperatingPoint, open_at, point_of, settle, solve
from pneugantry.analysis.point_file import read_point, write_point
from pneugantry.cli import main
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile

MATRICES = "ABCD"


@pytest.fixture(scope="module")
def fmu() -> FmuFile:
    return FmuFile.read(build_fmu().path)


@pytest.mark.parametrize("name", POINTS)
def test_model_exchange_and_cosimulation_give_the_same_bits(fmu: FmuFile, name: str) -> None:
    point = POINTS[name](fmu)
    exchange, stepped = (linearise(fmu, point, kind=kind) for kind in ("me", "cs"))
    assert all(np.array_equal(getattr(exchange, m), getattr(stepped, m)) for m in MATRICES)


@pytest.mark.parametrize("name", POINTS)
def test_agrees_with_differences_of_cosimulated_steps_to_1e_6(fmu: FmuFile, name: str) -> None:
    point = POINTS[name](fmu)
    model = linearise(fmu, point)
    assert (
        agreement(model, stepped_model(fmu, point, model.input_labels, model.output_labels)) < 1e-6
    )


@pytest.mark.parametrize("name", POINTS)
def test_agrees_with_differences_of_the_rates_to_1e_6(fmu: FmuFile, name: str) -> None:
    point = POINTS[name](fmu)
    model = linearise(fmu, point)
    assert (
        agreement(model, differenced_model(fmu, point, model.input_labels, model.output_labels))
        < 1e-6
    )


def test_agrees_with_the_neutral_effects_switched_on(fmu: FmuFile) -> None:
    effects = {
        "valve_z.droop": 0.1,
        "valve_x.lag_low": 1.6,
        "valve_x.lag_high": 0.5,
        "contact.hardening": 20.0,
        "coupling": 0.5,
        "axis_x.friction.position_bow": 0.2,
        "axis_z.friction.load": 0.02,
        "contact.mu": 0.05,
        "contact.v_drag": 0.05,
    }
    straight = contact_sliding(fmu, parameters=effects)
    point = replace(straight, parameters=straight.parameters | {"workpiece.extra_angle": 0.01})
    model = linearise(fmu, point)
    assert (
        agreement(model, differenced_model(fmu, point, model.input_labels, model.output_labels))
        < 1e-6
    )


def test_linearising_a_running_session_leaves_no_trace(fmu: FmuFile) -> None:
    with open_at(fmu, contact_stuck(fmu), "cs") as session:
        session.set("u_z", 2.0)
        for _ in range(50):
            session.step(1e-3)
        before = session.serialise()
        model = linearise_here(session)
        assert session.serialise() == before
        point = point_of(session)
    again = linearise(fmu, point)
    assert all(np.array_equal(getattr(model, m), getattr(again, m)) for m in MATRICES)


def test_sliding_one_way_has_the_poles_of_no_coulomb_friction(fmu: FmuFile) -> None:
    smooth = axis_contact(fmu)
    sliding = replace(
        smooth,
        states=smooth.states | {"axis_z.v": 0.03},
        parameters=smooth.parameters | {"axis_z.friction.law": 2.0},
    )
    models = [
        active_part(linearise(fmu, point, ["u_z"], ["f_n"]), ["u_z"], ["f_n"])
        for point in (smooth, sliding)
    ]
    assert all(np.array_equal(getattr(models[0], m), getattr(models[1], m)) for m in MATRICES)


def test_stuck_in_the_band_passes_no_force_to_the_workpiece(fmu: FmuFile) -> None:
    model = linearise(fmu, contact_stuck(fmu), ["u_z"], ["f_n"])
    assert active_part(model, ["u_z"], ["f_n"]).nstates == 0


def test_valve_state_as_input_is_the_plant_without_its_valve(fmu: FmuFile) -> None:
    point = axis_contact(fmu)
    bare = active_part(linearise(fmu, point, ["valve_z.f_a"], ["f_n"]), ["valve_z.f_a"], ["f_n"])
    full = linearise(fmu, point, ["u_z"], ["f_n"])
    reduced = active_part(without_lag(full, "valve_z.f_a"), ["u_z"], ["f_n"])
    assert np.allclose(reduced.A, bare.A, rtol=1e-14, atol=0)
    assert np.allclose(reduced.B, 100.0 * bare.B, rtol=1e-14, atol=0)


def test_settled_and_solved_points_are_the_same(fmu: FmuFile) -> None:
    solved = axis_contact(fmu, f_n=26.5)
    away = replace(
        solved,
        states={
            "axis_x.s": solved.states["axis_x.s"],
            "axis_z.s": solved.states["axis_z.s"] + 1e-3,
        },
    )
    found = settle(fmu, away)
    for name, value in solved.states.items():
        assert found.states[name] == pytest.approx(value, abs=1e-9 * max(1.0, abs(value)))


def test_solved_points_hold_in_cosimulation(fmu: FmuFile) -> None:
    for point, drift in (
        (contact_sliding(fmu), ("axis_x.s", "axis_z.s")),
        (free_sliding(fmu), ("axis_x.s", "axis_z.s")),
    ):
        with open_at(fmu, point, "cs") as session:
            start = session.get(["f_n", "v_x", "v_z"])
            for _ in range(100):
                session.step(1e-3)
            assert session.get(["f_n", "v_x", "v_z"]) == pytest.approx(start, abs=1e-8)
            assert all(session.get(name) != point.states[name] for name in drift)


def test_a_point_the_valve_cannot_hold_is_refused_with_a_reason(fmu: FmuFile) -> None:
    with pytest.raises(RunError, match=r"no operating point with contact\.f_n"):
        contact_sliding(fmu, angle=math.radians(-50.0))
    with pytest.raises(RunError, match=r"has not settled after 0\.5 s"):
        settle(fmu, OperatingPoint(inputs={"u_z": 1.05}), limit=0.5)


def test_solve_meets_its_equations(fmu: FmuFile) -> None:
    point = solve(
        fmu,
        axis_contact(fmu),
        ["u_z", "valve_z.f_a"],
        {"valve_z.f_target": 50.0, "der(valve_z.f_a)": 0.0},
    )
    assert point.inputs["u_z"] == pytest.approx(0.735 + 0.5)
    assert point.states["valve_z.f_a"] == pytest.approx(50.0)


@pytest.mark.parametrize("delay", [0.0, 0.0004, 0.001, 0.0027])
def test_sampled_model_with_dead_time_is_the_cosimulated_loop(fmu: FmuFile, delay: float) -> None:
    point = axis_contact(fmu)
    fine = replace(point, parameters=point.parameters | {"solver.max_step": 1e-4})
    model = sampled(
        active_part(linearise(fmu, point, ["u_z"], ["f_n"]), ["u_z"], ["f_n"]), 1e-3, delay
    )
    commands = np.random.default_rng(1).uniform(-0.05, 0.05, 40)
    x, ours = np.zeros((model.nstates, 1)), []
    for u in commands:
        ours.append(float((model.C @ x)[0, 0]))
        x = model.A @ x + model.B * u
    theirs, instants = (
        [],
        sorted({*range(0, 40000, 1000), *(1000 * k + round(delay * 1e6) for k in range(40))}),
    )
    with open_at(fmu, fine, "cs") as session:
        base, level = point.inputs["u_z"], session.get("f_n")
        for now, then in zip(instants, [*instants[1:], instants[-1] + 1000], strict=True):
            if now % 1000 == 0 and now < 40000:
                theirs.append(session.get("f_n") - level)
            acting = (now - round(delay * 1e6)) // 1000
            session.set("u_z", base + (commands[acting] if acting >= 0 else 0.0))
            session.step((then - now) * 1e-6, time=now * 1e-6)
    assert ours == pytest.approx(theirs, abs=1e-8)


def test_sampled_refuses_a_period_or_delay_out_of_range(fmu: FmuFile) -> None:
    with pytest.raises(ValueError, match="period must be > 0 s"):
        sampled(force_loop(fmu).plant, 0.0)


def test_point_files_read_back_equal_and_name_what_is_wrong(fmu: FmuFile, tmp_path: Path) -> None:
    path, point = tmp_path / "state.json", contact_sliding(fmu)
    write_point(point, path)
    assert read_point(path, fmu) == point
    for text, complaint in (
        ("{", "is no JSON"),
        ('{"states": {"axis_z.q": 1}}', "did you mean axis_z"),
        ('{"inputs": {"u_z": "a"}}', "inputs.u_z: is 'a', expected a number"),
        ('{"parameters": {"contact.K_c": -1}}', "parameters.contact.K_c: is -1"),
        ('{"state": {}}', "state: unknown key"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=complaint):
            read_point(path, fmu)


def test_command_writes_matrices_that_read_back(tmp_path: Path, fmu: FmuFile) -> None:
    out, state = tmp_path / "model.json", tmp_path / "state.json"
    assert (
        main(
            [
                "linearize",
                "--point",
                "contact_stuck",
                "--save",
                str(state),
                "--json",
                str(out),
                "--check",
                "--delay",
                "0.0015",
            ]
        )
        == 0
    )
    report = json.loads(out.read_text())
    assert report["schema"] == "linearize/1"
    assert np.array_equal(report["A"], linearise(fmu, read_point(state, fmu)).A)
    assert len(report["sampled"]["A"]) == len(report["A"]) + 4
    assert (
        main(["linearize", "--at", str(state), "--inputs", "valve_z.f_a", "--outputs", "f_n"]) == 0
    )
    assert main(["linearize", "--inputs", "nonsense"]) == 2
