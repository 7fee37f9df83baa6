"""A lagging tachometer: what it says, and what can be known of the carriage behind what it says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pneugantry.diagnosis.bench import Bench
from pneugantry.diagnosis.diagnose import split_campaign
from pneugantry.diagnosis.tachometer import sensed_speed, undone
from pneugantry.truth.campaign import write
from pneugantry.truth.case import plan_case, run_case
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import SIGMA

RNG = np.random.default_rng(11)
TIME = np.arange(6000) * 1e-3
STAGES = (1.0, 3.0, 0.0)


def swinging() -> tuple[np.ndarray, np.ndarray]:
    """Position [m] and speed [m/s] of a carriage that swings at 7 Hz, moves off and stops: what
    contact makes of it.
    """
    speed = 0.03 * np.sin(2 * np.pi * 7 * TIME) * (TIME > 2) + 0.1 * ((TIME > 1) & (TIME < 1.5))
    speed = np.convolve(speed, np.full(20, 0.05), mode="same")
    position = 0.3 + np.concatenate([[0.0], np.cumsum(0.5e-3 * (speed[1:] + speed[:-1]))])
    return position, speed


@pytest.mark.parametrize("stages", STAGES)
def test_every_form_lags_as_long_as_one_stage(stages: float) -> None:
    ramp = np.arange(2000) * 1e-3
    lagged = sensed_speed(ramp, "z", {"sensors.tau_v_z": 0.03, "sensors.stages_v_z": stages})
    assert ramp[-1] - lagged[-1] == pytest.approx(0.03, rel=0.02)


@pytest.mark.parametrize("stages", STAGES)
def test_position_and_speed_are_seen_behind_the_lag(stages: float) -> None:
    position, speed = swinging()
    read = sensed_speed(speed, "z", {"sensors.tau_v_z": 0.037, "sensors.stages_v_z": stages})
    noisy = [RNG.standard_normal(len(TIME)) * SIGMA[name] for name in ("z", "v_z")]
    seen = undone(
        position + noisy[0], read + noisy[1], SIGMA["z"], SIGMA["v_z"], 0.037, round(stages)
    )
    assert np.sqrt(np.mean((seen[0] - position) ** 2)) < 0.2 * SIGMA["z"]
    assert np.sqrt(np.mean((seen[1] - speed) ** 2)) < 0.1 * np.sqrt(np.mean((read - speed) ** 2))


@pytest.mark.parametrize("stages", STAGES)
def test_lags_far_below_a_sample_and_of_hundreds_of_samples_are_undone_too(stages: float) -> None:
    position, speed = swinging()
    noisy = [RNG.standard_normal(len(TIME)) * SIGMA[name] for name in ("z", "v_z")]
    short = [1e-300, 1e-9, *np.geomspace(1e-6, 3e-4, 40), 4.0158e-6, 4.1338e-6]
    for tau in (*short, 0.2 if stages else 0.05):  # a mean over several swings hardly tells of them
        read = sensed_speed(speed, "z", {"sensors.tau_v_z": tau, "sensors.stages_v_z": stages})
        seen = undone(
            position + noisy[0], read + noisy[1], SIGMA["z"], SIGMA["v_z"], tau, round(stages)
        )
        assert (
            np.sqrt(np.mean((seen[0] - position) ** 2)) < (0.1 if tau < 1e-3 else 0.5) * SIGMA["z"]
        )


@pytest.mark.parametrize("stages", STAGES)
def test_a_speed_is_seen_at_the_sample_not_half_of_one_later(stages: float) -> None:
    speed = 1.5 * TIME[:600]
    position = 0.75 * TIME[:600] ** 2
    for tau in (1e-3, 0.02):
        read = sensed_speed(speed, "z", {"sensors.tau_v_z": tau, "sensors.stages_v_z": stages})
        _, seen = undone(position, read, SIGMA["z"], SIGMA["v_z"], tau, round(stages))
        assert np.abs(np.mean((seen - speed)[300:500])) < 0.1e-3  # half a sample would be 0.75e-3


def test_without_a_lag_a_speed_is_read_as_it_is() -> None:
    _, speed = swinging()
    np.testing.assert_array_equal(sensed_speed(speed, "x", {"sensors.tau_v_z": 0.03}), speed)


# by seed of development: the form of the lag of 0.05 s that the case draws, and what the right
# values may leave of z's friction
@pytest.mark.parametrize(("seed", "stages", "most"), [(1006, 0.0, 1.6), (1032, 3.0, 1.2)])
def test_the_right_plant_behind_the_right_lag_leaves_little_in_contact_too(
    seed: int, stages: float, most: float, tmp_path: Path
) -> None:
    """In contact a carriage that is led by its lagging speed swings by itself."""
    case = plan_case(seed, effects=(("velocity_lag", "z"),))
    campaign, label = run_case(case)
    write(tmp_path, campaign)
    fitted, _ = split_campaign(read_campaign(tmp_path))
    with Bench(fitted, FmuFile.read(build_fmu().path)) as bench:
        bench.drive(bench.settle(["valve_z"])["valve_z"].values)
        shares = {
            "axis_z.m": "mass_z",
            "axis_z.C": "viscous_z",
            "axis_z.F_w": "cable_z",
            "axis_z.friction.F_s": "static_z",
            "axis_z.friction.F_d": "dynamic_z",
        }
        rig = {
            name: bench.nominal[name] * label["tolerance"][share] for name, share in shares.items()
        }
        rig |= {
            "sensors.tau_v_z": label["causes"][0]["parameters"]["lag"],
            "sensors.stages_v_z": stages,
        }
        left = np.sqrt(np.mean(bench.white(bench.all["friction_z"], rig) ** 2))
    assert left < most
