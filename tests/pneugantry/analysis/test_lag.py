"""Bandwidth, Smith predictor and stick-slip: predictions against the co-simulated FMU."""

from __future__ import annotations

import control
import numpy as np
import pytest

from pneugantry.analysis.controller_model import controller_model
from pneugantry.analysis.force_loop import ForceLoop, force_loop
from pneugantry.analysis.frequency import response
from pneugantry.analysis.lag import PEAK, RATIOS, lag_row, smith_controller, smith_reach, smith_rows
from pneugantry.analysis.root_locus import thesis_gains
from pneugantry.analysis.stick_slip import StickSlip, cosimulated_cycle, predicted_cycle
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario
from pyfmi_runner.sensors import SensorParams


@pytest.fixture(scope="module")
def fmu() -> FmuFile:
    return FmuFile.read(build_fmu().path)


@pytest.fixture(scope="module")
def loop(fmu: FmuFile) -> ForceLoop:
    return force_loop(fmu, "z", "z")


def test_lag_costs_bandwidth(fmu: FmuFile) -> None:
    rows = [lag_row(force_loop(fmu, "z", lag)) for lag in ("none", "z", "x")]
    widths = [row.thesis.bandwidth or 0.0 for row in rows]
    best = [row.best.margins.bandwidth or 0.0 for row in rows]
    assert widths[0] > 4 * widths[1] > 4 * widths[2]
    assert best[0] > 10 * best[1] > 10 * best[2]
    assert all(row.best.margins.sensitivity_peak == pytest.approx(PEAK, rel=1e-2) for row in rows)


def test_smith_predictor_with_the_right_model_leaves_the_lag_free_loop(
    loop: ForceLoop, fmu: FmuFile
) -> None:
    w = np.geomspace(0.1, 1e3, 40)
    k_p, k_i = thesis_gains("z")
    model = controller_model(smith_controller(loop, 1.0, k_p, k_i))
    with_it = response(control.series(model, loop.sampled()))(w)
    free = response(force_loop(fmu, "z", "none").sampled())(w)
    pi = k_p + k_i * 1e-3 / (np.exp(1j * w * 1e-3) - 1)
    lagged = response(loop.sampled())(w)
    assert with_it / (1 + with_it) == pytest.approx(pi * lagged / (1 + pi * free), rel=1e-6)


def test_smith_predictor_buys_gain_margin_and_costs_bandwidth(
    loop: ForceLoop, fmu: FmuFile
) -> None:
    plain = lag_row(loop).thesis
    rows = smith_rows(loop, *thesis_gains("z"))
    assert rows
    for row in rows:
        assert row.stable
        assert (row.margins.gain_margin or 0.0) > 5 * (plain.gain_margin or 0.0)
        assert (row.margins.bandwidth or 0.0) < 0.5 * (plain.bandwidth or 0.0)


def test_smith_predictor_survives_a_wrong_lag_at_high_gain(loop: ForceLoop) -> None:
    assert smith_reach(loop, RATIOS) > 50
    k_p, k_i = thesis_gains("z")
    assert all(row.stable for row in smith_rows(loop, 50 * k_p, 50 * k_i))


def test_smith_predictor_is_refused_without_a_lag(fmu: FmuFile) -> None:
    with pytest.raises(ValueError, match="z force loop with a lag"):
        smith_rows(force_loop(fmu, "z", "none"), 0.02, 0.08)


def smith_swing(fmu: FmuFile, loop: ForceLoop, ratio: float, factor: float) -> float:
    """Swing of u_z [V] four seconds after a small step, the FMU in contact under the Smith
    predictor with scaled gains of Table 4.6.
    """
    k_p, k_i = thesis_gains("z")
    controller = smith_controller(loop, ratio, factor * k_p, factor * k_i)
    scenario = Scenario(
        workpiece="straight",
        start_z=0.04,
        clamped=("x",),
        plant={"axis_z.friction.law": 1.0},
        f_nd=26.6,
        sensors=SensorParams(noise=False),
        phases={"approach": (0.0, 3.0), "contact": (3.0, 8.0), "contour": (8.0, 8.1)},
    )
    return float(np.ptp(run_scenario(scenario, fmu, controller=controller).log["u_z"][7000:8000]))


@pytest.mark.parametrize("ratio", [0.5, 1.5])
def test_smith_limit_with_a_wrong_lag_is_the_fmus_own(
    fmu: FmuFile, loop: ForceLoop, ratio: float
) -> None:
    """About the smallest factor on the thesis' gains at which the linear loop turns unstable; the
    sampled FMU agrees.
    """
    k_p, k_i = thesis_gains("z")
    low, high = 1.0, 400.0
    for _ in range(30):
        middle = (low * high) ** 0.5
        stable = smith_rows(loop, middle * k_p, middle * k_i, [ratio])[0].stable
        low, high = (middle, high) if stable else (low, middle)
    assert smith_swing(fmu, loop, ratio, 0.98 * low) < 1e-5
    assert smith_swing(fmu, loop, ratio, 1.02 * low) > 1.0


@pytest.mark.parametrize("v_td", [-0.0125, -0.02, -0.036])
def test_stick_slip_cycle_is_predicted_to_one_percent(fmu: FmuFile, v_td: float) -> None:
    axis = StickSlip(fmu, v_td)
    ours, theirs = predicted_cycle(axis), cosimulated_cycle(axis)
    assert ours is not None
    assert theirs is not None
    assert theirs.period == pytest.approx(ours.period, rel=0.01)
    assert theirs.peak == pytest.approx(ours.peak, rel=0.01)
    assert theirs.stuck == pytest.approx(ours.stuck, abs=0.01)


def test_no_stick_slip_at_higher_speed(fmu: FmuFile) -> None:
    axis = StickSlip(fmu, -0.04)
    assert predicted_cycle(axis) is None
    assert cosimulated_cycle(axis) is None
