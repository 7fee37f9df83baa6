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

from modelica_fmu.errors import InputError
from pneugantry.engine.answer.decide import Outstanding, stands_out
from pneugantry.engine.chances import UNEXPLAINED
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.plant import Data
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found, run
from pneugantry.engine.threads import on_threads, one_blas_thread
from pneugantry.engine.views.foreign import ForeignPlant
from pneugantry.learn.answer.read import with_readings, without_readings
from pneugantry.learn.equations.points import Opened, opened
from pneugantry.learn.experiments import Rival, TellingRun, telling
from pneugantry.learn.fitting.joint import TermFits
from pneugantry.learn.fitting.judge import Judge
from pneugantry.learn.fitting.partly import Partly
from pneugantry.learn.fitting.rivals import Rivals
from pneugantry.learn.fitting.rounds import Rounds
from pneugantry.learn.learned import Learned, Tried
from pneugantry.learn.screening.candidate import Screen
from pneugantry.learn.screening.candidates import main
from pneugantry.learn.screening.screen import Screening
from pneugantry.learn.terms.term import Term, with_term
from pneugantry.learn.wanted import wanted, whole

__all__ = ["learn"]

NOTHING = "no variable of any component predicts what is left of a log that its curve has not seen"
NO_FIT = "no term of any variable that was tried fits the logs clearly better than what is known"
Say = Callable[[str], None]
OUT = 0.3  # share of the worst view's excess from which on a view's equations are tried


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
    given, began = found.task, time.perf_counter()
    if isinstance(given.plant, ForeignPlant):
        raise InputError(
            "an FMU without source has no equations to add a term to",
            field="learn",
            hint="describe the plant by its Modelica source",
        )
    task = with_readings(given)
    found = replace(found, task=task)
    apart = opened(task.plant, task.views, task.cache)
    quick = replace(rules, followed=0)  # fits start where another one stands: no view is surveyed
    fits = TermFits(task, apart, quick, found.excess.level)
    made = _Learning(found, fits, say, finish).run()
    if made.best is not None:
        made = replace(made, units=made.best.term.units(apart.shape.units))
    made = made if task is given else without_readings(made, given)
    return replace(made, seconds=time.perf_counter() - began)


@dataclass(frozen=True, eq=False)
class _Told:
    """What the terms tried so far tell."""

    answers: tuple[Tried, ...]  # that the records do not tell apart
    after: Found  # the plant with the first of them, diagnosed
    least: float  # cost of the likeliest that was tried

    @property
    def formless(self) -> bool:
        """Whether the first answer has no form of the plant's own."""
        return self.answers[0].drifts or self.answers[0].free is not None


@dataclass(frozen=True, eq=False)
class _Learning:
    found: Found
    fits: TermFits
    say: Say
    finish: Callable[[Found], Found]

    @property
    def rounds(self) -> Rounds:
        return Rounds(self.fits)

    @property
    def rules(self) -> Rules:
        return self.fits.rules

    @property
    def apart(self) -> Opened:
        return self.fits.apart

    def run(self) -> Learned:
        """Screens beside nothing and, where that is not enough, beside the effects found. What does
        clearly better than these is told first: they may have stood in for it.
        """
        found = self.found
        tried: list[Tried] = []
        told: _Told | None = None
        bases = {fit.keys: fit for fit in (found.search.null, found.decision.best)}
        screens: list[Screen] = []
        twofold: list[Screen] = []
        for fit in bases.values():
            self.say("missing term: screening")
            single, double = self._screened(fit)
            screens.append(single)
            twofold.append(double)
            self.say("missing term: fits")
            tried += self.rounds.first(fit, single, double)
            if self.rounds.enough(tried):
                break
            if fit is found.search.null and self._leads(tried):
                tried, told = self._told(tried, screens, None)
                if not wanted(told.after):
                    break
        else:
            tried += self._beside(tried, screens, bases)
            tried += self.rounds.crossed(tried, bases)
        if not tried:
            return Learned(found, None, (), (), main(screens), False, NOTHING, 0.0)
        judge = Judge(found, self.fits, sum(s.tried for s in (*screens, *twofold)))
        if told is None and not any(map(judge.helps, tried)):
            tried += self.rounds.further(twofold, screens, tried)
            if not any(map(judge.helps, tried)):
                return Learned(found, None, (), _ordered(tried), main(screens), False, NO_FIT, 0.0)
        tried, told = self._told(tried, screens, told)
        if told.formless or wanted(told.after):  # a single variable does not tell it all
            self.say("missing term: products")
            tried = [*tried, *self.rounds.further(twofold, screens, tried)]
            tried, told = self._told(tried, screens, told)
        screens += twofold
        answers, after = told.answers, told.after
        kept = main(screens), *judge.judged(answers[0], after)
        experiment = self._experiment(answers)
        made = Learned(found, after, answers, _ordered(tried), *kept, 0.0, experiment)
        return replace(made, probability=judge.likely(answers[0]))

    def _leads(self, tried: Sequence[Tried]) -> bool:
        """Whether the likeliest term that has a form leaves the effects found hopelessly behind,
        and no curve leaves it there.
        """
        known, hopeless = self.found.decision.best, self.rules.hopeless
        least = min((t.cost for t in tried if t.free is None), default=math.inf)
        best = min((t.cost for t in tried), default=math.inf)
        behind = known.evidence + 2 * self.rules.entry * len(known.keys) - least
        return bool(known.keys) and behind > hopeless and least < best + hopeless

    def _told(
        self, tried: Sequence[Tried], screens: Sequence[Screen], before: _Told | None
    ) -> tuple[list[Tried], _Told]:
        """What was tried, its likeliest term otherwise, too, and what that tells; `before`, where
        nothing that came since is clearly likelier.
        """
        if before is not None:
            least = before.least - self.rules.entry
            if not any(t.cost < least for t in tried):
                return [*tried], before
        every = [*tried, *self.rounds.otherwise(tried, screens, self.found.search.null)]
        answers, after = self._answered(every)
        return every, _Told(answers, after, min(t.cost for t in every))

    def _beside(
        self,
        tried: Sequence[Tried],
        screens: list[Screen],
        bases: Mapping[tuple[str, ...], Fit],
    ) -> list[Tried]:
        """Effects of the catalogue as part of a curve that has no form; what is looked at beside
        them joins the screens.
        """
        made, likely = Partly(self.found, self.fits).composites(tried)
        for fit in likely:
            if fit.keys not in bases:
                screens.append(self._screening(fit).singles())
                made += self.rounds.best(fit, screens[-1])
        return made

    def _answered(self, tried: Sequence[Tried]) -> tuple[tuple[Tried, ...], Found]:
        """The terms that the records do not tell apart, and the plant with the first of them."""
        answers = Rivals(self.fits).answers(sorted(tried, key=lambda t: t.cost))
        return answers, self._diagnosed(answers[0])

    def _screened(self, fit: Fit) -> tuple[Screen, Screen]:
        """Single variables and products."""
        screening = self._screening(fit)
        return screening.singles(), screening.products()

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
        return Screening(self.apart, fit, of_views, whole(task), self.rules, blamed)

    def _experiment(self, answers: Sequence[Tried]) -> TellingRun | None:
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
        data, misread = self.found.task.data, self.fits.misreading(term)
        if misread is None:
            return None
        each = {r: misread.corrected(r) for r in (*data.fitted, *data.unseen)}
        if any(r is None for r in each.values()):
            return None
        return data.each(lambda r: each[r] or r)


def _ordered(tried: Sequence[Tried]) -> tuple[Tried, ...]:
    """The likeliest first."""
    return tuple(sorted(tried, key=lambda t: t.cost))


def _blamed(found: Found) -> frozenset[str] | None:
    """Views that stand out of the noise; None: none does by what is likely enough to be unknown, as
    where a replay alone does.
    """
    ratios: dict[str, float] = {}
    for channel in found.excess.whole:
        ratios[channel[0]] = max(ratios.get(channel[0], 0.0), found.excess.ratio(channel))
    most = max(ratios.values(), default=0.0)
    named = {v for v, ratio in ratios.items() if ratio > 1 + OUT * (most - 1)}
    left = Outstanding(math.log(max(most, 1.0)))
    told = stands_out(left, found.task.chances) >= UNEXPLAINED
    return frozenset(named) if told else None
