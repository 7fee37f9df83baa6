"""What learning a missing term finds, as frozen data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pneugantry.engine.answer.confirm import shrink_of
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.plant import Array, Nuisance
from pneugantry.engine.run import Found
from pneugantry.learn.experiments import TellingRun
from pneugantry.learn.screening.candidate import Candidate, Screen
from pneugantry.learn.screening.regressors import TIME
from pneugantry.learn.terms.forms import FreeCurve
from pneugantry.learn.terms.term import Term

__all__ = ["Learned", "Tried"]

OPEN = 3.0  # standard deviations of a term's values in a diagnosis of the plant that has it


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
        return self.term.regressor.name == TIME and not self.term.law.repeats

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
    next_experiment: TellingRun | None = None  # that tells the first two answers apart
    units: tuple[str, str] = ("", "")  # of the term's variable, and of what it adds
    probability: float = 0.0  # of the term that is taken, by the fitted logs

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
        new = self.after.gap
        return shrink_of(self.before.gap.nominal, new.augmented, new.floor)
