"""Identification: every test and the joint fit against rigs whose parameters are known."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from test_identify_rig import OFF, STEPS, ramps, rig_campaign

from benchmarks.identify_coverage import Case, coverage, truth_values
from pneugantry.analysis.identify.calibration import PRINTED, calibrate
from pneugantry.analysis.identify.friction_tests import rules
from pneugantry.analysis.identify.hysteresis import hysteresis
from pneugantry.analysis.identify.identification import Identification, identify
from pneugantry.analysis.identify.interval import line, mean
from pneugantry.analysis.identify.joint import reach
from pneugantry.analysis.identify.parameters import DDFM, Coordinates
from pneugantry.analysis.identify.replayed import Plants, ReplayedLog
from pneugantry.analysis.identify.report import as_json, as_text
from pneugantry.analysis.identify.rounding import other_rounding, programmed, quantum
from pneugantry.analysis.identify.sensor_noise import sensor_noise
from pneugantry.analysis.identify.valve import comparisons, steady_line, steps
from pneugantry.cli import main
from pneugantry.truth.parameters import nominal as nominal_rig
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import Campaign, LoggedRun, write_campaign
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import PERIOD, SIGMA, Log

ROOT = Path(__file__).resolve().parents[3]

NOMINAL = ROOT.parent / "shared" / "campaigns" / "nominal"


@pytest.fixture(scope="module")
def fmu() -> FmuFile:
    return FmuFile.read(build_fmu().path)


@pytest.fixture(scope="module")
def plants(fmu: FmuFile) -> Iterator[Plants]:
    with Plants(fmu) as opened:
        yield opened


@pytest.fixture(scope="module")
def campaign(plants: Plants) -> Campaign:
    return rig_campaign(plants, OFF)


@pytest.fixture(scope="module")
def found(campaign: Campaign, fmu: FmuFile) -> Identification:
    return identify(campaign, fmu)


# --- lines and means


def test_line_intervals_hold_the_truth_95_times_in_a_hundred() -> None:
    rng = np.random.default_rng(0)
    x = np.linspace(-10, 10, 9)
    held = 0
    for _ in range(2000):
        fitted = line(x, -17.0 * x + 3.0 + rng.standard_normal(len(x)))
        held += fitted.slope.low < -17.0 < fitted.slope.high
    assert abs(held / 2000 - 0.95) < 0.015


def test_calibration_line_of_the_position_sensor_is_that_of_appendix_b() -> None:
    volts = np.linspace(0.3, 5.8, 12)
    printed = PRINTED["x"]
    fitted = calibrate(volts, printed.slope * volts + printed.offset)
    assert fitted.slope.value == pytest.approx(0.180)
    assert fitted.offset.value == pytest.approx(-0.044)
    assert fitted.r2 == pytest.approx(1.0)


def test_calibration_refuses_a_single_voltage() -> None:
    with pytest.raises(ValueError, match="at different x"):
        calibrate([1.0, 1.0, 1.0], [1.0, 2.0, 3.0])


def test_mean_of_one_test_claims_no_interval() -> None:
    assert math.isinf(mean([3.0]).sigma)


# --- valves


def _lagging(tau: dict[float, float], filling: float = 1.0) -> Campaign:
    """Step tests at positions, with a lag by position; `filling`: its factor while |f_a| rises."""
    logs = {}
    rng = np.random.default_rng(1)
    u = np.repeat([0.65, 0.9, 1.15, 1.35, 1.15, 0.9, 0.65], 1500)
    for position, lag in tau.items():
        force = np.zeros(len(u))
        for k in range(len(u) - 1):
            target = -186.0 * (u[k] - 0.635)
            now = lag * (filling if abs(target) > abs(force[k]) else 1.0)
            force[k + 1] = target + (force[k] - target) * math.exp(-PERIOD / now)
        table = rig_table(u, force + SIGMA["f_ax"] * rng.standard_normal(len(u)), position)
        logs[f"at_{position:g}"] = LoggedRun(STEPS, table)
    return Campaign("valve", Path("valve"), logs)


def rig_table(u: np.ndarray, force: np.ndarray, position: float) -> Log:
    zero = np.zeros(len(u))
    columns = {
        "time": np.arange(len(u)) * PERIOD,
        "u_x": u,
        "u_z": zero,
        "x": zero + position,
        "z": zero,
        "v_x": zero,
        "v_z": zero,
    }
    return Log(
        pd.DataFrame(columns | {"f_x": zero, "f_z": zero, "f_ax": force, "f_az": zero}),
        f"at_{position:g}",
    )


def test_65_percent_rule_and_fit_give_the_lag_of_every_step() -> None:
    rows = steps(_lagging({0.5: 0.2}), "x")
    assert [(round(s.u_from, 2), round(s.u_to, 2)) for s in rows[:3]] == [
        (0.65, 0.9),
        (0.9, 1.15),
        (1.15, 1.35),
    ]
    assert [s.filling for s in rows] == [True] * 3 + [False] * 3
    for s in rows:
        assert s.time_65 == pytest.approx(0.2 * 1.0498, abs=2e-3)
        assert s.tau_65.value == pytest.approx(0.2, abs=2e-3)
        assert s.tau.value == pytest.approx(0.2, abs=4 * s.tau.sigma)


def test_unfinished_plateaus_do_not_shift_the_lag() -> None:
    slow = steps(
        _lagging({0.0: 0.49}), "x"
    )  # 1.5 s are three lags: 5 % of the step are still to come
    assert len(slow) == 6
    for s in slow:
        assert s.tau.value == pytest.approx(0.49, abs=5 * s.tau.sigma)
        assert s.tau_65.value == pytest.approx(0.49, rel=0.02)


def test_lag_that_depends_on_position_is_told_from_one_that_does_not() -> None:
    position, filling = comparisons(steps(_lagging({0.95: 0.145, 0.5: 0.25, 0.05: 0.49}), "x"))
    assert position.p < 1e-3
    assert position.difference.value < -0.2
    position, filling = comparisons(steps(_lagging({0.95: 0.3, 0.5: 0.3, 0.05: 0.3}), "x"))
    assert position.p > 1e-3
    assert filling.p > 1e-3


def test_lag_that_depends_on_filling_is_told() -> None:
    _, filling = comparisons(steps(_lagging({0.95: 0.3, 0.05: 0.3}, filling=1.2), "x"))
    assert filling.p < 1e-6
    assert filling.difference.value == pytest.approx(0.06, abs=0.003)


def test_steady_forces_give_gain_and_offset() -> None:
    fitted = steady_line(steps(_lagging({0.5: 0.2}), "x"))
    assert fitted is not None
    assert -fitted.slope.value == pytest.approx(186.0, abs=0.05)
    assert fitted.zero.value == pytest.approx(0.635, abs=1e-4)


# --- rounded commands


def test_rounded_ramp_of_a_programme_is_drawn_again_exactly() -> None:
    ideal = np.tile(ramps(0.635, 0.935, 2.0), 3)
    recorded = np.round(ideal, 4).astype(np.float32).astype(float)
    assert np.abs(recorded - ideal).max() > 4e-5
    assert np.abs(programmed(recorded) - ideal).max() < 1e-8


def test_commands_of_a_closed_loop_are_left_alone() -> None:
    rng = np.random.default_rng(0)
    recorded = np.round(1.0 + 0.01 * np.cumsum(rng.standard_normal(4000)) / 60, 4)
    assert quantum(recorded) == 1e-4
    assert np.abs(programmed(recorded) - recorded).max() < 1e-12
    moved = other_rounding(np.column_stack([recorded, np.full(4000, 1.05)]), rng)
    assert 1e-5 < np.std(moved[:, 0] - recorded) < 5e-5
    assert (moved[:, 1] == 1.05).all()


# --- friction, contact, noise


def test_rules_of_the_thesis_come_near_the_rig(campaign: Campaign) -> None:
    directions, cables = {"x": -1.0, "z": 1.0}, {"x": 5.0, "z": 5.1}
    values = {
        (r.symbol, r.axis, r.how.split(",")[0]): r.value
        for r in rules(campaign, directions, cables)
    }
    assert values["m", "x", "all slides at once"] == pytest.approx(7.5, rel=0.01)
    assert values["C", "x", "all slides at once"] == pytest.approx(72.0, rel=0.01)
    assert values["F_d", "x", "all slides at once"] == pytest.approx(11.3, rel=0.01)
    assert values["F_s", "x", "start of motion by fit"] == pytest.approx(25.6, rel=0.01)
    assert values["F_s", "z", "start of motion by fit"] == pytest.approx(19.6, rel=0.01)
    assert values["F_s", "x", "Eq. C-1"] > 26.5  # the rule reads the force late
    assert values["K_c", "", "Eq. 4-3"] == pytest.approx(9.7e3, rel=0.01)
    assert values["C_c", "", "Eq. 4-3"] == pytest.approx(31.0, rel=0.05)


def test_hysteresis_gives_beta_and_sigma_of_the_ddfm_and_none_for_the_vdfm(
    plants: Plants, campaign: Campaign
) -> None:
    creeping = rig_campaign(plants, {"axis_z.friction.law": DDFM}, ("pushes",))
    found = hysteresis(creeping, 2.25, 40.0, 5.0)
    assert found is not None
    assert found.presliding
    assert found.beta == pytest.approx(12.0, rel=0.05)
    assert found.sigma == pytest.approx(1e5, rel=0.4)
    banded = hysteresis(campaign, 2.2, 41.0, 5.1)
    assert banded is not None
    assert not banded.presliding


def test_sensor_noise_is_that_of_table_3_3(campaign: Campaign) -> None:
    noise = {n.channel: n for n in sensor_noise(campaign)}
    assert set(noise) >= {"x", "z", "v_x", "v_z", "f_x", "f_z", "f_ax"}
    for n in noise.values():
        assert n.rms == pytest.approx(SIGMA[n.channel], rel=0.06)
        assert n.low < n.rms < n.high


# --- the joint fit


def test_reach_ends_where_a_replay_parts_for_good() -> None:
    residual = np.random.default_rng(0).standard_normal((5000, 4))
    assert reach(residual) == 5000
    passing = residual.copy()
    passing[1000:1100] += 50
    assert reach(passing) == 5000
    passing[3000:] += 50
    assert reach(passing) == 3000


def test_coordinates_keep_what_the_logs_cannot_tell_apart_in_one_direction(fmu: FmuFile) -> None:
    coordinates = Coordinates(fmu)
    theta = coordinates.theta(
        {"axis_x.F_w": 6.0, "axis_x.friction.F_s": 26.0, "axis_x.friction.F_d": 12.0}
    )
    moved = np.flatnonzero(np.abs(theta - coordinates.theta({})) > 1e-12)
    assert [coordinates.names[i] for i in moved] == ["axis_x.F_w"]
    assert coordinates.values(theta)["axis_x.friction.F_s"] == pytest.approx(26.0)


def test_jacobian_by_groups_is_that_of_one_parameter_at_a_time(
    campaign: Campaign, fmu: FmuFile, plants: Plants
) -> None:
    coordinates = Coordinates(fmu)
    log = ReplayedLog(campaign.logs["ramps"], coordinates, plants)
    theta = coordinates.theta(OFF)
    log.jacobian(theta + 1e-9)  # finds the steps
    whole = log.jacobian(theta)
    for name in ("axis_x.C", "axis_z.m", "valve_z.tau"):
        i = coordinates.names.index(name)
        step = np.zeros(len(theta))
        step[i] = 1e-6
        alone = log.vector(log.residual(theta + step) - log.residual(theta - step)) / 2e-6
        assert np.linalg.norm(whole[:, i] - alone) < 0.02 * np.linalg.norm(alone)


def test_joint_fit_finds_every_parameter_within_its_interval(found: Identification) -> None:
    joint, estimates = found.joint, found.joint.estimates()
    assert joint.fits
    assert joint.gap == pytest.approx(1.0, abs=0.02)
    for u in joint.coordinates.unknowns:
        truth = OFF.get(u.name, u.nominal)
        e = estimates[u.name]
        if u.symbol == "v_th":
            continue
        assert e.value == pytest.approx(truth, rel=0.03), u.name
        assert abs(e.value - truth) < 4 * e.sigma, u.name
        if joint.sources[u.name] == "logs":
            assert e.sigma < 0.01 * abs(truth), u.name


def test_cable_force_of_an_axis_pushed_one_way_is_said_to_be_taken(found: Identification) -> None:
    assert found.joint.sources["axis_x.F_w"] == "sheet"
    assert found.joint.sources["axis_z.F_w"] == "logs"
    sums = found.joint.sums()
    assert sums["axis_x.friction.F_s - F_w"].value == pytest.approx(25.6 - 5.0, abs=0.05)
    assert sums["axis_x.friction.F_s - F_w"].sigma < 0.05
    assert any("F_w of x" in note for note in found.notes)


def test_rules_are_freed_of_their_bias(found: Identification) -> None:
    late = next(r for r in found.rules if r.rule.axis == "x" and r.rule.how.startswith("Eq. C-1"))
    assert late.bias > 1.0
    assert late.estimate.value == pytest.approx(25.6, abs=0.5)


def test_report_reads_as_tables_and_as_json(found: Identification) -> None:
    text = "\n".join(as_text(found))
    assert "65 %" in text
    assert "rests on F_w" in text
    parameters = json.loads(json.dumps(as_json(found, 1.0)))["parameters"]
    assert (
        parameters["axis_z.m"]["ci95"][0]
        < parameters["axis_z.m"]["value"]
        < parameters["axis_z.m"]["ci95"][1]
    )


def test_single_log_says_what_it_cannot_tell(
    plants: Plants, tmp_path: Path, keeps_to_schema: Callable[[dict], None]
) -> None:
    folder = tmp_path / "rig"
    write_campaign(rig_campaign(plants, OFF, ("steps",)), folder)
    target = tmp_path / "found.json"
    assert main(["identify", str(folder / "steps.parquet"), "--json", str(target)]) == 0
    found = json.loads(target.read_text())
    keeps_to_schema(found)
    parameters = found["parameters"]
    assert parameters["valve_x.K"]["value"] == pytest.approx(181.0, rel=1e-3)
    assert parameters["axis_x.m"]["value"] is None
    assert parameters["axis_x.m"]["why_not"] == "x is clamped"
    assert parameters["contact.K_c"]["why_not"] == "nothing is touched"


def test_plant_that_does_not_replay_gets_no_intervals(plants: Plants, fmu: FmuFile) -> None:
    late = identify(
        rig_campaign(plants, {"valve_z.delay_time": 0.03, "valve_z.lag_asymmetry": 0.4}), fmu
    )
    assert not late.joint.fits
    assert any("does not replay" in note for note in late.notes)
    parameters = as_json(late, 1.0)["parameters"]
    assert all(p["ci95"] is None for p in parameters.values())
    assert parameters["valve_x.K"]["value"] == pytest.approx(186.0, rel=1e-3)


def test_coverage_table_counts_what_the_logs_tell() -> None:
    names = {"valve_x.K": "logs", "axis_x.F_w": "sheet"}
    cases = [
        Case(
            seed,
            dict.fromkeys(names, 1.0),
            {"valve_x.K": seed > 0, "axis_x.F_w": True},
            dict.fromkeys(names, 0.01),
            names,
            1.0,
            1.0,
        )
        for seed in range(20)
    ]
    table = coverage(cases)
    assert table["all"]["holds"] == pytest.approx(0.95)
    assert float(table["all"]["low"]) < 0.95 < float(table["all"]["high"])
    assert table["axis_x.F_w"]["holds"] == 1.0


def test_truth_rig_is_the_plant_sheet_under_the_names_of_the_fmu(fmu: FmuFile) -> None:
    truth = truth_values(nominal_rig())
    for u in Coordinates(fmu).unknowns:
        assert truth[u.name] == pytest.approx(u.nominal), u.name
    assert truth["axis_x.friction.F_s - F_w"] == pytest.approx(20.0)
    assert truth["axis_z.friction.F_d + F_w"] == pytest.approx(20.0)


@pytest.mark.slow
@pytest.mark.skipif(not NOMINAL.is_dir(), reason="../shared/campaigns is not on this machine")
def test_nominal_campaign_gives_the_plant_sheet(tmp_path: Path) -> None:
    target = tmp_path / "nominal.json"
    assert main(["identify", str(NOMINAL), "--json", str(target)]) == 0
    result = json.loads(target.read_text())
    for name, p in result["parameters"].items():
        near = 0.03 if p["symbol"] in ("F_s", "F_d", "F_w") else 0.01
        assert p["value"] == pytest.approx(p["plant_sheet"], rel=near), name
        assert p["ci95"][0] <= p["plant_sheet"] <= p["ci95"][1], name
