"""DFV against PI FV on a flat edge and by hand on a slope."""

import math

import numpy as np
import pytest

from controllers.catalogue import make_controller
from controllers.gains import PidGains
from controllers.interface import Reference, Sense


def test_on_a_flat_edge_it_is_pi_fv_with_the_same_gains(run_python):
    rng = np.random.default_rng(3)
    senses = rng.standard_normal((400, 8)) * [0.0, 0.0, 0.03, 0.01, 0.0, 4.0, 1.0, 1.0] + [
        0.9,
        0.04,
        -0.05,
        0,
        0,
        30,
        -10,
        15,
    ]
    references = np.tile([30.0, -0.06], (400, 1))
    dfv = run_python(make_controller("dfv", friction=0.0), references, senses)
    assert dfv == pytest.approx(run_python(make_controller("pi_fv"), references, senses), abs=1e-12)


def test_on_a_slope_the_force_loop_acts_along_the_normal():
    theta = math.radians(30.0)
    s, c = math.sin(theta), math.cos(theta)
    sense = Sense(0.5, 0.05, -0.05 * c, -0.05 * s, -20.0 * s, 20.0 * c, 0.0, 0.0)
    command = make_controller("dfv", friction=0.0).step(Reference(30.0, -0.06), sense)
    c_n, c_t = 0.02 * 10.0, 1.0 * -0.01
    assert command.u_z == pytest.approx(0.735 + c_n * c + c_t * s)
    assert command.u_x == pytest.approx(0.635 - (c_t * c - c_n * s))


def test_friction_estimate_is_added_in_its_share():
    sense = Sense(0.5, 0.05, -0.06, 0.0, 0.0, 30.0, -12.0, 8.0)
    half, none = (
        make_controller("dfv", friction=share).step(Reference(30.0, -0.06), sense)
        for share in (0.5, 0.0)
    )
    assert none.u_x - half.u_x == pytest.approx(0.5 * (-11.0 + 74.0 * -0.06) / 186.0)
    assert half.u_z - none.u_z == pytest.approx(0.5 * 8.0 / 100.0)


def test_integrators_stop_on_errors_that_drive_a_clipped_axis_further_out():
    controller = make_controller("dfv", force=PidGains(0.02, 0.08), friction=0.0)
    controller.step(Reference(500.0, 0.0), Sense(0.5, 0.05, 0.0, 0.0, 0.0, 30.0, 0.0, 0.0))
    assert controller.state.normal.integral == 0.0
