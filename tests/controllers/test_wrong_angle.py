"""PI FV with a wrong edge angle."""

import math

import pytest

from controllers.interface import Reference, Sense
from controllers.pi_fv import PiFv
from controllers.wrong_angle import WrongAngle

SENSE = Sense(0.6, 0.04, -0.05, 0.001, 2.0, 28.0, -15.0, 30.0)


def test_without_an_error_it_is_pi_fv():
    assert WrongAngle(0.0).step(Reference(30.0, -0.06), SENSE) == PiFv().step(
        Reference(30.0, -0.06), SENSE
    )


def test_the_normal_force_is_read_as_its_cosine():
    straight = SENSE._replace(f_x=0.0, f_z=30.0, v_x=0.0, v_z=0.0)
    error = math.radians(30.0)
    e_fz = (30.0 - 30.0 * math.cos(error)) * math.cos(error)
    command = WrongAngle(error).step(Reference(30.0, 0.0), straight)
    assert command.u_z == pytest.approx(0.735 + 0.02 * e_fz)


def test_an_error_that_is_no_number_is_refused():
    with pytest.raises(ValueError, match="finite"):
        WrongAngle(math.nan)
