"""PID FV: PI FV where no gain has a derivative part."""

import pytest

from controllers.catalogue import make_controller
from controllers.interface import Reference, Sense


def test_without_derivative_gains_it_is_pi_fv_to_rounding(samples, run_python):
    pid = run_python(make_controller("pid_fv", gains="table_3_11"), *samples)
    assert pid == pytest.approx(run_python(make_controller("pi_fv"), *samples), abs=1e-12)


def test_derivative_of_the_v_z_loop_acts_on_z():
    controller = make_controller("pid_fv")
    slope = Sense(0.5, 0.05, 0.0, 0.0, -20.0, 20.0, 0.0, 0.0)  # 45 deg
    controller.step(Reference(28.0, 0.0), slope)
    still = controller.state
    moved = controller.step(Reference(28.0, 1e-3), slope)
    controller.state = still
    unmoved = controller.step(Reference(28.0, 0.0), slope)
    e_vz = 1e-3 * 0.5**0.5
    assert moved.u_z - unmoved.u_z == pytest.approx(0.25 * e_vz + 0.05 * e_vz / 1e-3)
