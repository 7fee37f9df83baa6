"""VDFM, DDFM and displacement since the last reversal."""

import math

import numpy as np
import pytest

from controllers.ddfm import DDFM_Z, DdfmParams, ddfm_checked, ddfm_step
from controllers.displacement import Displacement, displacement_step
from controllers.vdfm import VDFM_X, VdfmParams, vdfm_checked, vdfm_coulomb


@pytest.mark.parametrize(
    ("v", "drive", "force"),
    [
        (0.02, -50.0, 11.0),
        (-0.02, 50.0, -11.0),
        (0.005, 8.0, 8.0),
        (-0.005, 60.0, 25.0),
        (0.0, -60.0, -25.0),
    ],
)
def test_vdfm_is_f_d_while_sliding_and_holds_up_to_f_s_in_the_band(v, drive, force):
    assert vdfm_coulomb(VDFM_X, v, drive) == force


def test_ddfm_equals_the_printed_rule_in_fine_steps():
    travel = 1e-4 * np.sin(np.linspace(0.0, 12.0, 400_001))
    coarse = fine = 0.0
    for k in range(0, 400_000, 4000):
        for ds in np.diff(travel[k : k + 4001]).tolist():
            fine += (
                DDFM_Z.sigma * ds * (1.0 - fine / DDFM_Z.beta * math.copysign(1.0, ds)) ** 2
            )  # Eq. 4-8
        moved = np.diff(travel[k : k + 4001])
        for part in (moved[moved > 0.0].sum(), moved[moved <= 0.0].sum())[
            :: 1 if moved[0] > 0.0 else -1
        ]:
            coarse = ddfm_step(DDFM_Z, coarse, float(part))
    assert coarse == pytest.approx(fine, abs=2e-3)


def test_ddfm_has_stiffness_sigma_at_rest_and_stays_within_beta():
    assert ddfm_step(DDFM_Z, 0.0, 1e-9) == pytest.approx(1e5 * 1e-9, rel=1e-4)
    assert ddfm_step(DDFM_Z, 0.0, 1.0) == pytest.approx(12.0, rel=1e-3)
    assert abs(ddfm_step(DDFM_Z, 12.0, -10.0)) <= 12.0
    assert ddfm_step(DDFM_Z, 5.0, 0.0) == 5.0


def test_displacement_starts_anew_at_a_reversal_and_not_at_noise():
    at = Displacement()
    for travel in (1e-3, 1e-3, -2e-5, 3e-5):  # noise below the dead band of 50 um
        at = displacement_step(at, travel, 5e-5)
    assert at.travelled == pytest.approx(2.01e-3)
    at = displacement_step(at, -1e-4, 5e-5)
    assert (at.travelled, at.direction) == (pytest.approx(1e-4), -1.0)
    at = displacement_step(at, -1e-4, 5e-5)
    assert at.travelled == pytest.approx(2e-4)


def test_impossible_parameters_are_refused_by_name():
    with pytest.raises(ValueError, match="f_s of axis x must be >= 0, got -1"):
        vdfm_checked(VdfmParams(-1.0, 1.0, 1.0), "x")
    with pytest.raises(ValueError, match="beta of axis z must be > 0, got 0"):
        ddfm_checked(DdfmParams(0.0, 1.0), "z")
