"""After "unknown": the term that the plant lacks, where it enters, of what variable, in which form.

Data flow one way: equations opened -> every equation with every variable, as a curve -> the field's
forms of the best curves -> each fitted jointly with all else -> the plant with the likeliest one,
diagnosed as before. A term is accepted where the record that no fit saw is replayed better with it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from modelica_fmu.errors import InputError
from pneugantry.engine import noise
from pneugantry.engine.confirm import Gap, Replay, replays, values_on
from pneugantry.engine.fitter import Fit, Fitter
from pneugantry.engine.foreign import ForeignPlant
from pneugantry.engine.hypothesis import Hypothesis
from pneugantry.engine.plant import Array, Nuisance, Plant, Record
from pneugantry.engine.predict import Foretelling
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found, Task, run
from pneugantry.engine.threads import on_threads, one_blas_thread
from pneugantry.engine.views import SubsystemView, View
from pneugantry.learn.composite import composites
from pneugantry.learn.curve import Knots, Wave
from pneugantry.learn.experiments import Experiment, Rival, telling
from pneugantry.learn.forms import FORMS, Distilled, FreeCurve, distilled, free_curve, wave_of
from pneugantry.learn.places import place_of
from pneugantry.learn.points import Opened, Point, opened, recut
from pneugantry.learn.regressors import TIME, Regressor
from pneugantry.learn.screen import Candidate, Screen, Screening
from pneugantry.learn.term import Term, with_term

__all__ = ["Learned", "Tried", "learn", "wanted"]

Say = Callable[[str], None]
NEARLY = 0.8  # share of the best curve's fall from which on a curve's forms are fitted
WORTH = 0.5  # share of the best candidate's gain from which on another one is fitted
FINALISTS = 2  # pairs of equation and variable that are fitted
SINGLES = 24  # effects of the catalogue that are tried as part of a curve
RIVALS = 4  # pairs that the record that no fit saw judges
COMPOSITES = 5  # known effects with a form beside them that are fitted
BESIDE = 2  # known effects beside which a term is looked for once more
LEFT = 0.5  # share of the gap's square that a term may leave
OPEN = 3.0  # standard deviations of a term's values in a diagnosis of the plant that has it
LOST = 1e6  # -2 log density of a replay that fails
LIKELY = 0.2  # probability of what no catalogue has, from which on it is looked for
OUT = 0.3  # share of the worst view's excess from which on a view's equations are tried
FAR = 100.0  # -2 log evidence behind the likeliest one from which on a term is no rival
CLOSE = 8.0  # -2 log evidence by which a form may lie behind the closest one to be fitted
LINE = 0.02  # relative error of a period that a spectrum tells
ANYWHERE = 0.29  # standard deviation of a place that nothing tells, as a share of the period
CLOSEST = 3  # forms of a pair that are fitted
MUCH_LIKE = 0.05  # share of a form's variance that one much like it leaves
NONE = np.zeros(0)


@dataclass(frozen=True, eq=False)
class Tried:
    """A term fitted jointly with everything else."""

    term: Term  # with the values of the fit
    fit: Fit
    cost: float  # -2 log evidence
    free: FreeCurve | None = None  # what the term is, where it has no form
    candidate: Candidate | None = None  # and where that comes from
    base: Fit | None = None  # what it was added to

    @property
    def covariance(self) -> Array:
        """Of the term's own values, those whose logarithm is fitted excepted."""
        coordinates = self.fit.point.coordinates
        names = [c.name for c in coordinates]
        index = [names.index(n) for n in self.term.parameters]
        units = np.array([coordinates[i].unit for i in index])
        return np.asarray(self.fit.covariance[np.ix_(index, index)] * np.outer(units, units))

    @property
    def drifts(self) -> bool:
        """Whether it is a function of time that does not repeat: what follows any state does."""
        return self.term.regressor.name == TIME and self.term.law.name != "sine"

    @property
    def nuisances(self) -> list[Nuisance]:
        """The term's own values as far as the fit leaves them open; a width as its share."""
        point, found = self.fit.point, []
        for c in (c for c in point.coordinates if c.name in self.term.parameters):
            sigma = OPEN * self.fit.sigma(c.name) * c.unit
            found.append(Nuisance(c.parameter, sigma, relative=c.logarithmic))
        own = [c for c in point.coordinates if c.parameter == self.term.own and c.record]
        if own:
            sigma = OPEN * max(self.fit.sigma(c.name) * c.unit for c in own)
            found.append(Nuisance(self.term.own, sigma, per_record=True))
        return found


@dataclass(frozen=True, eq=False)
class Learned:
    """What was found."""

    before: Found
    after: Found | None  # with the term; None: nothing worth fitting was found
    answers: tuple[Tried, ...]  # terms of other variables or equations that the logs do not tell
    # apart; the one that is taken first
    tried: tuple[Tried, ...]  # the likeliest first
    screen: Screen
    accepted: bool
    why: str  # one sentence
    seconds: float  # wall time
    next_experiment: Experiment | None = None  # that tells the first two answers apart

    @property
    def best(self) -> Tried | None:
        """The term that is taken."""
        return self.answers[0] if self.answers else None

    @property
    def shrink(self) -> float | None:
        """Of the gap of the record that no fit saw, from the nominal plant to that with the term
        and all that is known.
        """
        if self.after is None or self.after.gap is None or self.before.gap is None:
            return None
        new, nominal = self.after.gap, self.before.gap.nominal
        left = max(new.augmented**2 - new.floor**2, 0.0)
        return 1 - left / (nominal**2 - new.floor**2)


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
    apart = opened(task.plant, task.views, task.cache)
    made = _Learning(found, rules, say, finish, apart).run()
    return replace(made, seconds=time.perf_counter() - began)


@dataclass(frozen=True, eq=False)
class _Learning:
    found: Found
    rules: Rules
    say: Say
    finish: Callable[[Found], Found]
    apart: Opened

    @property
    def quick(self) -> Rules:
        """Fits start where another one stands: no view is surveyed."""
        return replace(self.rules, followed=0)

    def reached(self, term: Term) -> list[str]:
        """Views that a term reaches."""
        return [v.name for v in self.apart.readers(term.point)]

    def run(self) -> Learned:
        """Screens beside nothing and beside the effects found; where no form of that is enough,
        effects of the catalogue are tried as part of the curve.
        """
        found = self.found
        bases = {fit.keys: fit for fit in (found.search.null, found.decision.best)}
        self.say("missing term: screening")
        screenings = [self._screening(fit) for fit in bases.values()]
        screens = [s.singles() for s in screenings]
        self.say("missing term: fits")
        tried: list[Tried] = []
        for screen in screens:
            tried += self._fitted(screen, FINALISTS)
        if not tried:
            return Learned(found, None, (), (), _main(screens), False, NOTHING, 0.0)
        if not self._enough(min(tried, key=lambda t: t.cost)):
            made, likely = self._composites(tried)
            tried += made
            for fit in likely:
                if fit.keys not in bases:
                    screens.append(self._screening(fit).singles())
                    tried += self._fitted(screens[-1], 1)
        tried += self._plainer(min(tried, key=lambda t: t.cost), screens)
        tried.sort(key=lambda t: t.cost)
        answers = self._answers(tried)
        after = self._diagnosed(answers[0])
        if wanted(after) or answers[0].drifts:  # a single variable does not tell it all
            self.say("missing term: products")
            twofold = [s.products() for s in screenings]
            screens += twofold
            products = [t for s in twofold for t in self._fitted(s, FINALISTS)]
            if min((t.cost for t in products), default=math.inf) < tried[0].cost - self.rules.entry:
                tried = sorted([*tried, *products], key=lambda t: t.cost)
                answers = self._answers(tried)
                after = self._diagnosed(answers[0])
        accepted, why = self._judged(answers[0], after)
        kept = _main(screens), accepted, why
        experiment = self._experiment(answers)
        return Learned(found, after, answers, tuple(tried), *kept, 0.0, experiment)

    def _screening(self, fit: Fit) -> Screening:
        task, blamed = self.found.task, _blamed(self.found)
        fitter = Fitter(task.plant, task.views, task.data.fitted, self.quick)
        try:
            of_views = fitter.plain(fit.residuals)
        finally:
            fitter.close()
        bases = (fit, self.found.search.null, self.found.decision.best)
        moving = {c.parameter for base in bases for c in base.point.coordinates}
        own = {n for r in task.data.fitted for n in r.parameters}
        stand_out = [v for v in self.apart.views if blamed is None or v.name in blamed]
        on_threads(lambda v: v.prepare(moving | own, fit.hypothesis.settings), stand_out)
        return Screening(self.apart, fit, of_views, task.data.fitted, self.rules, blamed)

    def _worth_fitting(self, screen: Screen) -> list[Candidate]:
        """The best curve and the best wave of each variable in each block. Of equations that do as
        well one comes first in which the variable stands already, and a balance.
        """
        least = self.rules.entry
        if screen.candidates:
            least = max(least, WORTH * screen.candidates[0].gain)
        families: dict[tuple[str, str, str, str, bool], list[Candidate]] = {}
        for c in screen.candidates:
            root = self.apart.shape.roots.get(c.regressor.label, c.regressor.plain.label)
            if c.regressor.speed:
                root = self.apart.shape.roots.get(c.regressor.plain.label, root)
            wave = isinstance(c.basis, Wave)
            key = self.apart.block(c.point), root, c.regressor.speed, c.regressor.times, wave
            if c.gain > least:
                families.setdefault(key, []).append(c)
        found: list[Candidate] = []
        for members in families.values():
            close = [c for c in members if c.gain >= members[0].gain - self.rules.entry]
            found.append(min(close, key=_unlikely))
        return sorted(found, key=lambda c: -c.gain)

    def _enough(self, tried: Tried) -> bool:
        """Whether a term has a form and leaves no more than noise in any view."""
        if tried.free is not None:
            return False
        fitter = self._fitter(tried.term)
        try:
            return not fitter.loud(tried.fit)
        finally:
            fitter.close()

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
            found.append(self._joint(c.effect, term, c.starts))
        firsts = {c.effect.keys: c.effect for c in likely[:COMPOSITES]}
        firsts |= {f.keys: f for f in effects[:1]}
        return found, list(firsts.values())[:BESIDE]

    def _singles(self, term: Term) -> list[Fit]:
        """Single effects that are read where a term is: as the search has fitted them, and those
        that it did not, for alone they explained too little.
        """
        task, null, reached = self.found.task, self.found.search.null, set(self.reached(term))
        found = {f.keys: f for f in self.found.search.tried if len(f.keys) == 1}
        fitter = Fitter(task.plant, task.views, task.data.fitted, self.quick)
        try:
            for key, effect in task.catalogue.items():
                hypothesis = Hypothesis().plus(effect, effect.forms[0])
                seen = reached & {c[0] for c in fitter.touched(hypothesis)}
                if seen and (key,) not in found and len(found) < SINGLES:
                    found[key,] = fitter.explore(hypothesis, null)
        finally:
            fitter.close()
        return sorted(found.values(), key=lambda f: f.evidence)

    def _answers(self, tried: Sequence[Tried]) -> tuple[Tried, ...]:
        """The likeliest term, and the best one of each other pair of equation and variable that
        neither the fitted records nor the one that no fit saw tell from it. Of these a function
        of time comes last: it is none of the plant, and any state that all records pass at the
        same time looks like one; before it what turns round with a speed, which says more. What is
        fed to the plant comes first: what follows from it does the same.
        """
        pairs: dict[tuple[Point, Regressor], Tried] = {}
        for t in tried:
            pairs.setdefault((t.term.point, t.term.regressor), self._simplest(t, tried))
        rest = [self._placed(self._again(t)) for t in list(pairs.values())[:RIVALS]]
        least = min(t.cost for t in rest)
        rest = [t for t in rest if t.cost < least + FAR]
        told = {t: self._foretold(t) if len(rest) > 1 else NONE for t in rest}
        likeliest = min(rest, key=lambda t: t.cost + float(told[t].sum()))
        close = [t for t in rest if t is likeliest or not self._tells(likeliest, t, told)]
        total = {t: t.cost + float(told[t].sum()) for t in close}

        roots = self.apart.shape.roots
        fed = {roots.get(name, name) for name in self.found.task.plant.inputs}

        def rank(t: Tried) -> tuple[bool, bool, bool, bool, float]:
            own = t.term.regressor
            follows = roots.get(own.plain.label) not in fed
            turned = bool(own.speed) or bool(own.times)
            return own.name == TIME, own.travelled, turned, follows, total[t]

        return tuple(sorted(close, key=rank))

    def _simplest(self, best: Tried, tried: Sequence[Tried]) -> Tried:
        """The form of fewest parameters of the same variable in the same equation that the fitted
        records do not tell from the best one.
        """
        own = best.term
        close = [
            t
            for t in tried
            if (t.term.point, t.term.regressor) == (own.point, own.regressor)
            and len(t.term.values) < len(own.values)
            and (
                t.cost < best.cost + self.rules.entry
                or not self._tells(best, t, {best: NONE, t: NONE})
            )
        ]
        return min(close, key=lambda t: (len(t.term.values), t.cost), default=best)

    def _tells(self, a: Tried, b: Tried, told: Mapping[Tried, Array]) -> bool:
        """Whether the records prefer a term to another by more than their noise."""
        falls = [x - y for x, y in zip(_stretches(b), _stretches(a), strict=True)]
        fall = noise.doubted(np.concatenate([*falls, told[b] - told[a]]), self.rules.doubt)
        rest = b.cost - a.cost - sum(float(f.sum()) for f in falls)  # Occam's share
        return fall + rest > self.rules.entry

    def _foretold(self, tried: Tried) -> Array:
        """-2 log density of the record that no fit saw, replayed with a term, by stretch."""
        task, record = self.found.task, self.found.task.data.held_out
        if record is None:
            return NONE
        plant = with_term(task.plant, tried.term, task.cache, blank=True)
        replay = replays(plant, record, [self._values(tried, record)], task.cache)[0]
        if replay is None:
            return np.array([LOST])
        return self._loss(replay)

    def _loss(self, replay: Replay) -> Array:
        """-2 log density of a replay, by stretch."""
        rows = np.nan_to_num(replay.residuals) / max(1.0, self.found.excess.level)
        count = max(1, round(len(rows) * replay.period / self.rules.block))
        terms = noise.loss(rows, self.rules.tails).sum(axis=1)
        return np.array([float(part.sum()) for part in np.array_split(terms, count)])

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

    def _fitted(self, screen: Screen, count: int) -> list[Tried]:
        """The best candidates of a screen as waves and free curves; those that explain about as
        much as the best one also in the forms that are closest to their curve. A wave may be worth
        more than it looks, where what it does is no longer linear: it is fitted beside a curve.
        """
        base, worth = screen.fit, self._worth_fitting(screen)[:count]
        waves = [w for c in worth for w in self._waves_beside(screen, c) if w not in worth]
        first = [self._free(base, c) for c in (*worth, *waves)]
        fall = max((base.evidence - t.fit.evidence for t in first), default=0.0)
        found = list(first)
        for t in first:
            if t.free is not None and base.evidence - t.fit.evidence > NEARLY * fall:
                found += self._forms(base, t)
        return found

    def _waves_beside(self, screen: Screen, curve: Candidate) -> list[Candidate]:
        """The best wave of a curve's variable in its equation."""
        own = (curve.point, curve.regressor)
        waves = [
            c
            for c in screen.candidates
            if isinstance(c.basis, Wave) and (c.point, c.regressor) == own
        ]
        return [c for c in waves[:1] if c.gain > self.rules.entry]

    def _free(self, base: Fit, candidate: Candidate) -> Tried:
        """A candidate as a wave, or as a free curve."""
        if isinstance(candidate.basis, Wave):
            return self._joint(base, self._term(candidate, wave_of(candidate, candidate.basis)))
        assert isinstance(candidate.basis, Knots)
        free = free_curve(candidate, candidate.basis)
        fitted = self._joint(base, self._term(candidate, free.start))
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
        return [self._joint(base, self._term(candidate, d)) for d in near]

    def _joint(self, base: Fit, term: Term, starts: Mapping[str, float] | None = None) -> Tried:
        """A term beside the effects of a fit; starts: of their parameters, where not as fitted."""
        fitter, effect = self._fitter(term), term.effect
        try:
            hypothesis = base.hypothesis.plus(effect, effect.forms[0])
            fit = fitter.explore(hypothesis, base, [{**(starts or {}), **term.starts}])
        finally:
            fitter.close()
        return replace(self._tried(term, fit), base=base)

    def _tried(self, term: Term, fit: Fit) -> Tried:
        values = fit.values(None)
        price = 2 * self.rules.entry * len(fit.keys)
        places = {r: fit.values(r).get(term.own, at) for r, at in term.places.items()}
        made = term.at([values[n] for n in term.parameters], places)
        return Tried(made, fit, fit.evidence + price)

    def _plainer(self, best: Tried, screens: Sequence[Screen]) -> list[Tried]:
        """The forms without any shape that are much like a term's over what the records cover: a
        fit that started far off has bent the shape to what it could not tell yet.
        """
        law, base = best.term.law, best.base
        plain = [f for f in FORMS if not f.shapes]
        if base is None or best.free is not None or best.term.places or law in plain:
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
                found.append(self._joint(base, term))
        return found

    def _again(self, tried: Tried) -> Tried:
        """With all views fitted together."""
        fitter = self._fitter(tried.term)
        try:
            made = self._tried(tried.term, fitter.again(tried.fit))
        finally:
            fitter.close()
        return replace(tried, term=made.term, fit=made.fit, cost=made.cost)

    def _placed(self, tried: Tried) -> Tried:
        """With what records that no fit has seen have of their own."""
        term, places = tried.term, dict(tried.term.places)
        for record in self.found.task.data.unseen if places else ():
            plant, views = self._with(term)
            fitter = Fitter(plant, views, [record], self.quick)
            try:
                values = {**values_on(tried.fit, record), **term.settings}
                period = term.values[1]
                places[record.name] = place_of(fitter.simulation, values, term.own, period)
            finally:
                fitter.close()
        return replace(tried, term=replace(term, places=places))

    @staticmethod
    def _values(tried: Tried, record: Record) -> dict[str, float]:
        """What a fit with a term says of a record that it has not seen."""
        own = tried.term.within(record).parameters
        return {
            **values_on(tried.fit, record),
            **{k: own[k] for k in own.keys() - record.parameters},
        }

    def _fitter(self, term: Term) -> Fitter:
        plant, views = self._with(term)
        records = [term.within(r) for r in self.found.task.data.fitted]
        return Fitter(plant, views, records, self.quick, self.found.excess.level)

    def _with(self, term: Term) -> tuple[Plant, list[View]]:
        """The plant with a term, and its views."""
        task = self.found.task
        plant = with_term(task.plant, term, task.cache, blank=True)
        # what says which form it is stays open, so that one part does for all forms
        plant = replace(plant, parameters={**plant.parameters, **term.settings})
        if term.places:
            own = Nuisance(term.own, ANYWHERE * term.values[1], per_record=True)
            plant = replace(plant, nuisances=(*plant.nuisances, own))
        return plant, _recut(task, plant, self.reached(term))

    def _diagnosed(self, best: Tried) -> Found:
        """The plant with the term in it, its values open as far as their fit leaves them, diagnosed
        as before: what the catalogue has beside it.
        """
        self.say("missing term: diagnosis with it")
        task, term = self.found.task, best.term
        plant = with_term(task.plant, term, task.cache)
        plant = replace(
            plant,
            parameters={**plant.parameters, **term.starts},
            nuisances=(*plant.nuisances, *best.nuisances),
        )
        views = _recut(task, plant, self.reached(term))
        data = task.data.each(term.within)
        made = run(replace(task, plant=plant, views=views, data=data), self.quick, self.say)
        return self.finish(made)

    def _judged(self, best: Tried, after: Found) -> tuple[bool, str]:
        """Whether the term stands, and why."""
        before, price = self.found, 2 * self.rules.entry
        known = (before.search.null, before.decision.best)
        plain = min(known, key=lambda f: f.evidence + price * len(f.keys))
        if best.cost > plain.evidence + price * len(plain.keys) - self.rules.entry:
            return False, "the term brings the fitted logs nothing: located, not explained"
        old, new = before.gap, after.gap
        if old is None or new is None or before.augmented is None or after.augmented is None:
            return False, "no log could be replayed: located, not explained"
        verb = "falls" if new.augmented < old.augmented else "goes"
        fall = f"the gap of {new.record} {verb} from {old.augmented:.3g} to {new.augmented:.3g}"
        falls = self._loss(before.augmented) - self._loss(after.augmented)
        better = noise.doubted(falls, self.rules.doubt) > self.rules.entry
        hangs = _hangs(old) or _hangs(new)
        if not better and (hangs or new.augmented < old.augmented):
            better = self._foretells(best, plain)
        if not better:
            return False, (
                f"{new.record} is replayed no better with the term ({old.augmented:.3g} before, "
                f"{new.augmented:.3g} with it): located, not explained"
            )
        floor = min(new.floor, new.augmented) ** 2
        left, gap = new.augmented**2 - floor, old.augmented**2 - floor
        by_replay = not hangs and left <= LEFT * gap
        if hangs:
            fall += ", a replay that hangs on an event"
        if not by_replay and _standing(after) > LEFT * _standing(before):  # then the views tell
            return False, f"{fall}, and more is left than explained: located, not explained"
        if not (by_replay or hangs):
            fall += ", an error that a replay carries on"
        return True, fall

    def _foretells(self, best: Tried, plain: Fit) -> bool:
        """Whether the views foretell the record that no fit saw better with a term, under noise of
        the sensors' colour, for that of the residuals holds a term that repeats: a whole replay
        hangs on single events (a carriage that breaks away).
        """
        record = self.found.task.data.held_out
        if record is None:
            return False
        fitter = self._fitter(best.term)
        try:
            views = list(fitter.simulation.views.values())
            foretelling = Foretelling(fitter, views, best.term.within(record), plain=True)
            try:
                (gain,) = foretelling.gains([best.fit], plain)
            finally:
                foretelling.close()
        finally:
            fitter.close()
        return gain > self.rules.effect


def _hangs(gap: Gap) -> bool:
    """Whether a replay says little of the plant: it hangs on an event that was met or missed."""
    return gap.bifurcates or gap.parted is not None


def _standing(found: Found) -> float:
    """How far the view that stands out most does so."""
    return max((found.excess.ratio(c) - 1 for c in found.excess.whole), default=0.0)


def _stretches(tried: Tried) -> list[Array]:
    return [tried.fit.stretches[c] for c in sorted(tried.fit.stretches)]


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


def _unlikely(candidate: Candidate) -> tuple[bool, bool]:
    """Where the variable does not stand in the equation, and where that is no balance."""
    point = candidate.point
    return not point.reads(candidate.regressor.name), not point.balance


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
    """Views of the plant with a term: those that it does not reach stay as they are."""
    return [
        recut(view, plant, task.cache)
        if isinstance(view, SubsystemView) and view.name in reached
        else view
        for view in task.views
    ]
