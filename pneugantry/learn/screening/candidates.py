"""Which candidates of a screen are worth a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pneugantry.engine.rules import Rules
from pneugantry.learn.curves.curve import FineKnots, Knots, Wave
from pneugantry.learn.curves.memory import Remembered
from pneugantry.learn.equations.points import Opened, Point
from pneugantry.learn.screening.regressors import TIME
from pneugantry.learn.screening.screen import Candidate, Screen

__all__ = [
    "WORTH",
    "elsewhere",
    "kind",
    "main",
    "memories",
    "most",
    "replaced",
    "shaped",
    "without",
    "worth_fitting",
]

WORTH = 0.5  # share of the best candidate's gain from which on another one is fitted
NEAR = 0.4  # the same of its variable in another equation
FEW = 2  # other equations
PLACES = 4  # the same of a memory or a wave
SOME = 0.2  # share of the best candidate's gain from which on a memory is fitted


def worth_fitting(screen: Screen, apart: Opened, rules: Rules) -> list[Candidate]:
    """The best curve, wave and memory of each variable in each block. Of equations that do as
    well one comes first in which the variable stands already, and a balance.
    """
    least = rules.entry
    if screen.candidates:
        least = max(least, WORTH * screen.candidates[0].gain)
    families: dict[tuple[object, ...], list[Candidate]] = {}
    for c in screen.candidates:
        root = apart.shape.roots.get(c.regressor.label, c.regressor.plain.label)
        if c.regressor.speed:
            root = apart.shape.roots.get(c.regressor.plain.label, root)
        where = apart.block(c.point), c.point.shared is not None
        key = *where, root, c.regressor.speed, c.regressor.times, kind(c)
        if c.gain > least:
            families.setdefault(key, []).append(c)
    found: list[Candidate] = []
    for members in families.values():
        close = [c for c in members if c.gain >= members[0].gain - rules.entry]
        found.append(min(close, key=_unlikely))
    return sorted(found, key=lambda c: -c.gain)


def elsewhere(screen: Screen, worth: Sequence[Candidate], apart: Opened) -> list[Candidate]:
    """The curve of the best candidate's variable in other equations of its block. What a term does
    through an event (a break-away) no slope shows, so that a screen tells a variable better than
    the equation that it stands in. Time is a variable of no equation.
    """
    if not worth or worth[0].regressor.name == TIME:
        return []
    best = worth[0]
    own = _root(best, apart), apart.block(best.point)
    known = frozenset((best.point, *best.alike))
    found: dict[frozenset[Point], Candidate] = {}
    for c in (c for c in screen.candidates if c.gain > NEAR * best.gain):
        group, single = frozenset((c.point, *c.alike)), not (c.regressor.speed or c.regressor.times)
        if single and kind(c) == "curve" and (_root(c, apart), apart.block(c.point)) == own:
            found.setdefault(group, c)
    return [c for group, c in found.items() if not group & known][:FEW]


def memories(screen: Screen, rules: Rules) -> list[Candidate]:
    """The best one of each kind of memory: what it does through events (a carriage that breaks
    away) is foretold badly, so that other variables may seem to do better.
    """
    found: dict[str, Candidate] = {}
    for c in screen.candidates:
        if c.gain > max(rules.entry, SOME * most(screen)) and isinstance(c.basis, Remembered):
            found.setdefault(kind(c), c)
    return list(found.values())


def replaced(screen: Screen, own: Candidate, apart: Opened) -> list[Candidate]:
    """A memory or a wave in other equations of its block, alike ones too, those of the whole
    component before its parts': events tell them apart, and no slope shows what it does through
    these.
    """
    found: dict[Point, Candidate] = {}
    for c in screen.candidates:
        same = _root(c, apart) == _root(own, apart)
        if same and kind(c) == kind(own) and apart.block(c.point) == apart.block(own.point):
            for point in (c.point, *c.alike):
                if point.shared is None and point.scope == c.point.scope:
                    found.setdefault(point, replace(c, point=point))
    found.pop(own.point, None)
    return sorted(found.values(), key=lambda c: (len(c.point.scope), *_unlikely(c)))[:PLACES]


def _root(candidate: Candidate, apart: Opened) -> str:
    """Its variable in the whole plant."""
    plain = candidate.regressor.plain.label
    return apart.shape.roots.get(plain, plain)


def shaped(screen: Screen, worth: Sequence[Candidate], rules: Rules) -> list[Candidate]:
    """Candidates, and the best wave and each memory of the same variable in the same equation:
    they may be worth more than it looks, where what they do is no longer linear; beside a curve
    with narrow features the smooth one, which a fit bends more easily. Of a sensor also those of
    what it reads: its errors are functions of that.
    """
    found = {(c.point, c.regressor, _each(c)): c for c in worth}
    pairs = {(c.point, c.regressor) for c in worth}
    fine = {(c.point, c.regressor) for c in worth if isinstance(c.basis, FineKnots)}
    pairs |= {
        (c.point, c.regressor)
        for c in screen.candidates
        if c.regressor.alone and c.point.is_read(c.regressor.name)
        if any(c.point == w.point for w in worth)
    }
    for c in screen.candidates:
        pair, smooth = (c.point, c.regressor), isinstance(c.basis, Knots)
        if isinstance(c.basis, FineKnots) or c.gain <= rules.entry:
            continue
        if pair in (fine if smooth else pairs):
            found.setdefault((*pair, "smooth curve" if smooth else _each(c)), c)
    return list(found.values())


def without(screen: Screen, chosen: Sequence[Candidate]) -> Screen:
    """A screen without the equations of some of its candidates, and what does the same."""
    points = {p for c in chosen for p in (c.point, *c.alike)}
    left = tuple(c for c in screen.candidates if c.point not in points)
    return replace(screen, candidates=left)


def most(screen: Screen) -> float:
    """The gain of the best candidate."""
    return screen.candidates[0].gain if screen.candidates else 0.0


def main(screens: Sequence[Screen]) -> Screen:
    """The one with the best candidate."""
    return max(screens, key=most)


def kind(candidate: Candidate) -> str:
    """Curve, wave, or which memory."""
    basis = candidate.basis
    if isinstance(basis, Remembered):
        return basis.memory.name
    return "wave" if isinstance(basis, Wave) else "curve"


def _each(candidate: Candidate) -> str:
    """Its kind; of a sensor's waves the period, too: what its own view asks for may not be what
    others seem to, to whom its error is none of a straight line.
    """
    basis = candidate.basis
    if isinstance(basis, Wave) and candidate.point.sensor:
        return f"wave {basis.period:g}"
    return kind(candidate)


def _unlikely(candidate: Candidate) -> tuple[bool, bool]:
    """Where the variable does not stand in the equation, and where that is no balance."""
    point = candidate.point
    return not point.reads(candidate.regressor.name), not point.balance
