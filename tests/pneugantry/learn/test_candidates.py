"""Which candidates of a screen are fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import cast

import numpy as np

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.rules import Rules
from pneugantry.learn.curves.curve import Basis, Knots, Wave, finer
from pneugantry.learn.curves.memory import MEMORIES, Remembered
from pneugantry.learn.equations.points import Opened, Point
from pneugantry.learn.screening.candidate import Candidate, Screen
from pneugantry.learn.screening.candidates import (
    elsewhere,
    of_few_parameters,
    shaped,
    variables_of,
    without,
)
from pneugantry.learn.screening.regressors import Regressor

SMOOTH = Knots(np.linspace(-1.0, 1.0, 9), True)


class Equation:
    """One that says nothing of a sensor."""

    sensor, shared, balance = False, None, False

    def __init__(self, scope: str = "", left: str = "") -> None:
        self.scope, self.left = scope, left

    def is_read(self, name: str) -> bool:
        return False

    def reads(self, name: str) -> bool:
        return False


class Sensor(Equation):
    """What a sensor of a component reads."""

    sensor = True

    def __init__(self, scope: str, reads: str) -> None:
        super().__init__(scope)
        self.read = reads

    def is_read(self, name: str) -> bool:
        return name == self.read


POINT = Equation()


@dataclass(frozen=True, eq=False)
class Likely:
    point: Equation
    regressor: Regressor
    basis: Basis | Remembered
    gain: float
    alike: tuple[Equation, ...]

    @property
    def points(self) -> frozenset[Equation]:
        return frozenset((self.point, *self.alike))


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


def test_the_variables_of_a_product_are_looked_at_by_themselves() -> None:
    raw, other = Equation("contact", "raw"), Equation("contact", "spring")

    def told(name: str, gain: float, point: Equation, **more: str) -> Candidate:
        return cast(Candidate, Likely(point, Regressor("contact", name, **more), SMOOTH, gain, ()))

    product = told("v_z", 116.0, raw, times="rate")
    rate, speed = told("rate", 113.0, raw), told("v_z", 20.0, raw)
    turned, elsewhere_too = told("rate", 90.0, raw, speed="v_z"), told("rate", 200.0, other)
    screen = Screen(cast(Fit, None), (elsewhere_too, rate, turned, speed), {})
    assert variables_of(screen, [product]) == [rate]
    assert variables_of(screen, []) == []


def told_of(
    candidates: Sequence[Candidate], point: Equation, blocks: Mapping[Equation, str]
) -> list[list[Candidate]]:
    apart = SimpleNamespace(shape=SimpleNamespace(roots={}), block=blocks.__getitem__)
    screen = Screen(cast(Fit, None), tuple(candidates), {})
    return of_few_parameters(screen, cast(Point, point), cast(Opened, apart), Rules())


def test_memories_and_waves_in_time_are_fitted_in_what_leads_whatever_is_foretold() -> None:
    """The best of each kind in its equation, by the component's own variables, and in what sensors
    read of what it computes; curves and products are not.
    """
    forces, around, sensor = Equation("z", "f"), Equation(""), Sensor("z", "f")
    own = [
        candidate("s", memory("play"), 40.0, forces, (around,)),
        candidate("time", Wave(0.3), -5.0, around, (forces,)),
        candidate("v", memory("recoil"), -48.0, forces, (around,)),
        candidate("f", memory("lag"), -2.0, sensor),
    ]
    others = [
        candidate("v", SMOOTH, 240.0, forces, (around,)),
        candidate("v_x", memory("recoil"), 65.0, around, (forces,)),
        candidate("v", memory("play"), 30.0, forces, (around,)),
        candidate("s", Wave(0.3), 20.0, forces, (around,)),
        candidate("v", memory("play"), 9.0, sensor),
    ]
    every = sorted([*own, *others], key=lambda c: -c.gain)
    blocks = {forces: "a", around: "a", sensor: "sensors"}
    found, rest = told_of(every, forces, blocks)
    assert [c.gain for c in found] == [40.0, -5.0, -48.0, -2.0]
    assert [c.point for c in found] == [forces, forces, forces, sensor]
    assert rest == []


def test_the_best_few_of_them_are_fitted_elsewhere_in_the_component() -> None:
    """Not in its parts, in other blocks, or where nothing is foretold."""
    forces, part, far = Equation("z"), Equation("z.guide", "level"), Equation("x")
    rates = [Equation("z") for _ in range(8)]
    sensor = Sensor("z", "s")
    best = [candidate("v", memory("lag"), 90.0 - k, p) for k, p in enumerate(rates)]
    every = (
        candidate("v", memory("recoil"), 117.0, part),
        candidate("v", memory("recoil"), 100.0, far),
        *best,
        candidate("s", memory("play"), 87.5, sensor),
        candidate("time", Wave(0.3), 9.0, forces),
    )
    blocks = {part: "a", forces: "a", sensor: "sensors", far: "b"} | dict.fromkeys(rates, "a")
    found, rest = told_of(every, part, blocks)
    assert found == [every[0]]
    assert [c.gain for c in rest] == [90.0, 89.0, 88.0, 87.5, 87.0, 86.0]
