"""PI FV against a slow oracle, hand-computed values and a recorded run."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from controllers.catalogue import make_controller
from controllers.interface import Reference, Sense
from controllers.pi_fv import PiFv

CAMPAIGN = Path(__file__).resolve().parents[3] / "shared" / "campaigns" / "nominal"
K_P = {"Kp_vx": 1.0, "Kp_fz": 0.02, "Kp_fx": 0.01, "Kp_vz": 0.5}
K_I = {"Ki_vx": 4.0, "Ki_fz": 0.08, "Ki_fx": 0.03, "Ki_vz": 2.0}
GAINS = K_P | K_I


def at_rest(f_x: float = 0.0, f_z: float = 0.0, v_x: float = 0.0, v_z: float = 0.0) -> Sense:
    return Sense(0.95, 0.04, v_x, v_z, f_x, f_z, 0.0, 0.0)


def oracle(references: np.ndarray, senses: np.ndarray) -> np.ndarray:
    """The law of docs/explanation/plant.md, with lists of errors summed anew at each sample."""
    taken = {"vx": [], "fz": [], "fx": [], "vz": []}
    commands = []
    for (f_nd, v_td), (_, _, v_x, v_z, f_x, f_z, _, _) in zip(references, senses, strict=True):
        theta = 0.0 if math.hypot(f_x, f_z) < 2.0 else math.atan2(-f_x, f_z)
        e_fn = f_nd - (f_z * math.cos(theta) - f_x * math.sin(theta))
        e_vt = v_td - (v_x * math.cos(theta) + v_z * math.sin(theta))
        error = {
            "fz": e_fn * math.cos(theta),
            "vz": e_vt * math.sin(theta),
            "fx": -e_fn * math.sin(theta),
            "vx": e_vt * math.cos(theta),
        }
        part = {
            k: GAINS[f"Kp_{k}"] * error[k] + GAINS[f"Ki_{k}"] * 0.001 * math.fsum(taken[k])
            for k in taken
        }
        u_x = 0.635 - (part["vx"] + part["fx"])
        u_z = 0.735 + (part["fz"] + part["vz"])
        for k, errors in taken.items():
            rise = (
                error[k] if k.endswith("z") else -error[k]
            )  # what the error does to the command of its axis
            u = u_z if k.endswith("z") else u_x
            if (0.0 <= u <= 5.0) or (u > 5.0 and rise <= 0.0) or (u < 0.0 and rise >= 0.0):
                errors.append(error[k])
        commands.append((min(max(u_x, 0.0), 5.0), min(max(u_z, 0.0), 5.0)))
    return np.array(commands)


def test_commands_equal_the_oracle(samples, run_python):
    references, senses = samples
    np.testing.assert_allclose(
        run_python(PiFv(), references, senses), oracle(references, senses), rtol=0.0, atol=1e-11
    )


def test_first_sample_on_a_flat_edge_is_proportional_only():
    command = PiFv().step(Reference(30.0, -0.06), at_rest(f_z=20.0, v_x=-0.01))
    assert command.u_x == pytest.approx(0.635 - 1.0 * -0.05)  # tracking to -x raises u_x
    assert command.u_z == pytest.approx(0.735 + 0.02 * 10.0)


def test_second_sample_adds_one_rectangle_of_the_first_error():
    controller = PiFv()
    controller.step(Reference(30.0, -0.06), at_rest(f_z=20.0))
    command = controller.step(Reference(30.0, -0.06), at_rest(f_z=25.0))
    assert command.u_z == pytest.approx(0.735 + 0.02 * 5.0 + 0.08 * 10.0 * 1e-3)
    assert command.u_x == pytest.approx(0.635 + 1.0 * 0.06 + 4.0 * 0.06 * 1e-3)


def test_errors_are_split_over_the_axes_on_a_slope_of_30_deg():
    s, c = math.sin(math.radians(30.0)), math.cos(math.radians(30.0))
    sense = at_rest(
        f_x=-20.0 * s, f_z=20.0 * c, v_x=-0.05 * c, v_z=-0.05 * s
    )  # f_n = 20 N, v_t = -0.05 m/s
    command = PiFv().step(Reference(30.0, -0.06), sense)
    assert command.u_z == pytest.approx(0.735 + 0.02 * 10.0 * c + 0.5 * -0.01 * s)
    assert command.u_x == pytest.approx(0.635 - (1.0 * -0.01 * c + 0.01 * -10.0 * s))


def test_angle_is_0_below_2_newton():
    command = PiFv().step(Reference(30.0, 0.0), at_rest(f_x=-1.9))
    assert command.u_z == pytest.approx(0.735 + 0.02 * 30.0)
    assert command.u_x == 0.635


def test_saturated_axis_takes_only_errors_that_bring_the_command_back():
    controller = PiFv()
    controller.step(Reference(30.0, 0.0), at_rest(f_z=100.0))  # u_z = 0.735 - 1.4 < 0: clipped at 0
    assert controller.state.i_fz == 0.0
    controller.step(Reference(400.0, 0.0), at_rest(f_z=100.0))  # u_z = 6.735 > 5: clipped at 5
    assert controller.state.i_fz == 0.0
    controller.step(Reference(30.0, 5.0), at_rest(f_z=30.0))  # u_x = -4.365 < 0
    assert controller.state.i_vx == 0.0


def test_saturated_axis_still_takes_the_error_of_its_other_integrator_that_brings_it_back():
    s = math.sqrt(0.5)  # 45 deg: e_fz > 0 clips u_z at 5 V while e_vz < 0 pulls it down
    controller = PiFv()
    controller.step(Reference(500.0, -0.06), at_rest(f_x=-30.0 * s, f_z=30.0 * s))
    assert controller.state.i_fz == 0.0
    assert controller.state.i_vz == pytest.approx(2.0 * 1e-3 * -0.06 * s)


def test_gains_of_a_campaign_give_the_same_controller_as_table_3_11():
    assert make_controller("pi_force_velocity", gains=GAINS).params == PiFv().params


def test_derivative_gains_are_refused():
    with pytest.raises(ValueError, match=r"v_z\.k_d must be 0 in a PI controller, got 0.05"):
        PiFv(gains="table_3_5")


@pytest.mark.skipif(not CAMPAIGN.exists(), reason=f"no recorded runs at {CAMPAIGN}")
@pytest.mark.parametrize("log", ["contour_straight", "contour_curved"])
def test_recorded_run_is_replayed_to_its_rounding(log, run_compiled):
    table = pd.read_parquet(CAMPAIGN / f"{log}.parquet")
    table = table[table.time >= 3.0 - 1e-6]
    senses = table[["x", "z", "v_x", "v_z", "f_x", "f_z", "f_ax", "f_az"]].to_numpy(float)
    references = np.column_stack(
        [np.full(len(table), 30.0), np.where(table.time < 7.0 - 1e-6, 0.0, -0.06)]
    )
    difference = run_compiled(PiFv(), references, senses) - table[["u_x", "u_z"]].to_numpy(float)
    assert (
        np.abs(difference).max() < 2e-4
    )  # V; the log rounds u to 1e-4 V and f to 0.01 N (2e-4 V at K_p)
    assert np.sqrt((difference**2).mean()) < 8e-5  # V; measured 6.7e-5
