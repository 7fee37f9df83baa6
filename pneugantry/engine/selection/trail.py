"""What a search has to choose from, and where it has been."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.hypotheses.catalogue import Effect
from pneugantry.engine.hypotheses.hypothesis import Forms, Hypothesis
from pneugantry.engine.selection.screening import Candidate
from pneugantry.engine.selection.trials import best_of_each, without

__all__ = ["Step", "Trail"]

SAME = 0.1  # share of what an effect takes from all stretches, by which one that does the same may
# differ (0163)


@dataclass(frozen=True)
class Step:
    """One step of the search."""

    effect: str
    gain: float  # of -2 log evidence
    fit: Fit
    dropped: bool = False


@dataclass(eq=False)
class Trail:
    """What a search has to choose from, and where it has been."""

    fitter: Fitter
    offered: Mapping[str, Effect]
    tried: list[Fit]
    steps: list[Step] = field(default_factory=list)
    screened: list[Candidate] = field(default_factory=list)
    reformed: Fit | None = None  # whose effects were tried in their other forms last

    @property
    def bar(self) -> float:
        """Fall of -2 log evidence that an effect must bring."""
        return self.fitter.rules.effect + 2 * math.log(max(len(self.offered), 1))

    @property
    def known(self) -> set[Forms]:
        """Which effects were tried together, in which forms."""
        return {f.hypothesis.forms for f in self.tried}

    def beside(self, keys: Collection[str]) -> list[Effect]:
        return [e for k, e in self.offered.items() if k not in keys]

    def best_of(self, hypothesis: Hypothesis) -> Fit:
        """Of what was fitted of a hypothesis."""
        fits = (f for f in self.tried if f.hypothesis.forms == hypothesis.forms)
        return min(fits, key=lambda f: f.evidence)

    def named(self, fits: Sequence[Fit], base: Fit) -> list[Fit]:
        """Fits of one effect more than a base, without general effects that do the same as one of
        the catalogue, which says more: they are no longer offered.
        """
        last = [(f, f.hypothesis.effects[-1][0]) for f in best_of_each(fits)]
        own = [f for f, effect in last if not (effect.general or effect.outside)]
        general = [f for f, effect in last if effect.general]
        idle = {g.keys[-1] for g in general if any(_alike(g, f, base) for f in own)}
        self.offered = {k: e for k, e in self.offered.items() if k not in idle}
        return [f for f in fits if f.keys[-1] not in idle]

    @property
    def null(self) -> Fit:
        """The best one without effects."""
        return min((f for f in self.tried if not f.keys), key=lambda f: f.evidence)

    def replaced(self, best: Fit, top: Fit) -> Fit:
        """A better one in the place of the best, at its best optimum; its effects are noted."""
        if set(top.keys) != set(best.keys):
            self.steps.append(Step(top.keys[-1], best.evidence - top.evidence, top))
            self.steps += [Step(k, 0.0, top, dropped=True) for k in best.keys if k not in top.keys]
        return self.polished(top)

    def foremost(self, fits: Sequence[Fit], base: Fit) -> Fit | None:
        """The one that gains most over a base; None where that is too little for an effect."""
        gains = [f.gain(base, self.fitter.rules) for f in fits]
        most = max(gains, default=-math.inf)
        return fits[gains.index(most)] if most >= self.bar else None

    def polished(self, fit: Fit) -> Fit:
        """At its best optimum, without what it no longer needs; under the tolerance that the rig
        shows then, and all else with it: what an effect explains had been tolerance's.
        """
        best = _pruned(self, self.fitter.again(fit, thorough=True))
        scale = self.fitter.tolerance_of(best)
        self.tried = [self.fitter.under(f, scale) for f in (*self.tried, best)]
        best = self.fitter.rescaled(best, scale)
        self.tried.append(best)
        return best


def _alike(one: Fit, other: Fit, base: Fit) -> bool:
    """Whether two effects beside a base take the same from every stretch."""
    falls, apart = (
        np.concatenate([np.zeros(0), *(f.stretches[c] - one.stretches[c] for c in one.stretches)])
        for f in (base, other)
    )
    return bool(np.linalg.norm(apart) < SAME * np.linalg.norm(falls))


def _pruned(trail: Trail, fit: Fit) -> Fit:
    """Without effects whose removal costs less evidence than an effect must bring: of what was
    fitted to a worse optimum, or what a later effect replaces. Nor one of a size that is none.
    """
    fitter = trail.fitter
    while fit.keys:
        trail.tried.append(fit)
        drops = without(fitter, fit, fit.keys)
        trail.tried += drops
        idle = fitter.negligible(fit)
        least = min((d for d in drops if not set(d.keys) & set(idle[:1])), key=lambda f: f.evidence)
        if not idle and least.evidence - fit.evidence > trail.bar:
            return fit
        gone = next(k for k in fit.keys if k not in least.keys)
        trail.steps.append(Step(gone, fit.evidence - least.evidence, least, dropped=True))
        fit = fitter.again(least, thorough=True)
    return fit
