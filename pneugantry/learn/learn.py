"""After "unknown": the term that the plant lacks, where it enters, of what variable, in which form.

Data flow one way: equations opened -> every equation with every variable, as a curve -> the field's
forms of the best curves -> each fitted jointly with all else -> the plant with the likeliest one,
diagnosed as before. A term is accepted where the record that no fit saw is replayed better with it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from modelica_fmu.errors import InputError
from pneugantry.engine.fitter import Fit, Fitter
from pneugantry.engine.foreign import ForeignPlant
from pneugantry.engine.plant import Array, Plant
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found, Task, run
from pneugantry.engine.views import SubsystemView, View
from pneugantry.learn.curve import Knots, Wave
from pneugantry.learn.forms import Distilled, distilled, free_curve, wave_of
from pneugantry.learn.points import Opened, opened, recut
from pneugantry.learn.screen import Candidate, Screen, screened
from pneugantry.learn.term import NAME, Term, with_term

__all__ = ["Learned", "Tried", "learn", "wanted"]

Say = Callable[[str], None]
WORTH = 0.5  # share of the best candidate's gain from which on another one is fitted
FINALISTS = 3  # pairs of equation and variable that are fitted
PATIENCE = 30.0  # s of one core for screens, after which only the answer's own fits get one
BESIDE = 3  # single effects of the catalogue beside which a term is looked for
OUT = 0.3  # share of the worst view's excess from which on a view's equations are tried
CLOSE = 8.0  # -2 log evidence by which a form may lie behind the closest one to be fitted
LINE = 0.02  # relative error of a period that a spectrum tells
FORMS = 3  # forms of a pair that are fitted


@dataclass(frozen=True, eq=False)
class Tried:
    """A term fitted jointly with everything else."""

    term: Term  # with the values of the fit
    fit: Fit
    cost: float  # -2 log evidence

    @property
    def covariance(self) -> Array:
        """Of the term's own values, those whose logarithm is fitted excepted."""
        coordinates = self.fit.point.coordinates
        names = [c.name for c in coordinates]
        index = [names.index(n) for n in self.term.parameters]
        units = np.array([coordinates[i].unit for i in index])
        return np.asarray(self.fit.covariance[np.ix_(index, index)] * np.outer(units, units))


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
    apart = opened(task.plant, task.views, task.data.fitted, task.cache)
    return replace(_Learning(found, rules, say, apart).run(), seconds=time.perf_counter() - began)


@dataclass(frozen=True, eq=False)
class _Learning:
    found: Found
    rules: Rules
    say: Say
    apart: Opened

    def reached(self, term: Term) -> list[str]:
        """Views that a term reaches."""
        return [v.name for v in self.apart.readers(term.point)]

    def run(self) -> Learned:
        """Screens beside nothing and beside the effects found; once more beside those that the
        diagnosis with the term has found.
        """
        found = self.found
        bases = {
            fit.keys: fit
            for fit in (found.search.null, found.decision.best, *_hopeful(found, self.rules))
        }
        screens, tried = self._tried(list(bases.values()))
        if not tried:
            return Learned(found, None, None, (), _main(screens), False, NOTHING, 0.0)
        after = self._diagnosed(tried[0])
        beside = tuple(k for k in after.decision.best.keys if k != NAME)
        if beside not in bases and NAME in after.decision.best.keys:
            more, others = self._tried([self._beside(after.decision.best)])
            screens += more
            tried = sorted((*tried, *others), key=lambda t: t.cost)
            if tried[0] in others:
                after = self._diagnosed(tried[0])
        accepted, why = _judged(found, after)
        return Learned(found, after, tried[0], tuple(tried), _main(screens), accepted, why, 0.0)

    def _tried(self, bases: Sequence[Fit]) -> tuple[list[Screen], list[Tried]]:
        """What is worth fitting beside some fits, fitted; the likeliest first."""
        self.say("missing term: screening")
        fitted, blamed = self.found.task.data.fitted, _blamed(self.found)
        screens: list[Screen] = []
        began = time.process_time()
        for fit in bases:
            if time.process_time() - began < PATIENCE or fit.keys in _answers(self.found):
                screens.append(screened(self.apart, fit, fitted, self.rules, blamed))
        self.say("missing term: fits")
        tried: list[Tried] = []
        for screen in screens:
            most = FINALISTS if screen.fit.keys in _answers(self.found) else 1
            for candidate in _worth_fitting(screen, self.rules)[:most]:
                tried += self._forms(screen.fit, candidate, self.apart.block(candidate.point))
        return screens, sorted(tried, key=lambda t: t.cost)

    def _forms(self, base: Fit, candidate: Candidate, block: str) -> list[Tried]:
        """A candidate as a wave; or as a free curve, and in the forms closest to what that is once
        it has been fitted.
        """

        def joint(d: Distilled) -> Tried:
            spreads = _spreads(d, candidate)
            where = candidate.point, candidate.regressor
            return self._joint(base, Term(*where, d.law, d.values, spreads, block))

        if isinstance(candidate.basis, Wave):
            return [joint(wave_of(candidate, candidate.basis))]
        assert isinstance(candidate.basis, Knots)
        free = free_curve(candidate, candidate.basis)
        fitted = joint(free.start)
        covariance = fitted.covariance
        forms = distilled(free.knots, *free.curve(fitted.term.values, covariance))
        near = [d for d in forms if d.cost < forms[0].cost + CLOSE][:FORMS]
        return [fitted, *(joint(d) for d in near)]

    def _beside(self, fit: Fit) -> Fit:
        """The effects of a fit without its missing term, fitted to the plant as it was."""
        task, null = self.found.task, self.found.search.null
        fitter = Fitter(task.plant, task.views, task.data.fitted, self.rules)
        try:
            return fitter.again(fitter.explore(fit.hypothesis.without(NAME), null))
        finally:
            fitter.close()

    def _joint(self, base: Fit, term: Term) -> Tried:
        """A term beside the effects of a fit."""
        task = self.found.task
        plant = with_term(task.plant, term, task.cache)
        fitter = Fitter(
            plant, _recut(task, plant, self.reached(term)), task.data.fitted, self.rules
        )
        effect = term.effect
        try:
            hypothesis = base.hypothesis.plus(effect, effect.forms[0])
            fit = fitter.again(fitter.explore(hypothesis, base, term.starts))
        finally:
            fitter.close()
        values = fit.values(None)
        price = 2 * self.rules.entry * len(fit.keys)
        return Tried(term.at([values[n] for n in term.parameters]), fit, fit.evidence + price)

    def _diagnosed(self, best: Tried) -> Found:
        """The plant with the term among the catalogue's effects, diagnosed as before."""
        self.say("missing term: diagnosis with it")
        task, effect = self.found.task, best.term.effect
        plant = with_term(task.plant, best.term, task.cache)
        catalogue = {**task.catalogue, effect.key: effect}
        views = _recut(task, plant, self.reached(best.term))
        own = replace(task, plant=plant, views=views, catalogue=catalogue)
        return run(own, self.rules, self.say)


def _main(screens: Sequence[Screen]) -> Screen:
    """The one with the best candidate."""
    return max(screens, key=lambda s: s.candidates[0].gain if s.candidates else 0.0)


def _blamed(found: Found) -> frozenset[str] | None:
    """Views that stand out of the noise; None: none does, or no view is known to."""
    ratios: dict[str, float] = {}
    for channel in found.excess.whole:
        ratios[channel[0]] = max(ratios.get(channel[0], 0.0), found.excess.ratio(channel))
    most = max(ratios.values(), default=0.0)
    named = {v for v, ratio in ratios.items() if ratio > 1 + OUT * (most - 1)}
    return frozenset(named) if most > 1 and named else None


NOTHING = "no variable of any component foretells what is left of a log that its curve has not seen"


def _worth_fitting(screen: Screen, rules: Rules) -> list[Candidate]:
    if not screen.candidates:
        return []
    least = max(rules.entry, WORTH * screen.candidates[0].gain)
    return [c for c in screen.candidates if c.gain > least]


def _answers(found: Found) -> set[tuple[str, ...]]:
    return {found.search.null.keys, found.decision.best.keys}


def _hopeful(found: Found, rules: Rules) -> list[Fit]:
    """Single effects of the catalogue that explain some of the residuals: one may be at work beside
    the missing term, though what the term leaves hides it.
    """
    least = found.search.null.evidence - rules.entry
    singles = [f for f in found.search.tried if len(f.keys) == 1 and f.evidence < least]
    return sorted(singles, key=lambda f: f.evidence)[:BESIDE]


def _spreads(d: Distilled, candidate: Candidate) -> tuple[float, ...]:
    """Usual sizes of a form's parameters; of a width the share by which it may be off."""
    basis = candidate.basis
    if d.law.tables:
        return (0.5,) * len(d.values)  # an effect's prior is two usual sizes wide
    span = float(np.ptp(basis.at)) if isinstance(basis, Knots) else d.values[1]
    width = 0.5 if isinstance(basis, Knots) else LINE
    sizes = {"size": 0.0, "width": width, "place": 0.1 * span}
    kinds = ("size", *d.law.shapes)
    return tuple(sizes[k] or max(abs(v), 1e-12) for k, v in zip(kinds, d.values, strict=True))


def _recut(task: Task, plant: Plant, reached: Collection[str]) -> list[View]:
    """Views of the plant with a term: those that it does not reach keep their parts."""
    found: list[View] = []
    for view in task.views:
        if not isinstance(view, SubsystemView):
            found.append(view)
        elif view.name in reached:
            found.append(recut(view, plant, task.cache))
        else:
            found.append(replace(view, plant=plant, _kept={}))
    return found


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
