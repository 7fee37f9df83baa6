"""Inner force loop: by hand, and its time constant on a lagging valve."""

import math

import pytest

from controllers.catalogue import make_controller
from controllers.interface import Reference, Sense

RESTING = Sense(0.9, 0.04, 0.0, 0.0, 0.0, 20.0, 0.0, 0.0)


def test_command_adds_the_force_error_over_the_feedforward():
    sense = RESTING._replace(v_x=-0.05, f_ax=-1.0, f_az=8.0)
    command = make_controller("pi_fv_pressure", k_f=3.0).step(Reference(30.0, -0.06), sense)
    c_x, c_z = 1.0 * -0.01, 0.02 * 10.0
    assert command.u_z == pytest.approx(0.735 + c_z + 3.0 * (100.0 * c_z - 8.0) / 100.0)
    assert command.u_x == pytest.approx(0.635 - (c_x + 3.0 * (186.0 * c_x + 1.0) / 186.0))


def test_without_feedback_it_is_pi_fv(samples, run_python):
    inner = run_python(make_controller("pi_fv_pressure", k_f=0.0), *samples)
    assert inner == pytest.approx(run_python(make_controller("pi_fv"), *samples), abs=1e-12)


def test_inner_loop_closes_at_tau_over_1_plus_k_f():
    controller, f_az = make_controller("pi_fv_pressure", k_f=9.0), 0.0
    for _ in range(15):  # one time constant 0.15 s / (1 + 9), c_z frozen at 0.2 V = 20 N
        controller.reset()
        command = controller.step(Reference(30.0, 0.0), RESTING._replace(f_az=f_az))
        f_az += (100.0 * (command.u_z - 0.735) - f_az) * (1.0 - math.exp(-1e-3 / 0.15))
    assert f_az == pytest.approx(20.0 * (1.0 - math.exp(-1.0)), rel=0.03)


def test_negative_feedback_gain_is_refused():
    with pytest.raises(ValueError, match="k_f must be >= 0, got -1"):
        make_controller("pi_fv_pressure", k_f=-1.0)
