"""What is far from a base is fitted by its size first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_frugal import hypothesis
from test_search import fitter_of, parts, plant

from pneugantry.engine.plant import Plant
from pneugantry.engine.screening import nominal_values

__all__ = ["parts", "plant"]


def test_an_effect_is_sized_beside_tolerance_as_it_is(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts, drag=2.0)
    null = fitter.null()
    start = fitter._first(hypothesis("drag"), null, {**nominal_values(null), "drag": 0.3})
    end = fitter._sized(start, [c for c in fitter.simulation.cells if c[0] == "v"])
    fitter.close()
    still = [not c.effect and c.record is None for c in start.coordinates]
    assert np.array_equal(end.theta[still], start.theta[still])
    assert end.values(None)["drag"] == pytest.approx(2.0, rel=0.3)
