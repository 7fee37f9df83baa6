"""Which candidates of a screen are fitted, round by round, until one is enough."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from pneugantry.engine.fitting.fit import Fit
from pneugantry.learn.equations.points import Point
from pneugantry.learn.fitting.joint import TermFits
from pneugantry.learn.fitting.rivals import Rivals
from pneugantry.learn.fitting.shaping import Shaping
from pneugantry.learn.learned import Tried
from pneugantry.learn.screening.candidate import Candidate, Screen
from pneugantry.learn.screening.candidates import (
    WORTH,
    elsewhere,
    most,
    of_few_parameters,
    shaped,
    variables_of,
    without,
    worth_fitting,
)
from pneugantry.learn.screening.regressors import Regressor

__all__ = ["Rounds"]

CLEARLY = 1.1  # times the gain of single variables, from which on products are fitted first
FINALISTS = 2  # pairs of equation and variable that are fitted
TURNS = 3  # of as many, where the first ones hold less than a share of what they foretold
HELD = 0.2
PLAINER = 3  # pairs of which plainer forms are fitted
CROSSED = 3  # terms that are fitted beside each base


@dataclass(frozen=True, eq=False)
class Rounds:
    """Fits what screens of one diagnosed plant foretell."""

    fits: TermFits

    @property
    def shaping(self) -> Shaping:
        """Of their forms."""
        return Shaping(self.fits)

    def first(self, fit: Fit, single: Screen, products: Screen) -> list[Tried]:
        """Single variables, and products that may do as well; products alone, where they predict
        clearly more and are enough.
        """
        likely = self._worth(products)[:FINALISTS]
        tried: list[Tried] = []
        if most(products) > CLEARLY * most(single):
            tried += self.shaping.fitted(fit, self._shaped(products, likely))
            if self.enough(tried):
                return tried
            likely = []
        least = WORTH * most(single)
        own = self._shaped(products, [c for c in likely if c.gain > least])
        return [*tried, *self._singles_of(fit, single, own)]

    def _singles_of(self, fit: Fit, screen: Screen, beside: Sequence[Candidate]) -> list[Tried]:
        """Single variables, the likeliest equations first. Where these hold little of what they
        foretold, for it was no straight line, others have their turn.
        """
        tried: list[Tried] = []
        for turn in range(TURNS):
            worth = self._worth(screen)
            worth = [*worth[:FINALISTS], *elsewhere(screen, worth, self.fits.apart)]
            chosen = self._shaped(screen, list(dict.fromkeys(worth)))
            tried += self.shaping.fitted(fit, [*chosen, *beside])
            tried += [] if turn else self._of_few_parameters(fit, screen, tried)
            least = min((t.cost for t in tried), default=math.inf)
            if not chosen or fit.evidence - least > HELD * most(screen):
                break
            screen, beside = without(screen, chosen), ()
        return tried

    def _of_few_parameters(self, fit: Fit, screen: Screen, tried: Sequence[Tried]) -> list[Tried]:
        """Where what leads leaves more than noise, what no screen foretells well."""
        best = min(tried, key=lambda t: t.cost, default=None)
        made: list[Tried] = []
        if best is None:
            return made
        known = {t.candidate for t in tried}
        for likely in of_few_parameters(screen, best.term.point, self.fits.apart, self.fits.rules):
            if not self.enough([*tried, *made]):
                made += self.shaping.fitted(fit, [c for c in likely if c not in known])
        return made

    def further(
        self, products: Sequence[Screen], singles: Sequence[Screen], tried: Sequence[Tried]
    ) -> list[Tried]:
        """The best products that have not been fitted yet, and by themselves the variables that
        they are of: one may do as well, in a form that no screen foretells.
        """
        known = {(t.term.point, t.term.regressor) for t in tried}
        made: list[Tried] = []
        for s in products:
            worth = self._worth(s)
            new = [c for c in worth if (c.point, c.regressor) not in known]
            made += self.shaping.fitted(s.fit, self._shaped(s, new[:FINALISTS]))
            own = [c for x in singles if x.fit is s.fit for c in variables_of(x, worth[:FINALISTS])]
            new = [c for c in own if (c.point, c.regressor) not in known]
            made += self.shaping.fitted(s.fit, new)
        return made

    def best(self, base: Fit, screen: Screen) -> list[Tried]:
        """The likeliest candidate of a screen."""
        return self.shaping.fitted(base, self._shaped(screen, self._worth(screen)[:1]))

    def crossed(self, tried: Sequence[Tried], bases: Mapping[tuple[str, ...], Fit]) -> list[Tried]:
        """The likeliest terms, as they were fitted beside one base, beside the others: where a fit
        ends depends on what it starts beside.
        """
        made = []
        for t in sorted(tried, key=lambda t: t.cost)[:CROSSED]:
            for keys, base in bases.items():
                if t.base is not None and t.base.keys != keys:
                    own = self.fits.joint(base, t.term)
                    made.append(replace(own, free=t.free, candidate=t.candidate))
        return made

    def otherwise(
        self, tried: Sequence[Tried], screens: Sequence[Screen], null: Fit
    ) -> list[Tried]:
        """The likeliest terms of some pairs of equation and variable in plainer forms that were not
        tried; the likeliest of all with harmonics.
        """
        ranked, made = sorted(tried, key=lambda t: t.cost), list[Tried]()
        pairs: dict[tuple[Point, Regressor], list[Tried]] = {}
        for t in ranked:
            pairs.setdefault((t.term.point, t.term.regressor), []).append(t)
        for first, *others in list(pairs.values())[:PLAINER]:
            if null.evidence - first.cost > WORTH * (null.evidence - ranked[0].cost):
                known = {t.term.law.name for t in others if t.base is first.base}
                made += self.shaping.plainer(first, screens, known)
        return [*made, *(h for t in ranked[:1] for h in self.shaping.harmonics(t))]

    def enough(self, tried: Sequence[Tried]) -> bool:
        """Whether the likeliest term has a form and leaves no more than noise in any view."""
        best = self._likeliest(tried)
        return best is not None and best.free is None and not self.fits.loud(best)

    def _likeliest(self, tried: Sequence[Tried]) -> Tried | None:
        """In the form of fewest parameters that is as likely."""
        best = min(tried, key=lambda t: t.cost, default=None)
        return best and Rivals(self.fits).simplest(best, tried)

    def _worth(self, screen: Screen) -> list[Candidate]:
        return worth_fitting(screen, self.fits.apart, self.fits.rules)

    def _shaped(self, screen: Screen, worth: Sequence[Candidate]) -> list[Candidate]:
        return shaped(screen, worth, self.fits.rules)
