"""Which candidates of a screen are fitted."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import cast

import numpy as np

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.rules import Rules
from pneugantry.learn.curves.curve import Basis, Knots, Wave, finer
from pneugantry.learn.curves.memory import MEMORIES, Remembered
from pneugantry.learn.equations.points import Opened
from pneugantry.learn.screening.candidates import (
    elsewhere,
    memories,
    replaced,
    shaped,
    without,
)
from pneugantry.learn.screening.regressors import Regressor
from pneugantry.learn.screening.screen import Candidate, Screen

SMOOTH = Knots(np.linspace(-1.0, 1.0, 9), True)


class Equation:
    """One that says nothing of a sensor."""

    sensor, shared, balance = False, None, False

    def __init__(self, scope: str = "") -> None:
        self.scope = scope

    def is_read(self, name: str) -> bool:
        return False

    def reads(self, name: str) -> bool:
        return False


POINT = Equation()


@dataclass(frozen=True, eq=False)
class Likely:
    point: Equation
    regressor: Regressor
    basis: Basis | Remembered
    gain: float
    alike: tuple[Equation, ...]


def candidate(
    variable: str,
    basis: Basis | Remembered,
    gain: float,
    point: Equation = POINT,
    alike: tuple[Equation, ...] = (),
) -> Candidate:
    return cast(Candidate, Likely(point, Regressor("", variable), basis, gain, alike))


def memory(name: str) -> Remembered:
    return Remembered(next(m for m in MEMORIES if m.name == name), (0.2, 0.1))


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


def test_equations_that_were_tried_and_what_does_the_same_are_set_aside() -> None:
    one, like, other = Equation(), Equation(), Equation()
    left = candidate("s", SMOOTH, 5.0, other)
    every = (
        candidate("v", SMOOTH, 9.0, one, (like,)),
        candidate("v", SMOOTH, 8.0, like, (one,)),
        left,
    )
    screen = Screen(cast(Fit, None), every, {})
    assert without(screen, every[:1]).candidates == (left,)
    assert without(screen, ()).candidates == every


def test_the_best_of_each_kind_of_memory_is_fitted() -> None:
    best, second = candidate("v", memory("recoil"), 60.0), candidate("s", memory("recoil"), 55.0)
    play, faint = candidate("f", memory("play"), 50.0), candidate("f", memory("lag"), 19.0)
    every = (candidate("t", SMOOTH, 240.0), best, second, play, faint)
    assert memories(Screen(cast(Fit, None), every, {}), Rules()) == [best, play]


def test_a_memory_is_tried_in_other_equations_of_its_block_the_whole_component_first() -> None:
    own, part, forces, rate, far = (Equation(s) for s in ("z.guide", "z.guide", "z", "z", "x"))
    best = candidate("v", memory("recoil"), 90.0, own)
    every = (
        best,
        candidate("v", memory("play"), 80.0, part),
        candidate("v", memory("recoil"), 20.0, part),
        candidate("v", memory("recoil"), 5.0, forces, (rate, far)),
        candidate("v", memory("recoil"), 4.0, far),
        candidate("s", memory("recoil"), 3.0, Equation("z")),
    )
    apart = SimpleNamespace(
        shape=SimpleNamespace(roots={}), block=lambda point: "b" if point is far else "a"
    )
    found = replaced(Screen(cast(Fit, None), every, {}), best, cast(Opened, apart))
    assert [c.point for c in found] == [forces, rate, part]
