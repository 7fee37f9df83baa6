"""Gain scheduler: rows of Table 5.1 by angle, and the integral at a change of set."""

import math

import pytest

from controllers.catalogue import make_controller
from controllers.gain_scheduler import scheduled_set
from controllers.interface import Reference, Sense
from controllers.pi_fv import PiFv

REFERENCE = Reference(30.0, -0.06)


def on_slope(degrees: float, f_n: float = 20.0) -> Sense:
    theta = math.radians(degrees)
    return Sense(0.5, 0.05, 0.0, 0.0, -f_n * math.sin(theta), f_n * math.cos(theta), 0.0, 0.0)


@pytest.mark.parametrize(
    ("degrees", "row"),
    [
        (-60.0, 0),
        (-1.0, 0),
        (14.9, 0),
        (15.1, 1),
        (29.9, 1),
        (30.1, 2),
        (44.9, 2),
        (45.1, 3),
        (80.0, 3),
    ],
)
def test_row_is_chosen_by_the_angle(degrees, row):
    assert scheduled_set(math.radians(degrees)) == row


@pytest.mark.parametrize("row", [1, 2, 3, 4])
def test_on_a_constant_slope_it_is_pi_fv_with_the_gains_of_that_row(row):
    sense = on_slope(15.0 * row - 7.0)
    scheduled, fixed = make_controller("pi_fv_scheduled"), PiFv(gains=f"table_5_1_set_{row}")
    for _ in range(50):
        assert scheduled.step(REFERENCE, sense) == fixed.step(REFERENCE, sense)


@pytest.mark.parametrize(("bumpless", "ratio"), [(False, 4.0), (True, 1.0)])
def test_integral_jumps_with_k_i_as_printed_or_is_kept(bumpless, ratio):
    controller = make_controller("pi_fv_scheduled", bumpless=bumpless)
    for _ in range(100):
        controller.step(REFERENCE, on_slope(40.0))
    before = controller.state.fv.i_fz
    controller.step(REFERENCE, on_slope(50.0, f_n=30.0))  # K_i of f_z goes from 0.08 to 0.32
    assert before > 0.0
    assert controller.state.fv.i_fz == pytest.approx(ratio * before)


def test_gains_are_refused():
    with pytest.raises(ValueError, match="gains must not be given"):
        make_controller("pi_fv_scheduled", gains="table_3_7")
