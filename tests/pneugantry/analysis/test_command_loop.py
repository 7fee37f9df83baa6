"""Loops broken at the command, against the one-signal loop and against co-simulation."""

import control
import numpy as np
import pytest

from controllers.catalogue import make_controller
from controllers.pi_fv import PiFv
from controllers.robust_fv import RobustFv
from pneugantry.analysis.command_loop import (
    command_loop,
    controller_block,
    is_stable,
    loop_margins,
    x_plant,
    z_plant,
)
from pneugantry.analysis.force_loop import force_loop
from pneugantry.analysis.frequency import response
from pneugantry.analysis.root_locus import loop_with_pi
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile

W = np.geomspace(0.1, 1000.0, 60)


@pytest.fixture(scope="module")
def fmu() -> FmuFile:
    return FmuFile.read(build_fmu().path)


def test_pi_gives_the_loop_of_the_root_locus(fmu):
    ours = command_loop(controller_block(PiFv()), z_plant(fmu))
    known = loop_with_pi(force_loop(fmu, "z"), 1e-3)
    assert response(ours)(W) == pytest.approx(response(known)(W), rel=1e-5)


def test_a_delay_margin_is_the_delay_that_loses_stability(fmu):
    block = controller_block(RobustFv())
    margin = loop_margins(block, z_plant(fmu)).delay
    for late, stable in ((0.9 * margin, True), (1.1 * margin, False)):
        plant = z_plant(fmu, parameters={"valve_z.delay_time": late})
        assert is_stable(command_loop(block, plant)) is stable


def test_a_gain_margin_is_the_gain_that_loses_stability(fmu):
    block = controller_block(make_controller("pi_fv"))
    margin = loop_margins(block, z_plant(fmu)).gain
    scaled = control.StateSpace(
        block.A, block.B, 1.05 * margin * block.C, 1.05 * margin * block.D, 1e-3
    )
    assert not is_stable(command_loop(scaled, z_plant(fmu)))


def test_a_stuck_axis_is_a_spring_beside_the_contact(fmu):
    """At rest f_z gets the contact's share of f_a, K_c / (K_c + sigma)."""
    plant = z_plant(fmu, stuck=True, parameters={"contact.K_c": 5e4, "contact.C_c": 150.0})
    at = plant.model(np.exp(1j * 1e-3 * 1.0))  # 1 rad/s
    assert abs(at[0, 0] / at[1, 0]) == pytest.approx(5e4 / 1.5e5, rel=0.02)
    assert plant.label == "nominal, z stuck"


def test_a_second_stage_and_a_dead_time_take_phase(fmu):
    block = controller_block(RobustFv())
    slow = z_plant(fmu, parameters={"valve_z.tau_2": 0.04, "valve_z.delay_time": 0.02})
    near, far = (
        response(command_loop(block, p))(np.array([20.0]))[0] for p in (z_plant(fmu), slow)
    )
    assert np.angle(far / near) == pytest.approx(-0.02 * 20 - np.arctan(0.04 * 20), abs=0.35)


def test_the_x_loop_of_the_robust_controller_is_stable_with_each_extra(fmu):
    block = controller_block(RobustFv(), "x")
    for extra in ({}, {"valve_x.tau_2": 0.04}, {"valve_x.delay_time": 0.02}):
        assert is_stable(command_loop(block, x_plant(fmu, parameters=extra)))


def test_a_learning_controller_has_no_linear_model():
    with pytest.raises(ValueError, match="arrays"):
        controller_block(make_controller("pi_fv_mbpm"))
