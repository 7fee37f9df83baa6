"""A sensor's scale, and all that it makes look off by one share."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_search import CATALOGUE, TRUTH, fitter_of, parts, plant

from pneugantry.engine.plant import Plant
from pneugantry.engine.selection.relief import Reliefs

__all__ = ["parts", "plant"]  # fixtures
SHARE = 1.25


def test_what_tolerance_bears_is_offered_to_the_effect_that_would_bear_it_alone(
    plant: Plant,
    parts: Path,
) -> None:
    """The current reads 1.25 of what it is: gain, mass and both frictions look 25 % off."""
    fitter = fitter_of(plant, parts, **{n: SHARE * TRUTH[n] for n in ("K", "m", "C", "F_c")})
    null = fitter.null()
    reliefs = Reliefs(fitter, null)
    assert {"K", "m", "C", "F_c"} <= reliefs.far_off
    forms = {key: effect.forms[0] for key, effect in CATALOGUE.items()}
    found, other = reliefs.of(forms["current_scale"]), reliefs.of(forms["drag"])
    mass = reliefs.of(forms["mass"])
    fitter.close()
    assert found is not None
    assert other is not None
    assert mass is not None
    assert found.gain > 100 > other.gain
    assert found.gain > 2 * mass.gain  # one of four
    assert found.starts["sensors.i.scale"] == pytest.approx(SHARE, rel=0.05)
    assert found.starts["m"] == pytest.approx(1.5, rel=0.05)


def test_what_tolerance_bears_itself_is_offered_as_the_effect_that_it_may_be(
    plant: Plant, parts: Path
) -> None:
    """A mass that is 25 % off, and no sensor's scale."""
    fitter = fitter_of(plant, parts, m=SHARE * TRUTH["m"])
    reliefs = Reliefs(fitter, fitter.null())
    mass, scale = (reliefs.of(CATALOGUE[k].forms[0]) for k in ("mass", "current_scale"))
    fitter.close()
    assert mass is not None
    assert scale is not None
    assert mass.gain > 100 > scale.gain
    assert mass.starts["m"] == pytest.approx(SHARE * TRUTH["m"], rel=0.02)


def test_a_rig_within_its_tolerance_needs_none(plant: Plant, parts: Path) -> None:
    fitter = fitter_of(plant, parts)
    reliefs = Reliefs(fitter, fitter.null())
    found = reliefs.of(CATALOGUE["current_scale"].forms[0])
    fitter.close()
    assert not reliefs.far_off
    assert found is None
