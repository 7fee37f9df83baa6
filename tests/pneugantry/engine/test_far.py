"""What is far is fitted by its size first; what a descent could not follow is no promise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_frugal import hypothesis
from test_search import fitter_of, parts, plant

from pneugantry.engine.descent import Solution, prior
from pneugantry.engine.plant import Plant
from pneugantry.engine.screening import nominal_values

__all__ = ["parts", "plant"]


def test_where_a_descent_was_stopped_its_slope_leads_nowhere(plant: Plant, parts: Path) -> None:
    """A parabola of the speed that leads elsewhere than its view goes; the others keep theirs."""
    fitter = fitter_of(plant, parts)
    null = fitter.null()
    own, theta = prior(null.point.coordinates), null.point.theta
    pull = null.parabolas["v"].pull + 5 * np.sqrt(np.diag(null.parabolas["v"].square))
    wrong = {**null.parabolas, "v": replace(null.parabolas["v"], pull=pull)}
    solution = Solution(null.point, null.residuals, null.columns)
    found = fitter._level_at(solution, wrong, null.noise)
    alike = fitter._level_at(solution, null.parabolas, null.noise)
    fitter.close()
    before, after = own, own
    for view, parabola in found.items():
        before, after = before.plus(wrong[view]), after.plus(parabola)
    assert np.abs(before.least() - theta).max() > 0.05
    assert after.least() == pytest.approx(theta, abs=1e-3)
    assert after.square == pytest.approx(before.square)
    for view, size in (("v", 0.1), ("i", 0.02), ("s", 0.02)):
        apart = found[view].pull - null.parabolas[view].pull
        assert np.linalg.norm(apart) < size * np.linalg.norm(wrong["v"].pull)
    assert alike is null.parabolas


def test_an_effect_is_sized_beside_tolerance_as_it_is(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts, drag=2.0)
    null = fitter.null()
    start = fitter._first(hypothesis("drag"), null, {**nominal_values(null), "drag": 0.3})
    end = fitter._sized(start, [c for c in fitter.simulation.cells if c[0] == "v"])
    fitter.close()
    still = [not c.effect and c.record is None for c in start.coordinates]
    assert np.array_equal(end.theta[still], start.theta[still])
    assert end.values(None)["drag"] == pytest.approx(2.0, rel=0.3)
