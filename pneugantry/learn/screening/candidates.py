"""Which candidates of a screen are worth a fit."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from pneugantry.engine.rules import Rules
from pneugantry.learn.curves.curve import FineKnots, Knots, Wave
from pneugantry.learn.curves.memory import Remembered
from pneugantry.learn.equations.points import Opened, Point
from pneugantry.learn.screening.candidate import Candidate, Screen
from pneugantry.learn.screening.regressors import TIME, Regressor

__all__ = [
    "WORTH",
    "elsewhere",
    "kind",
    "main",
    "most",
    "of_few_parameters",
    "shaped",
    "variables_of",
    "without",
    "worth_fitting",
]

WORTH = 0.5  # share of the best candidate's gain from which on another one is fitted
NEAR = 0.4  # the same of its variable in another equation
FEW = 2  # other equations
PLACES = 6  # waves and memories in other equations


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
    found: dict[frozenset[Point], Candidate] = {}
    for c in (c for c in screen.candidates if c.gain > NEAR * best.gain):
        single = not (c.regressor.speed or c.regressor.times)
        if single and kind(c) == "curve" and (_root(c, apart), apart.block(c.point)) == own:
            found.setdefault(c.points, c)
    return [c for points, c in found.items() if not points & best.points][:FEW]


def of_few_parameters(
    screen: Screen, point: Point, apart: Opened, rules: Rules
) -> list[list[Candidate]]:
    """The best wave in time and the best of each kind of memory. First in an equation, and in what
    sensors read of what it computes, whatever is foretold: no slope shows what they do through
    events (when a carriage breaks away), and fits find their few parameters from afar. Then in
    other equations of its block's whole component, and in what sensors read of that, the best few.
    """
    told = [c for c in screen.candidates if c.point.shared is None and _brief(c)]
    inside = [c for c in told if not c.point.sensor and apart.block(c.point) == apart.block(point)]
    scopes = {c.point.scope for c in inside}
    scopes = scopes - {""} or scopes  # the plant's own class says what its components are given
    whole = {s for s in scopes if not any(s.startswith(f"{w}.") for w in scopes)}
    inside = [c for c in (_within(c, whole) for c in inside) if c.point.scope in scopes]
    read = [c for c in told if c.point.is_read(c.regressor.name)]
    own = [c for c in inside if point in c.points]
    own += [c for c in read if (c.point.scope, c.regressor.name) == (point.scope, point.left)]
    others = [c for c in [*inside, *read] if c.point.scope in whole and c.gain > rules.entry]
    few = sorted(_kinds([c for c in others if c not in own]), key=lambda c: -c.gain)[:PLACES]
    return [_kinds(own), few]


def _kinds(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The first of each kind in each equation, and what does the same."""
    found: dict[tuple[frozenset[Point], str], Candidate] = {}
    for c in candidates:
        found.setdefault((c.points, kind(c)), c)
    return list(found.values())


def _within(candidate: Candidate, scopes: Collection[str]) -> Candidate:
    """A function of time in an equation of certain components that does the same, if there is one:
    it is looked at in one of them.
    """
    points = [candidate.point, *candidate.alike]
    fit = [p for p in points if p.scope in scopes and candidate.regressor.name == TIME]
    if not fit or fit[0] is candidate.point:
        return candidate
    return replace(candidate, point=fit[0], alike=tuple(p for p in points if p is not fit[0]))


def _brief(candidate: Candidate) -> bool:
    """Whether it is a wave in time, or what a memory makes of a variable."""
    own, wave = candidate.regressor, isinstance(candidate.basis, Wave)
    plain = not (own.speed or own.times)
    return plain and (isinstance(candidate.basis, Remembered) or (wave and own.name == TIME))


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


def variables_of(screen: Screen, products: Sequence[Candidate]) -> list[Candidate]:
    """Of a screen of single variables the curves of those that products are of, in the same
    equations, that are foretold about as much.
    """
    found: dict[tuple[frozenset[Point], Regressor], Candidate] = {}
    for p in products:
        names = {p.regressor.name, p.regressor.times}
        for c in (c for c in screen.candidates if c.gain > WORTH * p.gain):
            own = c.regressor.alone and c.regressor.name in names and kind(c) == "curve"
            if own and p.point in c.points:
                found.setdefault((c.points, c.regressor), c)
    return list(found.values())


def without(screen: Screen, chosen: Sequence[Candidate]) -> Screen:
    """A screen without the equations of some of its candidates, and what does the same."""
    points = {p for c in chosen for p in c.points}
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
