"""Intervals for which evidence counts by a share, against their closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.intervals import held
from pneugantry.engine.fitting.fit import Fit, occam
from pneugantry.engine.fitting.problem import Parabola
from pneugantry.engine.hypotheses.hypothesis import Coordinate, Hypothesis
from pneugantry.engine.views.simulation import Point

TEMPER = 6.0
AXES = (
    Coordinate("told", centre=2.0, unit=0.1, effect=True),
    Coordinate("hidden", centre=1.0, unit=0.1),
)


def fit(*parabolas: Parabola) -> Fit:
    """Of two coordinates, where these lie."""
    by_view = {str(k): p for k, p in enumerate(parabolas)}
    covariance = occam(AXES, by_view)[1]
    point = Point(AXES, np.zeros(2), {})
    return Fit(Hypothesis(), point, {}, {}, {}, by_view, covariance, 1.0, {}, 0.0)


def test_evidence_counts_by_its_share_and_the_prior_in_full() -> None:
    two = [Parabola(("told",), np.array([[k]]), np.zeros(1)) for k in (100.0, 500.0)]
    found = fit(*two)
    assert found.sigma("told") == pytest.approx(1 / math.sqrt(1 + 600))
    by_share = found.tempered(TEMPER)
    assert by_share.sigma("told") == pytest.approx(1 / math.sqrt(1 + 100))
    assert by_share.sigma("hidden") == pytest.approx(1.0)
    assert by_share.evidence == found.evidence
    assert found.tempered(1.0).sigma("told") == pytest.approx(found.sigma("told"))


def test_parameters_that_the_logs_tell_are_held_or_not() -> None:
    found = fit(Parabola(("told",), np.array([[600.0]]), np.zeros(1)))
    off = 0.1 * 3 / math.sqrt(601)  # three standard deviations
    truth = {"told": 2.0 + off, "hidden": 1.5}
    assert list(held(found, TEMPER, truth)) == [("told", True, False, True)]
