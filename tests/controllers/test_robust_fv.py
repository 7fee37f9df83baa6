"""The controller that bears other structures of plant."""

import numpy as np
import pytest

from controllers.interface import Reference, Sense
from controllers.robust_fv import RobustFv, led
from controllers.valve import K_X, K_Z, TAU_Z, U_0Z

AT_REST = Sense(0.6, 0.04, 0.0, 0.0, 0.0, 30.0, 0.0, 30.0)
QUIET = {"share_x": 0.0, "share_z": 0.0, "k_pz": 0.0, "k_i": 0.0, "damping_z": 0.0}


def valve_response(controller: RobustFv, samples: int) -> np.ndarray:
    """f_az [N] of a valve that starts at 0, contact force held at 30 N."""
    f_a, forces = 0.0, []
    for _ in range(samples):
        command = controller.step(Reference(30.0, 0.0), AT_REST._replace(f_az=f_a))
        f_a += (K_Z * (command.u_z - U_0Z) - f_a) * (1.0 - np.exp(-1e-3 / TAU_Z))
        forces.append(f_a)
    return np.array(forces)


def test_the_rate_term_acts_as_a_longer_lag():
    forces = valve_response(RobustFv(**QUIET, k_fz=4.0, k_dz=0.075, t_d=0.001), 200)
    constant = (TAU_Z + 0.075) / 5.0
    assert forces[round(1e3 * constant) - 1] == pytest.approx(30.0 * (1 - np.exp(-1.0)), rel=0.05)
    assert forces[-1] == pytest.approx(30.0, rel=0.02)


def test_the_lead_makes_up_for_a_lag_on_a_ramp_of_friction():
    t, lead, rate, slow, phi = 0.005, 0.03, 100.0, 0.0, 0.0
    for k in range(400):
        phi = rate * 1e-3 * k
        slow += 1e-3 / t * (phi - slow)
    assert led(phi, slow, lead, t, 40.0) == pytest.approx(phi + rate * (lead - t), rel=0.02)
    assert led(100.0, 0.0, lead, t, 40.0) == 40.0  # the lead's part stays within the limit


def test_a_share_of_the_measured_friction_is_asked_for_on_top():
    found = {}
    for share in (0.0, 1.0):
        controller = RobustFv(**(QUIET | {"share_z": share}), lead_z=0.0, k_fz=0.0, k_dz=0.0)
        for _ in range(100):  # 12 N of friction: f_a 42, f_c 30
            command = controller.step(Reference(30.0, 0.0), AT_REST._replace(f_az=42.0))
        found[share] = K_Z * (command.u_z - U_0Z)
    assert found[1.0] - found[0.0] == pytest.approx(12.0, abs=1e-3)


def test_starting_under_force_kicks_neither_command():
    """The rate filter starts at the force that it first sees."""
    pushed = AT_REST._replace(f_ax=-20.0)
    steady, first = RobustFv(k_dx=1.0, k_dz=1.0), RobustFv(k_dx=0.0, k_dz=0.0)
    assert steady.step(Reference(30.0, 0.0), pushed) == first.step(Reference(30.0, 0.0), pushed)


def test_integrals_wait_while_an_axis_is_clipped_and_come_back():
    controller = RobustFv()
    for _ in range(50):
        controller.step(Reference(5000.0, 0.0), AT_REST)
    assert controller.state.i_n == 0.0
    controller.step(Reference(29.0, 0.0), AT_REST)
    assert controller.state.i_n < 0.0


def test_x_pushes_towards_minus_x_for_a_speed_that_is_too_slow():
    command = RobustFv(share_x=0.0, k_fx=0.0).step(Reference(30.0, -0.06), AT_REST)
    assert command.u_x == pytest.approx(0.635 + 127.0 * 0.06 / K_X, rel=1e-6)


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [("t_z", 0.0, "t_z must be >= dt"), ("k_pz", -1.0, "k_pz"), ("k_q", 1.0, "unknown")],
)
def test_unusable_options_are_refused_by_name(option, value, message):
    with pytest.raises(ValueError, match=message):
        RobustFv(**{option: value})
