"""Fig. 5.6 and 5.7 from the FMU, against closed forms and against the FMU's own closed loop."""

from __future__ import annotations

import json
import math
from pathlib import Path

import control
import numpy as np
import pytest

from controllers.mbpm_comp import MbpmComp
from controllers.pi_fv import PiFv
from modelica_fmu.errors import InputError
from pneugantry.analysis.closed_loop import (
    CONTINUOUS,
    cosimulated_growth,
    cosimulated_limit,
)
from pneugantry.analysis.controller_model import controller_model
from pneugantry.analysis.force_loop import force_loop
from pneugantry.analysis.frequency import margins, response, stability_limit
from pneugantry.analysis.lag import force_gains
from pneugantry.analysis.root_locus import (
    branches,
    closed_poles,
    loop_with_pi,
    pi_block,
    root_locus,
    thesis_gains,
)
from pneugantry.cli import main
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario
from pyfmi_runner.sensors import SensorParams

PLANT = {"z": (2.25, 40.0, 100.0), "x": (7.3, 74.0, 186.0)}  # m, C, K


@pytest.fixture(scope="module")
def fmu() -> FmuFile:
    return FmuFile.read(build_fmu().path)


def closed_form(axis: str, lag: float) -> control.TransferFunction:
    """docs/explanation/plant.md: K (C_c s + K_c) / ((m s^2 + (C_c + C) s + K_c) (tau s + 1))."""
    m, c, k = PLANT[axis]
    return control.tf(
        [k * 30.0, k * 1e4], np.polymul([m, 30.0 + c, 1e4], [lag, 1.0] if lag else [1.0])
    )


@pytest.mark.parametrize("axis", ["x", "z"])
@pytest.mark.parametrize(
    ("lag", "seconds"), [("none", 0.0), ("z", 0.15), ("x", 0.3), ("0.05", 0.05)]
)
def test_poles_zero_and_response_are_those_of_the_figures(
    fmu: FmuFile, axis: str, lag: str, seconds: float
) -> None:
    loop = force_loop(fmu, axis, lag)
    locus, known = root_locus(loop), closed_form(axis, seconds)
    assert loop.lag == seconds
    assert loop.valve_gain == pytest.approx(PLANT[axis][2], rel=1e-12)
    assert locus.poles == pytest.approx(np.sort_complex(known.poles()), rel=1e-9)
    assert locus.zeros == pytest.approx([-1e4 / 30.0], rel=1e-9)
    w = np.geomspace(0.1, 1e3, 20)
    assert response(loop.plant)(w) == pytest.approx(known(1j * w), rel=1e-9)


def test_thesis_numbers(fmu: FmuFile) -> None:
    locus = root_locus(force_loop(fmu, "z", "none"))
    assert np.round(locus.poles, 1).tolist() == [-15.6 - 64.8j, -15.6 + 64.8j]
    assert round(locus.zeros[0].real) == -333
    assert min(root_locus(force_loop(fmu, "z", "x")).poles, key=abs) == pytest.approx(-10 / 3)


@pytest.mark.parametrize("axis", ["x", "z"])
def test_no_limit_without_lag_and_the_routh_limit_with_it(fmu: FmuFile, axis: str) -> None:
    assert root_locus(force_loop(fmu, axis, "none")).limit is None
    for lag in (0.05, 0.15, 0.3):
        m, c, k = PLANT[axis]
        a3, a2, a1 = m * lag, m + (30 + c) * lag, 30 + c + 1e4 * lag
        routh = (1e4 * a3 - a2 * a1) / (30 * a2 - 1e4 * a3) / k  # a2 (a1 + 30 g) = a3 1e4 (1 + g)
        limit = root_locus(force_loop(fmu, axis, lag)).limit
        assert limit is not None
        assert limit.gain == pytest.approx(routh, rel=1e-9)
        assert max(
            closed_poles(force_loop(fmu, axis, lag).plant, limit.gain).real
        ) == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize(
    ("axis", "lag", "delay"),
    [("z", "z", 0.0), ("z", "x", 0.0), ("x", "x", 0.0), ("z", "z", 0.0025)],
)
def test_fmu_becomes_unstable_within_2_percent_of_the_predicted_gain(
    fmu: FmuFile, axis: str, lag: str, delay: float
) -> None:
    loop = force_loop(fmu, axis, lag, delay=delay)
    locus = root_locus(loop)
    assert locus.limit is not None
    assert locus.sampled_limit is not None
    for limit, period in ((locus.sampled_limit, locus.period), (locus.limit, CONTINUOUS)):
        below, above, own = cosimulated_limit(loop, limit.gain, period=period)
        assert below.rate < 0 < above.rate
        assert own == pytest.approx(limit.gain, rel=2e-3)


def test_growth_and_frequency_are_predicted(fmu: FmuFile) -> None:
    loop = force_loop(fmu, "z", "z")
    for gain in (0.045, 0.054, 0.058):
        slowest = np.log(max(closed_poles(loop.sampled(1e-3), gain), key=abs)) / 1e-3
        found = cosimulated_growth(loop, gain)
        assert found.rate == pytest.approx(slowest.real, abs=1e-3)
        assert found.frequency == pytest.approx(abs(slowest.imag), rel=1e-4)


@pytest.mark.parametrize("factor", [0.98, 1.02])
def test_the_projects_own_loop_and_controller_have_the_same_limit(
    fmu: FmuFile, factor: float
) -> None:
    limit = root_locus(force_loop(fmu, "z", "z")).sampled_limit
    assert limit is not None
    gains = force_gains("z", factor * limit.gain, 0.0)
    scenario = Scenario(
        workpiece="straight",
        start_z=0.04,
        gains=gains,
        clamped=("x",),
        plant={"axis_z.friction.law": 1.0},
        f_nd=32.5,
        phases={"approach": (0.0, 3.0), "contact": (3.0, 9.0), "contour": (9.0, 10.0)},
        sensors=SensorParams(noise=False),
    )
    force = run_scenario(scenario, fmu).log["f_z"]
    early, late = np.ptp(force[4000:5000]), np.ptp(force[8000:9000])
    assert (late > early) == (factor > 1)


def test_pade_error_is_stated_and_shrinks_with_the_order(fmu: FmuFile) -> None:
    loop = force_loop(fmu, "z", "z", delay=0.02)
    found = [root_locus(loop, pade=order) for order in (1, 2, 4)]
    errors = [abs(locus.pade.phase) for locus in found if locus.pade]
    assert errors[0] > 10 * errors[1] > 100 * errors[2]
    assert [len(locus.poles) for locus in found] == [4, 5, 7]
    assert len({locus.limit for locus in found}) == 1


def test_margins_match_python_control(fmu: FmuFile) -> None:
    loop = control.series(pi_block(0.02, 0.08), force_loop(fmu, "z", "z").plant)
    ours = margins(response(loop))
    gain, phase, _, crossing, unity, _ = control.stability_margins(control.ss2tf(loop))
    assert (ours.gain_margin, ours.phase_crossover) == pytest.approx((gain, crossing), rel=1e-4)
    assert (ours.phase_margin, ours.crossover) == pytest.approx((phase, unity), rel=1e-4)


def test_branches_start_at_the_open_loop_poles(fmu: FmuFile) -> None:
    plant = force_loop(fmu, "z", "x").plant
    gains, lines = branches(plant, 1.0, 50)
    assert gains[0] == 0.0
    assert np.sort_complex(lines[0]) == pytest.approx(np.sort_complex(plant.poles()))
    assert np.abs(np.diff(lines, axis=0)).max() < 60


@pytest.mark.parametrize("axis", ["x", "z"])
def test_controller_kernel_is_the_pi_block(fmu: FmuFile, axis: str) -> None:
    w = np.geomspace(0.1, 3e3, 30)
    kernel = controller_model(PiFv(gains=force_gains(axis, *thesis_gains(axis))), axis)
    assert response(kernel)(w) == pytest.approx(
        response(pi_block(*thesis_gains(axis), 1e-3))(w), rel=1e-8
    )
    with pytest.raises(ValueError, match="arrays"):
        controller_model(MbpmComp())


def test_sampled_loop_without_lag_has_a_limit_and_says_so(fmu: FmuFile) -> None:
    seen = force_loop(fmu, "z", "none").sampled()
    limit = stability_limit(response(seen), 1e-3)
    assert limit is not None
    assert limit.frequency == pytest.approx(math.pi / 1e-3)
    assert np.abs(closed_poles(seen, limit.gain)).max() == pytest.approx(1.0)
    assert loop_with_pi(force_loop(fmu, "z", "none")).dt == 1e-3


@pytest.mark.parametrize("lag", ["none", "z", "x", "0.2"])
def test_command_keeps_the_contract(tmp_path: Path, lag: str) -> None:
    out, plot = tmp_path / "locus.json", tmp_path / "locus.png"
    assert (
        main(["rootlocus", "--axis", "z", "--lag", lag, "--json", str(out), "--plot", str(plot)])
        == 0
    )
    report = json.loads(out.read_text())
    assert report["schema"] == "rootlocus/1"
    assert (report["limit_gain"] is None) == (lag == "none")
    assert report["lag"] == {"none": 0.0, "z": 0.15, "x": 0.3, "0.2": 0.2}[lag]
    assert len(report["poles"]) == (2 if lag == "none" else 3)
    assert report["zeros"] == [[pytest.approx(-1000 / 3), 0.0]]
    assert plot.stat().st_size > 10_000


def test_command_verifies_by_cosimulation(tmp_path: Path) -> None:
    out = tmp_path / "locus.json"
    assert (
        main(
            [
                "rootlocus",
                "--axis",
                "x",
                "--delay",
                "0.003",
                "--pade",
                "2",
                "--verify",
                "--json",
                str(out),
            ]
        )
        == 0
    )
    assert all(check["holds"] for check in json.loads(out.read_text())["cosimulated"].values())


@pytest.mark.parametrize(
    "arguments",
    [
        "--lag much",
        "--lag 1e-5",
        "--lag nan",
        "--delay -1",
        "--pade 0",
        "--angle 90",
        "--set axis_z.mm=3",
        "--set contact.K_c=-3",
    ],
)
def test_command_refuses_unusable_input(arguments: str) -> None:
    assert main(["rootlocus", *arguments.split()]) == 2


def test_lag_names_the_mend(fmu: FmuFile) -> None:
    with pytest.raises(InputError, match="use none, x, z or seconds within"):
        force_loop(fmu, "z", "much")
