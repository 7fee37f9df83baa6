"""Which candidates of a screen are fitted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np

from pneugantry.engine.rules import Rules
from pneugantry.learn.curves.curve import Basis, Knots, Wave, finer
from pneugantry.learn.screening.candidates import shaped
from pneugantry.learn.screening.regressors import Regressor
from pneugantry.learn.screening.screen import Candidate, Screen

SMOOTH = Knots(np.linspace(-1.0, 1.0, 9), True)


class Equation:
    """One that says nothing of a sensor."""

    def is_read(self, name: str) -> bool:
        return False


POINT = Equation()


def candidate(variable: str, basis: Basis, gain: float) -> Candidate:
    own = SimpleNamespace(point=POINT, regressor=Regressor("", variable), basis=basis, gain=gain)
    return cast(Candidate, own)


def test_a_smooth_curve_is_fitted_beside_one_with_narrow_features() -> None:
    """And the wave of the same variable; what gains nothing, and other variables, are not."""
    fine = candidate("v", finer(SMOOTH), 90.0)
    smooth, wave = candidate("v", SMOOTH, 80.0), candidate("v", Wave(0.3), 30.0)
    nothing, other = candidate("v", Wave(0.2), 1.0), candidate("s", SMOOTH, 85.0)
    screen = cast(Screen, SimpleNamespace(candidates=(fine, other, smooth, wave, nothing)))
    assert shaped(screen, [fine], Rules()) == [fine, smooth, wave]


def test_a_smooth_curve_is_fitted_once() -> None:
    smooth, fine = candidate("v", SMOOTH, 90.0), candidate("v", finer(SMOOTH), 80.0)
    screen = cast(Screen, SimpleNamespace(candidates=(smooth, fine)))
    assert shaped(screen, [smooth], Rules()) == [smooth]
