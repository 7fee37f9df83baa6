"""Candidates as terms in the field's forms, each fitted jointly with all else."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pneugantry.engine.fitting.fit import Fit
from pneugantry.learn.curves.curve import Knots, Wave
from pneugantry.learn.curves.memory import Remembered
from pneugantry.learn.fitting.joint import TermFits
from pneugantry.learn.learned import Tried
from pneugantry.learn.screening.candidate import Candidate, Screen
from pneugantry.learn.terms.forms import (
    LINE,
    PERIODIC,
    Distilled,
    distilled,
    distinct,
    free_curve,
    line_of,
    memory_of,
    wave_of,
    with_harmonics,
)
from pneugantry.learn.terms.term import Term

__all__ = ["Shaping"]

NEARLY = 0.5  # share of the best curve's fall from which on a curve's forms are fitted
SPECTRAL = 0.02  # relative error of a period that a spectrum tells
CLOSE = 8.0  # -2 log evidence by which a form may lie behind the closest one to be fitted
CLOSEST = 3  # forms of a pair that are fitted
MUCH_LIKE = 0.05  # share of a form's variance that one much like it leaves


@dataclass(frozen=True, eq=False)
class Shaping:
    """Fits candidates of one diagnosed plant in their forms."""

    fits: TermFits

    def fitted(self, base: Fit, worth: Sequence[Candidate]) -> list[Tried]:
        """Candidates beside a fit as waves, memories and free curves; those that explain about as
        much as the best one also in the forms that are closest to their curve.
        """
        first = [self._free(base, c) for c in worth]
        fall = max((base.evidence - t.fit.evidence for t in first), default=0.0)
        found = list(first)
        for t in first:
            if t.free is not None and base.evidence - t.fit.evidence > NEARLY * fall:
                found += self._forms(base, t)
        return found

    def term(self, candidate: Candidate, d: Distilled) -> Term:
        """A candidate in a form, from where its curve has it."""
        block, spreads = self.fits.apart.block(candidate.point), _spreads(d, candidate)
        term = Term(candidate.point, candidate.regressor, d.law, d.values, spreads, block)
        if not d.places:
            return term
        return replace(term, places=dict(zip(candidate.course.values, d.places, strict=True)))

    def _free(self, base: Fit, candidate: Candidate) -> Tried:
        """A candidate as a wave, a memory or a free curve."""
        if isinstance(candidate.basis, Remembered):
            made = memory_of(candidate, candidate.basis)
            return replace(self.fits.joint(base, self.term(candidate, made)), candidate=candidate)
        if isinstance(candidate.basis, Wave):
            made = wave_of(candidate, candidate.basis)
            return replace(self.fits.joint(base, self.term(candidate, made)), candidate=candidate)
        assert isinstance(candidate.basis, Knots)
        free = free_curve(candidate, candidate.basis)
        fitted = self.fits.joint(base, self.term(candidate, free.start))
        return replace(fitted, free=free, candidate=candidate)

    def _forms(self, base: Fit, fitted: Tried) -> list[Tried]:
        """The forms that are closest to a free curve as it has been fitted, with all else where it
        is beside that curve.
        """
        free, candidate = fitted.free, fitted.candidate
        assert free is not None
        assert candidate is not None
        curve, covariance = free.curve(fitted.term.values, fitted.covariance)
        forms = distilled(free.knots, curve, covariance)
        near = [d for d in forms if d.cost < forms[0].cost + CLOSE][:CLOSEST]
        if all(d.law.shapes for d in near):
            near.append(next(d for d in forms if not d.law.shapes))  # it may do as well
        if any(d.law.name == "linear" for d in near):  # tolerance may not have its constant
            line = line_of(free.knots, curve, covariance)
            near += [line] if line is not None else []
        beside = _beside(fitted.fit)
        return [self.fits.joint(base, self.term(candidate, d), beside) for d in near]

    def plainer(
        self, best: Tried, screens: Sequence[Screen], known: Collection[str] = ()
    ) -> list[Tried]:
        """The forms without any shape, but for those known, that are much like a term's over what
        the records cover: a fit that started far off has bent the shape to what it could not tell
        yet.
        """
        law, base = best.term.law, best.base
        bare = best.free is not None or best.term.places or law.memory is not None
        if base is None or bare or not law.shapes:
            return []
        variable = best.term.regressor.plain  # each screen keeps one of what is one beside its fit
        series = next(s.series[variable] for s in screens if variable in s.series)
        z = np.concatenate(list(series.values()))
        wanted_there = law.law(z, best.term.values)
        found = []
        for form in (f for f in distinct(z) if not f.shapes):
            columns = np.column_stack([form.law(z, (1.0,)), np.ones(len(z))])
            sizes, *_ = np.linalg.lstsq(columns, wanted_there, rcond=None)
            left = float(np.var(wanted_there - columns @ sizes))
            if form.name not in known and left < MUCH_LIKE * float(np.var(wanted_there)):
                size = float(sizes[0])
                term = replace(best.term, law=form, values=(size,), spreads=(abs(size),))
                found.append(self.fits.joint(base, term))
        return found

    def harmonics(self, best: Tried) -> list[Tried]:
        """A sine that leaves more than noise, with its harmonics."""
        if best.term.law.name != "sine" or best.base is None or not self.fits.loud(best):
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


def _beside(fit: Fit) -> dict[str, float]:
    """What belongs to all records and to no effect, as a fit has it."""
    values = fit.values(None)
    own = (c for c in fit.point.coordinates if not c.effect and c.record is None)
    return {c.parameter: values[c.parameter] for c in own if c.parameter in values}


def _spreads(d: Distilled, candidate: Candidate) -> tuple[float, ...]:
    """Usual sizes of a form's parameters; of a width the share by which it may be off."""
    basis = candidate.basis
    if isinstance(basis, Remembered):
        return (max(abs(d.values[0]), candidate.unit), *(0.5 for _ in basis.values))
    if d.law.tables:
        return (0.5,) * len(d.values)  # an effect's prior is two usual sizes wide
    span = float(np.ptp(basis.at)) if isinstance(basis, Knots) else d.values[1]
    width = 0.5 if isinstance(basis, Knots) else SPECTRAL
    place = span if d.law is LINE else 0.1 * span  # its constant is one with the model's own
    sizes = {"size": 0.0, "width": width, "place": place}
    kinds = ("size", *d.law.shapes)
    return tuple(sizes[k] or max(abs(v), 1e-12) for k, v in zip(kinds, d.values, strict=True))
