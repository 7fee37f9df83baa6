"""After "unknown": the term that the plant lacks, where it enters, of what variable, in which form.

Data flow one way: equations opened -> every equation with every variable, as a curve -> the field's
forms of the best curves -> each fitted jointly with all else -> the plant with the likeliest one,
diagnosed as before. A term is accepted where the record that no fit saw is replayed better with it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from modelica_fmu.errors import InputError
from pneugantry.engine.fit import Fit
from pneugantry.engine.fitter import Fitter
from pneugantry.engine.foreign import ForeignPlant
from pneugantry.engine.hypothesis import Hypothesis
from pneugantry.engine.plant import Data
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found, run
from pneugantry.engine.threads import on_threads, one_blas_thread
from pneugantry.learn.calibrated import calibrated, read_by
from pneugantry.learn.composite import composites
from pneugantry.learn.curve import Knots, Wave
from pneugantry.learn.experiments import Experiment, Rival, telling
from pneugantry.learn.forms import (
    FORMS,
    PERIODIC,
    Distilled,
    distilled,
    free_curve,
    memory_of,
    wave_of,
    with_harmonics,
)
from pneugantry.learn.joint import TermFits
from pneugantry.learn.judge import Judge
from pneugantry.learn.learned import Learned, Tried
from pneugantry.learn.memory import Remembered
from pneugantry.learn.points import Opened, opened
from pneugantry.learn.read import with_readings
from pneugantry.learn.rivals import Rivals
from pneugantry.learn.screen import Candidate, Screen, Screening
from pneugantry.learn.term import Term, with_term

__all__ = ["learn", "wanted"]

Say = Callable[[str], None]
NEARLY = 0.8  # share of the best curve's fall from which on a curve's forms are fitted
CLEARLY = 1.1  # times the gain of single variables, from which on products are fitted first
WORTH = 0.5  # share of the best candidate's gain from which on another one is fitted
FINALISTS = 2  # pairs of equation and variable that are fitted
SINGLES = 24  # effects of the catalogue that are tried as part of a curve
COMPOSITES = 5  # known effects with a form beside them that are fitted
BESIDE = 2  # known effects beside which a term is looked for once more
LIKELY = 0.2  # probability of what no catalogue has, from which on it is looked for
OUT = 0.3  # share of the worst view's excess from which on a view's equations are tried
CLOSE = 8.0  # -2 log evidence by which a form may lie behind the closest one to be fitted
LINE = 0.02  # relative error of a period that a spectrum tells
CLOSEST = 3  # forms of a pair that are fitted
MUCH_LIKE = 0.05  # share of a form's variance that one much like it leaves


def wanted(found: Found) -> bool:
    """Whether there may be something to learn: what no catalogue explains is likely enough."""
    return found.decision.unknown >= LIKELY and not isinstance(found.task.plant, ForeignPlant)


@one_blas_thread()
def learn(
    found: Found,
    rules: Rules,
    say: Say = lambda stage: None,
    finish: Callable[[Found], Found] = lambda found: found,
) -> Learned:
    """The term that a diagnosed plant lacks. finish: what was done to `found` after the engine's
    run, and is done to that of the plant with the term. Raises InputError for a plant without
    source.
    """
    task, began = found.task, time.perf_counter()
    if isinstance(task.plant, ForeignPlant):
        raise InputError(
            "an FMU without source has no equations to add a term to",
            field="learn",
            hint="describe the plant by its Modelica source",
        )
    task = with_readings(task)
    found = replace(found, task=task)
    apart = opened(task.plant, task.views, task.cache)
    quick = replace(rules, followed=0)  # fits start where another one stands: no view is surveyed
    fits = TermFits(task, apart, quick, found.excess.level)
    made = _Learning(found, fits, say, finish).run()
    return replace(made, seconds=time.perf_counter() - began)


@dataclass(frozen=True, eq=False)
class _Learning:
    found: Found
    fits: TermFits
    say: Say
    finish: Callable[[Found], Found]

    @property
    def rules(self) -> Rules:
        return self.fits.rules

    @property
    def apart(self) -> Opened:
        return self.fits.apart

    def run(self) -> Learned:
        """Screens beside nothing and, where that is not enough, beside the effects found."""
        found = self.found
        tried: list[Tried] = []
        bases = {fit.keys: fit for fit in (found.search.null, found.decision.best)}
        screens: list[Screen] = []
        twofold: list[Screen] = []
        for fit in bases.values():
            self.say("missing term: screening")
            screening = self._screening(fit)
            screens.append(screening.singles())
            twofold.append(screening.products())
            self.say("missing term: fits")
            tried += self._first(fit, screens[-1], twofold[-1])
            if self._enough(tried):
                break
        else:
            tried += self._beside(tried, screens, bases)
        if not tried:
            return Learned(found, None, (), (), _main(screens), False, NOTHING, 0.0)
        tried += self._otherwise(tried, screens)
        answers, after = self._answered(tried)
        formless = answers[0].drifts or answers[0].free is not None
        if formless or wanted(after):  # a single variable does not tell it all
            self.say("missing term: products")
            made = self._further(twofold, tried)
            made += self._otherwise(made, screens)
            least = min(t.cost for t in tried)
            if min((t.cost for t in made), default=math.inf) < least - self.rules.entry:
                tried = [*tried, *made]
                answers, after = self._answered(tried)
        screens += twofold
        accepted, why = Judge(self.found, self.fits).judged(answers[0], after)
        kept = _main(screens), accepted, why
        experiment, ordered = self._experiment(answers), sorted(tried, key=lambda t: t.cost)
        return Learned(found, after, answers, tuple(ordered), *kept, 0.0, experiment)

    def _first(self, fit: Fit, single: Screen, products: Screen) -> list[Tried]:
        """Single variables, and products that may do as well; products alone, where they foretell
        clearly more and are enough.
        """
        likely = self._worth_fitting(products)[:FINALISTS]
        tried: list[Tried] = []
        if _most(products) > CLEARLY * _most(single):
            tried += self._fitted(fit, self._shaped(products, likely))
            if self._enough(tried):
                return tried
            likely = []
        least = WORTH * _most(single)
        singles = self._shaped(single, self._worth_fitting(single)[:FINALISTS])
        own = self._shaped(products, [c for c in likely if c.gain > least])
        return [*tried, *self._fitted(fit, [*singles, *own])]

    def _further(self, screens: Sequence[Screen], tried: Sequence[Tried]) -> list[Tried]:
        """The best candidates of screens that have not been fitted yet."""
        known = {(t.term.point, t.term.regressor) for t in tried}
        made: list[Tried] = []
        for s in screens:
            new = [c for c in self._worth_fitting(s) if (c.point, c.regressor) not in known]
            made += self._fitted(s.fit, self._shaped(s, new[:FINALISTS]))
        return made

    def _beside(
        self,
        tried: Sequence[Tried],
        screens: list[Screen],
        bases: Mapping[tuple[str, ...], Fit],
    ) -> list[Tried]:
        """Effects of the catalogue as part of a curve that has no form; what is looked at beside
        them joins the screens.
        """
        made, likely = self._composites(tried)
        for fit in likely:
            if fit.keys not in bases:
                screens.append(self._screening(fit).singles())
                worth = self._worth_fitting(screens[-1])[:1]
                made += self._fitted(fit, self._shaped(screens[-1], worth))
        return made

    def _otherwise(self, tried: Sequence[Tried], screens: Sequence[Screen]) -> list[Tried]:
        """The likeliest term in a plainer form, or with harmonics."""
        if not tried:
            return []
        best = min(tried, key=lambda t: t.cost)
        return [*self._plainer(best, screens), *self._harmonics(best)]

    def _answered(self, tried: Sequence[Tried]) -> tuple[tuple[Tried, ...], Found]:
        """The terms that the records do not tell apart, and the plant with the first of them."""
        answers = Rivals(self.fits).answers(sorted(tried, key=lambda t: t.cost))
        return answers, self._diagnosed(answers[0])

    def _screening(self, fit: Fit) -> Screening:
        task, blamed = self.found.task, _blamed(self.found)
        fitter = Fitter(task.plant, task.views, task.data.fitted, self.rules)
        try:
            of_views = fitter.noise.plain(fit.residuals)
        finally:
            fitter.close()
        bases = (fit, self.found.search.null, self.found.decision.best)
        moving = {c.parameter for base in bases for c in base.point.coordinates}
        own = {n for r in task.data.fitted for n in r.parameters}
        stand_out = [v for v in self.apart.views if blamed is None or v.name in blamed]
        on_threads(lambda v: v.prepare(moving | own, fit.hypothesis.settings), stand_out)
        return Screening(self.apart, fit, of_views, task.data.fitted, self.rules, blamed)

    def _worth_fitting(self, screen: Screen) -> list[Candidate]:
        """The best curve, wave and memory of each variable in each block. Of equations that do as
        well one comes first in which the variable stands already, and a balance.
        """
        least = self.rules.entry
        if screen.candidates:
            least = max(least, WORTH * screen.candidates[0].gain)
        families: dict[tuple[object, ...], list[Candidate]] = {}
        for c in screen.candidates:
            root = self.apart.shape.roots.get(c.regressor.label, c.regressor.plain.label)
            if c.regressor.speed:
                root = self.apart.shape.roots.get(c.regressor.plain.label, root)
            where = self.apart.block(c.point), c.point.shared is not None
            key = *where, root, c.regressor.speed, c.regressor.times, _kind(c)
            if c.gain > least:
                families.setdefault(key, []).append(c)
        found: list[Candidate] = []
        for members in families.values():
            close = [c for c in members if c.gain >= members[0].gain - self.rules.entry]
            found.append(min(close, key=_unlikely))
        return sorted(found, key=lambda c: -c.gain)

    def _enough(self, tried: Sequence[Tried]) -> bool:
        """Whether the likeliest term has a form and leaves no more than noise in any view."""
        best = min(tried, key=lambda t: t.cost, default=None)
        return best is not None and best.free is None and not self.fits.loud(best)

    def _composites(self, tried: Sequence[Tried]) -> tuple[list[Tried], list[Fit]]:
        """The likeliest free curve as an effect of the catalogue with a form beside it; and the
        effects beside which it is worth while to look again.
        """
        curves = [t for t in tried if t.free is not None]
        if not curves:
            return [], []
        best = min(curves, key=lambda t: t.cost)
        assert best.free is not None
        assert best.candidate is not None
        effects = self._singles(best.term)
        curve = best.free.curve(best.term.values, best.covariance)
        likely = composites(best.candidate, curve, effects)
        found: list[Tried] = []
        for c in likely[:COMPOSITES]:
            term = self._term(best.candidate, c.form)
            found.append(self.fits.joint(c.effect, term, c.starts))
        firsts = {c.effect.keys: c.effect for c in likely[:COMPOSITES]}
        firsts |= {f.keys: f for f in effects[:1]}
        return found, list(firsts.values())[:BESIDE]

    def _singles(self, term: Term) -> list[Fit]:
        """Single effects that are read where a term is: as the search has fitted them, and those
        that it did not, for alone they explained too little.
        """
        task, null, reached = self.found.task, self.found.search.null, set(self.fits.reached(term))
        found = {f.keys: f for f in self.found.search.tried if len(f.keys) == 1}
        fitter = Fitter(task.plant, task.views, task.data.fitted, self.rules)
        try:
            for key, effect in task.catalogue.items():
                hypothesis = Hypothesis().plus(effect, effect.forms[0])
                seen = reached & {c[0] for c in fitter.touched(hypothesis)}
                if seen and (key,) not in found and len(found) < SINGLES:
                    found[key,] = fitter.explore(hypothesis, null)
        finally:
            fitter.close()
        return sorted(found.values(), key=lambda f: f.evidence)

    def _experiment(self, answers: Sequence[Tried]) -> Experiment | None:
        if len(answers) < 2:
            return None
        task = self.found.task
        rivals = [
            Rival(t.term.name, with_term(task.plant, t.term, task.cache, blank=True), t.fit)
            for t in answers[:2]
        ]
        records = [*task.data.fitted, *([task.data.held_out] if task.data.held_out else [])]
        for t in answers[:2]:
            records = [t.term.within(r) for r in records]
        return telling(rivals[0], rivals[1], records, task.cache)

    def _term(self, candidate: Candidate, d: Distilled) -> Term:
        block, spreads = self.apart.block(candidate.point), _spreads(d, candidate)
        term = Term(candidate.point, candidate.regressor, d.law, d.values, spreads, block)
        if not d.places:
            return term
        return replace(term, places=dict(zip(candidate.course.values, d.places, strict=True)))

    def _fitted(self, base: Fit, worth: Sequence[Candidate]) -> list[Tried]:
        """Candidates beside a fit as waves, memories and free curves; those that explain about as
        much as the best one also in the forms that are closest to their curve.
        """
        first = [self._free(base, c) for c in worth]
        fall = max((base.evidence - t.fit.evidence for t in first), default=0.0)
        found = list(first)
        for t in first:
            if t.free is not None and base.evidence - t.fit.evidence > NEARLY * fall:
                found += self._forms(base, t)
        formed = [t for t in found if t.free is None]
        best = min(formed, key=lambda t: t.cost, default=None)
        return [self.fits.behind(t) if t is best else t for t in found]

    def _shaped(self, screen: Screen, worth: Sequence[Candidate]) -> list[Candidate]:
        """Candidates, and the best wave and each memory of the same variable in the same equation:
        they may be worth more than it looks, where what they do is no longer linear. Of a sensor
        also those of what it reads: its errors are functions of that.
        """
        found = {(c.point, c.regressor, _kind(c)): c for c in worth}
        pairs = {(c.point, c.regressor) for c in worth}
        pairs |= {
            (c.point, c.regressor)
            for c in screen.candidates
            if c.regressor.alone and c.point.is_read(c.regressor.name)
            if any(c.point == w.point for w in worth)
        }
        for c in screen.candidates:
            shaped = not isinstance(c.basis, Knots) and c.gain > self.rules.entry
            if shaped and (c.point, c.regressor) in pairs:
                found.setdefault((c.point, c.regressor, _kind(c)), c)
        return list(found.values())

    def _free(self, base: Fit, candidate: Candidate) -> Tried:
        """A candidate as a wave, a memory or a free curve."""
        if isinstance(candidate.basis, Remembered):
            made = memory_of(candidate, candidate.basis)
            return self.fits.joint(base, self._term(candidate, made))
        if isinstance(candidate.basis, Wave):
            return self.fits.joint(base, self._term(candidate, wave_of(candidate, candidate.basis)))
        assert isinstance(candidate.basis, Knots)
        free = free_curve(candidate, candidate.basis)
        fitted = self.fits.joint(base, self._term(candidate, free.start))
        return replace(fitted, free=free, candidate=candidate)

    def _forms(self, base: Fit, fitted: Tried) -> list[Tried]:
        """The forms that are closest to a free curve as it has been fitted."""
        free, candidate = fitted.free, fitted.candidate
        assert free is not None
        assert candidate is not None
        forms = distilled(free.knots, *free.curve(fitted.term.values, fitted.covariance))
        near = [d for d in forms if d.cost < forms[0].cost + CLOSE][:CLOSEST]
        if all(d.law.shapes for d in near):
            near.append(next(d for d in forms if not d.law.shapes))  # it may do as well
        return [self.fits.joint(base, self._term(candidate, d)) for d in near]

    def _plainer(self, best: Tried, screens: Sequence[Screen]) -> list[Tried]:
        """The forms without any shape that are much like a term's over what the records cover: a
        fit that started far off has bent the shape to what it could not tell yet.
        """
        law, base = best.term.law, best.base
        plain = [f for f in FORMS if not f.shapes]
        bare = best.free is not None or best.term.places or law.memory is not None
        if base is None or bare or law in plain:
            return []
        variable = best.term.regressor.plain  # each screen keeps one of what is one beside its fit
        series = next(s.series[variable] for s in screens if variable in s.series)
        z = np.concatenate(list(series.values()))
        wanted_there = law.law(z, best.term.values)
        found = []
        for form in plain:
            columns = np.column_stack([form.law(z, (1.0,)), np.ones(len(z))])
            sizes, *_ = np.linalg.lstsq(columns, wanted_there, rcond=None)
            left = float(np.var(wanted_there - columns @ sizes))
            if left < MUCH_LIKE * float(np.var(wanted_there)):
                size = float(sizes[0])
                term = replace(best.term, law=form, values=(size,), spreads=(abs(size),))
                found.append(self.fits.joint(base, term))
        return found

    def _harmonics(self, best: Tried) -> list[Tried]:
        """A sine that leaves more than noise, with its harmonics."""
        if best.term.law.name != "sine" or best.base is None or self._enough([best]):
            return []
        values, spreads = with_harmonics(best.term.values), with_harmonics(best.term.spreads)
        size = abs(values[0])
        own = replace(
            best.term,
            law=PERIODIC,
            values=values,
            spreads=tuple(s or size for s in spreads),
        )
        return [self.fits.joint(best.base, own)]

    def _diagnosed(self, best: Tried) -> Found:
        """The plant with the term in it, its values open as far as their fit leaves them, diagnosed
        as before: what the catalogue has beside it. An error of a sensor is taken out of what it
        has read instead.
        """
        self.say("missing term: diagnosis with it")
        task, term = self.found.task, best.term
        plant = with_term(task.plant, term, task.cache)
        plant = replace(plant, parameters={**plant.parameters, **term.starts})
        data = self._calibrated(term)
        if data is not None:
            made = run(replace(task, data=data), self.rules, self.say)
            return self.finish(replace(made, task=replace(task, plant=plant)))
        plant = replace(plant, nuisances=(*plant.nuisances, *best.nuisances))
        views, data = self.fits.recut(plant, term), task.data.each(term.within)
        made = run(replace(task, plant=plant, views=views, data=data), self.rules, self.say)
        return self.finish(made)

    def _calibrated(self, term: Term) -> Data | None:
        """The records without a sensor's error; None: the term is none, or cannot be taken out."""
        data, signal = self.found.task.data, read_by(self.found.task.plant, term)
        if signal is None:
            return None
        each = {r: calibrated(r, signal, term) for r in (*data.fitted, *data.unseen)}
        if any(r is None for r in each.values()):
            return None
        return data.each(lambda r: each[r] or r)


def _most(screen: Screen) -> float:
    """The gain of the best candidate."""
    return screen.candidates[0].gain if screen.candidates else 0.0


def _main(screens: Sequence[Screen]) -> Screen:
    """The one with the best candidate."""
    return max(screens, key=_most)


def _blamed(found: Found) -> frozenset[str] | None:
    """Views that stand out of the noise; None: none does, or no view is known to."""
    ratios: dict[str, float] = {}
    for channel in found.excess.whole:
        ratios[channel[0]] = max(ratios.get(channel[0], 0.0), found.excess.ratio(channel))
    most = max(ratios.values(), default=0.0)
    named = {v for v, ratio in ratios.items() if ratio > 1 + OUT * (most - 1)}
    return frozenset(named) if most > 1 and named else None


def _kind(candidate: Candidate) -> str:
    """Curve, wave, or which memory."""
    basis = candidate.basis
    if isinstance(basis, Remembered):
        return basis.memory.name
    return "wave" if isinstance(basis, Wave) else "curve"


NOTHING = "no variable of any component foretells what is left of a log that its curve has not seen"


def _unlikely(candidate: Candidate) -> tuple[bool, bool]:
    """Where the variable does not stand in the equation, and where that is no balance."""
    point = candidate.point
    return not point.reads(candidate.regressor.name), not point.balance


def _spreads(d: Distilled, candidate: Candidate) -> tuple[float, ...]:
    """Usual sizes of a form's parameters; of a width the share by which it may be off."""
    basis = candidate.basis
    if isinstance(basis, Remembered):
        return (abs(d.values[0]), *(0.5 for _ in basis.values))
    if d.law.tables:
        return (0.5,) * len(d.values)  # an effect's prior is two usual sizes wide
    span = float(np.ptp(basis.at)) if isinstance(basis, Knots) else d.values[1]
    width = 0.5 if isinstance(basis, Knots) else LINE
    sizes = {"size": 0.0, "width": width, "place": 0.1 * span}
    kinds = ("size", *d.law.shapes)
    return tuple(sizes[k] or max(abs(v), 1e-12) for k, v in zip(kinds, d.values, strict=True))
