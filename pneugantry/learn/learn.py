"""After "unknown": the term that the plant lacks, where it enters, of what variable, in which form.

Data flow one way: equations opened -> every equation with every variable, as a curve -> the field's
forms of the best curves -> each fitted jointly with all else -> the plant with the likeliest one,
diagnosed as before. A term is accepted where the record that no fit saw is replayed better with it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from modelica_fmu.errors import InputError
from pneugantry.engine.cuts import sharp_views
from pneugantry.engine.fitter import Fit, Fitter
from pneugantry.engine.foreign import ForeignPlant
from pneugantry.engine.plant import Plant
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found, Task, run
from pneugantry.engine.views import SubsystemView, View
from pneugantry.learn.forms import distilled, free_curve
from pneugantry.learn.points import Opened, opened
from pneugantry.learn.screen import Candidate, Screen, screened
from pneugantry.learn.term import NAME, Term, with_term

__all__ = ["Learned", "Tried", "learn", "wanted"]

Say = Callable[[str], None]
WORTH = 0.3  # share of the best candidate's gain from which on another one is fitted
FINALISTS = 3  # pairs of equation and variable that are fitted
CLOSE = 8.0  # -2 log evidence by which a form may lie behind the closest one to be fitted
FORMS = 3  # forms of a pair that are fitted


@dataclass(frozen=True, eq=False)
class Tried:
    """A term fitted jointly with everything else."""

    term: Term  # with the values of the fit
    fit: Fit
    cost: float  # -2 log evidence


@dataclass(frozen=True, eq=False)
class Learned:
    """What was found."""

    before: Found
    after: Found | None  # with the term; None: nothing worth fitting was found
    best: Tried | None
    tried: tuple[Tried, ...]  # the likeliest first
    screen: Screen
    accepted: bool
    why: str  # one sentence
    seconds: float  # wall time

    @property
    def shrink(self) -> float | None:
        """Of the gap of the record that no fit saw, from the nominal plant to that with the term
        and all that is known.
        """
        return None if self.after is None or self.after.gap is None else self.after.gap.shrink


def wanted(found: Found) -> bool:
    """Whether there is something to learn: the answer holds what no catalogue explains."""
    return found.diagnosis.verdict == "unknown" and not isinstance(found.task.plant, ForeignPlant)


def learn(found: Found, rules: Rules, say: Say = lambda stage: None) -> Learned:
    """The term that a diagnosed plant lacks. Raises InputError for a plant without source."""
    task, began = found.task, time.perf_counter()
    if isinstance(task.plant, ForeignPlant):
        raise InputError(
            "an FMU without source has no equations to add a term to",
            field="learn",
            hint="describe the plant by its Modelica source",
        )
    say("missing term: screening")
    apart = opened(task.plant, task.views, task.cache)
    bases = {fit.keys: fit for fit in (found.search.null, found.decision.best)}
    screens = [screened(apart, fit, task.data.fitted, rules) for fit in bases.values()]
    say("missing term: fits")
    tried: list[Tried] = []
    for screen in screens:
        for candidate in _worth_fitting(screen, rules):
            tried += _fitted(task, apart, screen.fit, candidate, rules)
    tried.sort(key=lambda t: t.cost)
    main = max(screens, key=lambda s: s.candidates[0].gain if s.candidates else 0.0)
    if not tried:
        return Learned(found, None, None, (), main, False, NOTHING, time.perf_counter() - began)
    best = tried[0]
    say("missing term: diagnosis with it")
    after = _diagnosed(found, best, rules, say)
    accepted, why = _judged(found, after)
    seconds = time.perf_counter() - began
    return Learned(found, after, best, tuple(tried), main, accepted, why, seconds)


NOTHING = "no variable of any component foretells what is left of a log that its curve has not seen"


def _worth_fitting(screen: Screen, rules: Rules) -> list[Candidate]:
    if not screen.candidates:
        return []
    least = max(rules.entry, WORTH * screen.candidates[0].gain)
    return [c for c in screen.candidates if c.gain > least][:FINALISTS]


def _fitted(
    task: Task, apart: Opened, base: Fit, candidate: Candidate, rules: Rules
) -> list[Tried]:
    """A candidate in its closest forms, and as a free curve."""
    forms = distilled(candidate)
    near = [d for d in forms if d.cost < forms[0].cost + CLOSE][:FORMS]
    found = []
    for d in (*near, free_curve(candidate)):
        spreads = [max(abs(v), 1e-12) for v in d.values]
        for k, kind in enumerate(d.law.shapes, 1):
            if kind == "place":
                spreads[k] = 0.1 * float(np.ptp(candidate.knots.at))
        if d.law.tables:
            spreads = [0.5] * len(spreads)  # a half, for an effect's prior is two usual sizes wide
        block = apart.block(candidate.point)
        term = Term(candidate.point, candidate.regressor, d.law, d.values, tuple(spreads), block)
        found.append(_joint(task, base, term, rules))
    return found


def _joint(task: Task, base: Fit, term: Term, rules: Rules) -> Tried:
    """A term beside the effects of a fit."""
    plant = with_term(task.plant, term, task.cache)
    fitter = Fitter(plant, _views(task, plant, rules), task.data.fitted, rules)
    effect = term.effect
    try:
        hypothesis = base.hypothesis.plus(effect, effect.forms[0])
        fit = fitter.again(fitter.explore(hypothesis, base, term.starts))
    finally:
        fitter.close()
    values = fit.values(None)
    price = 2 * rules.entry * len(fit.keys)
    return Tried(term.at([values[n] for n in term.parameters]), fit, fit.evidence + price)


def _views(task: Task, plant: Plant, rules: Rules) -> list[View]:
    measured = [s.name for s in plant.signals]
    cut = list(sharp_views(plant, measured, task.cache, task.data.fitted, rules))
    others = [v for v in task.views if not isinstance(v, SubsystemView)]
    return [*cut, *others]


def _diagnosed(found: Found, best: Tried, rules: Rules, say: Say) -> Found:
    """The plant with the term among the catalogue's effects, diagnosed as before."""
    task, effect = found.task, best.term.effect
    plant = with_term(task.plant, best.term, task.cache)
    catalogue = {**task.catalogue, effect.key: effect}
    return run(
        replace(task, plant=plant, views=_views(task, plant, rules), catalogue=catalogue), rules
    )


def _judged(before: Found, after: Found) -> tuple[bool, str]:
    """Whether the term stands, and why."""
    if NAME not in after.decision.chosen:
        return (
            False,
            "beside the catalogue's effects the term brings nothing: located, not explained",
        )
    old, new = before.gap, after.gap
    if old is None or new is None:
        return False, "no log could be replayed: located, not explained"
    if new.augmented >= old.augmented:
        return False, (
            f"{new.record} is replayed no better with the term ({old.augmented:.3g} before, "
            f"{new.augmented:.3g} with it): located, not explained"
        )
    return True, f"the gap of {new.record} falls from {old.augmented:.3g} to {new.augmented:.3g}"
