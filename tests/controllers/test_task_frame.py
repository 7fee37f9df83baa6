"""Edge angle, normal force and tangential speed against hand-computed values."""

import math

import pytest

from controllers.interface import Sense
from controllers.task_frame import edge_angle, task_frame


def contact(theta: float, f_n: float, v_t: float) -> Sense:
    s, c = math.sin(theta), math.cos(theta)
    return Sense(0.5, 0.05, v_t * c, v_t * s, -f_n * s, f_n * c, 0.0, 0.0)


@pytest.mark.parametrize("degrees", [-40.0, -10.0, 0.0, 7.0, 16.0, 50.0])
def test_frame_recovers_angle_normal_force_and_tangential_speed(degrees):
    frame = task_frame(contact(math.radians(degrees), 30.0, -0.06))
    assert frame.theta == pytest.approx(math.radians(degrees), abs=1e-15)
    assert frame.f_n == pytest.approx(30.0)
    assert frame.v_t == pytest.approx(-0.06)


def test_edge_that_rises_with_x_has_a_positive_angle_and_a_negative_f_x():
    assert edge_angle(-10.0, 10.0) == pytest.approx(math.radians(45.0))


def test_angle_is_0_below_2_newton_and_measured_from_there():
    assert edge_angle(-1.4, 1.4) == 0.0
    assert edge_angle(-1.5, 1.5) == pytest.approx(math.pi / 4)
