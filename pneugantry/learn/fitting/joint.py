"""A term fitted jointly with everything else: tolerance, nuisances and known effects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from pneugantry.engine.answer.confirm import Replay, values_on
from pneugantry.engine.answer.predict import PredictiveScore, Predictor
from pneugantry.engine.fitting import noise
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.fitting.noise import Noise
from pneugantry.engine.plant import Array, Nuisance, Plant, Record
from pneugantry.engine.recent import Recent
from pneugantry.engine.rules import Rules
from pneugantry.engine.signals.sensors import PREFIX
from pneugantry.engine.task import Task
from pneugantry.engine.views.subsystem import SubsystemView
from pneugantry.engine.views.view import View
from pneugantry.learn.curves.places import place_of
from pneugantry.learn.equations.points import Opened, recut
from pneugantry.learn.learned import Tried
from pneugantry.learn.terms.calibrated import KEPT, Calibrated, Misreading, misreading
from pneugantry.learn.terms.term import Term, with_term

__all__ = ["TermFits"]

ANYWHERE = 0.29  # standard deviation of a place that nothing tells, as a share of the period


@dataclass(frozen=True, eq=False)
class TermFits:
    """Fits terms of one diagnosed plant. level: how much noisier its sensors are than quoted."""

    task: Task
    apart: Opened
    rules: Rules  # without surveys: fits start where another one stands
    level: float

    def reached(self, term: Term) -> list[str]:
        """Views that a term reaches."""
        return [v.name for v in self.apart.readers(term.point)]

    def joint(self, base: Fit, term: Term, starts: Mapping[str, float] | None = None) -> Tried:
        """A term beside the effects of a fit; starts: of parameters of effects, and of others that
        are one for all records, where not as fitted. A sensor's error starts where its own view has
        it, too, which is near a straight line in it: others may pass events.
        """
        beside = starts or {}
        first = [{**beside, **term.starts}]
        if self.misreading(term) is not None:
            alone = self._explored(self._of_plant(term), base, term, first)
            first.append({**beside, **self.tried(term, alone).term.starts})
        fit = self._explored(self.fitter(term), base, term, first)
        return replace(self.tried(term, fit), base=base)

    def _explored(
        self, fitter: Fitter, base: Fit, term: Term, starts: Sequence[Mapping[str, float]]
    ) -> Fit:
        """A term beside a fit; closes the fitter. Where tolerance is bent to make up for what is
        missing, a fit starts from its description, too: on the way back events lie.
        """
        effect = term.effect
        if fitter.far_off(base):
            starts = [*starts, {**starts[0], **base.nominal, **term.starts}]
        try:
            hypothesis = base.hypothesis.plus(effect, effect.forms[0])
            return fitter.explore(hypothesis, base, starts)
        finally:
            fitter.close()

    def tried(self, term: Term, fit: Fit) -> Tried:
        """The term with the values that a fit gave it; its cost has a price for each effect."""
        values = fit.values(None)
        price = 2 * self.rules.entry * len(fit.keys)
        places = {r: fit.values(r).get(term.own, at) for r, at in term.places.items()}
        made = term.at([values[n] for n in term.parameters], places)
        return Tried(made, fit, fit.evidence + price)

    def again(self, tried: Tried) -> Tried:
        """The same term with all views fitted together."""
        if tried.fit.whole:
            return tried
        fitter = self.fitter(tried.term)
        try:
            start = replace(tried.fit, settled=False, tangents={})
            made = self.tried(tried.term, fitter.again(start))
        finally:
            fitter.close()
        return replace(tried, term=made.term, fit=made.fit, cost=made.cost)

    def loud(self, tried: Tried) -> list[str]:
        """Views in which a term leaves more than noise."""
        fitter = self.fitter(tried.term)
        try:
            return fitter.loud(tried.fit)
        finally:
            fitter.close()

    def placed(self, tried: Tried) -> Tried:
        """The same term with what it has of its own in records that no fit has seen."""
        term, places = tried.term, dict(tried.term.places)
        for record in self.task.data.unseen if places else ():
            plant, views = self.plant_with(term)
            fitter = Fitter(plant, views, [record], self.rules)
            try:
                values = {**values_on(tried.fit, record), **term.settings}
                period = term.values[1]
                places[record.name] = place_of(fitter.simulation, values, term.own, period)
            finally:
                fitter.close()
        return replace(tried, term=replace(term, places=places))

    @contextmanager
    def predictor(self, term: Term, record: Record) -> Iterator[Predictor]:
        """A record that no fit saw, beside fits with a term, under noise of the sensors' colour,
        for that of the residuals holds a term that repeats.
        """
        fitter = self.fitter(term)
        try:
            views = list(fitter.simulation.views.values())
            made = Predictor(fitter, views, term.within(record), plain=True)
            try:
                yield made
            finally:
                made.close()
        finally:
            fitter.close()

    def scores(self, tried: Sequence[Tried]) -> dict[Tried, PredictiveScore]:
        """What the records that no fit saw say of each term, by the views, under the noise that the
        first leaves: a whole replay hangs on single events (a carriage that breaks away).
        """
        found = dict.fromkeys(tried, PredictiveScore())
        for record in self.task.data.unseen if len(tried) > 1 else ():
            of_views: Noise | None = None
            for t in tried:
                with self.predictor(t.term, record) as predictor:
                    one, of_views = predictor.score(t.fit, of_views)
                found[t] = found[t].beside(one)
        return found

    def loss(self, replay: Replay) -> Array:
        """-2 log density (stretches,) of a replay."""
        rows = np.nan_to_num(replay.residuals) / max(1.0, self.level)
        count = max(1, len(rows) // self.rules.stretch(replay.period, len(rows)))
        terms = noise.loss(rows, self.rules.tails).sum(axis=1)
        return np.array([float(part.sum()) for part in np.array_split(terms, count)])

    def fitter(self, term: Term) -> Fitter:
        """Of the plant with a term; of a sensor's error of the plant as it is, whose views are
        shown readings without it. To be closed.
        """
        misread = self.misreading(term)
        return self._of_plant(term) if misread is None else self._corrected(misread)

    def _of_plant(self, term: Term) -> Fitter:
        plant, views = self.plant_with(term)
        records = [term.within(r) for r in self.task.data.fitted]
        return Fitter(plant, views, records, self.rules, self.level)

    def misreading(self, term: Term) -> Misreading | None:
        """What a sensor's error is a function of; None: the term is none that can be taken out of
        all records.
        """
        task, data = self.task, self.task.data
        found = misreading(task.plant, term, self.apart.shape.roots)
        whole = found is not None and all(map(found.told, (*data.fitted, *data.unseen)))
        return found if whole else None

    def _corrected(self, misread: Misreading) -> Fitter:
        task, error = self.task, f"{PREFIX}{misread.signal}.bias"  # who reads it feels this
        kept: Recent[Record | None] = Recent(KEPT)
        views = [Calibrated(v, misread, kept) if v.depends_on(error) else v for v in task.views]
        return Fitter(task.plant, views, task.data.fitted, self.rules, self.level)

    def plant_with(self, term: Term) -> tuple[Plant, list[View]]:
        """The plant with a term, and its views."""
        task = self.task
        plant = with_term(task.plant, term, task.cache, blank=True)
        # what says which form it is stays open, so that one part does for all forms
        plant = replace(plant, parameters={**plant.parameters, **term.settings})
        if term.places:
            own = Nuisance(term.own, ANYWHERE * term.values[1], per_record=True)
            plant = replace(plant, nuisances=(*plant.nuisances, own))
        return plant, self.recut(plant, term)

    def recut(self, plant: Plant, term: Term) -> list[View]:
        """Views of the plant with a term: those that do not have it stay as they are."""
        fed = [v.name for v in self.apart.fed(term.point)]
        return [
            recut(view, plant, self.task.cache)
            if isinstance(view, SubsystemView) and view.name in fed
            else view
            for view in self.task.views
        ]
