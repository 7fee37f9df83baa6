"""Which candidates of a screen are fitted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np

from pneugantry.engine.rules import Rules
from pneugantry.learn.curves.curve import Basis, Knots, Wave, finer
from pneugantry.learn.equations.points import Opened
from pneugantry.learn.screening.candidates import elsewhere, shaped
from pneugantry.learn.screening.regressors import Regressor
from pneugantry.learn.screening.screen import Candidate, Screen

SMOOTH = Knots(np.linspace(-1.0, 1.0, 9), True)


class Equation:
    """One that says nothing of a sensor."""

    sensor = False

    def is_read(self, name: str) -> bool:
        return False


POINT = Equation()


def candidate(
    variable: str,
    basis: Basis,
    gain: float,
    point: Equation = POINT,
    alike: tuple[Equation, ...] = (),
) -> Candidate:
    own = SimpleNamespace(
        point=point, regressor=Regressor("", variable), basis=basis, gain=gain, alike=alike
    )
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


def test_the_best_variable_is_fitted_in_other_equations_of_its_block() -> None:
    """A break-away hides what a term does in an equation: the next best one may be the right one.
    Not in one that does the same, in another block, of another variable, or far behind.
    """
    balance, same, level, cap, other, weak = (Equation() for _ in range(6))
    best = candidate("f", SMOOTH, 100.0, balance, (same,))
    right = candidate("f", SMOOTH, 45.0, level, (cap,))
    screen = SimpleNamespace(
        candidates=(
            best,
            candidate("f", Wave(0.3), 95.0, balance, (same,)),
            candidate("f", SMOOTH, 90.0, same, (balance,)),
            candidate("f", SMOOTH, 80.0, other),
            candidate("s", SMOOTH, 70.0, level),
            candidate("f", Wave(0.3), 60.0, level),
            right,
            candidate("f", SMOOTH, 30.0, weak),
        )
    )
    apart = SimpleNamespace(
        shape=SimpleNamespace(roots={}), block=lambda point: "b" if point is other else "a"
    )
    found = elsewhere(cast(Screen, screen), [best], cast(Opened, apart))
    assert found == [right]
    assert elsewhere(cast(Screen, screen), [], cast(Opened, apart)) == []
