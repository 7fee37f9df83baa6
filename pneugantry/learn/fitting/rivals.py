"""Which terms the records do not tell apart, and which of them comes first."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pneugantry.engine.answer.predict import PredictiveScore
from pneugantry.engine.fitting import noise
from pneugantry.engine.plant import Array
from pneugantry.learn.equations.points import Point
from pneugantry.learn.fitting.joint import TermFits
from pneugantry.learn.learned import Tried
from pneugantry.learn.screening.regressors import TIME, Regressor

__all__ = ["Rivals"]

RIVALS = 4  # pairs that the record that no fit saw judges
FAR = 100.0  # -2 log evidence behind the likeliest one from which on a term is no rival


@dataclass(frozen=True, eq=False)
class Rivals:
    """Tells which terms of one diagnosed plant the records do not tell apart."""

    fits: TermFits

    def answers(self, tried: Sequence[Tried]) -> tuple[Tried, ...]:
        """The likeliest term, and the best one of each other pair of equation and variable that
        neither the fitted records nor the one that no fit saw tell from it. Of these a function
        of time comes last: it is none of the plant, and any state that all records pass at the
        same time looks like one; before it what has been travelled, what another component has
        (last what it does to a sensor), and what turns round with a speed, which says more. What
        is fed to the plant comes first: what follows from it does the same.
        """
        pairs: dict[tuple[Point, Regressor], Tried] = {}
        for t in tried:
            pairs.setdefault((t.term.point, t.term.regressor), self.simplest(t, tried))
        first = list(pairs.values())[:RIVALS]
        near = [t for t in first if t.cost < first[0].cost + self.fits.rules.hopeless]
        rest = [self.fits.placed(self.fits.again(t)) for t in near]
        least = min(t.cost for t in rest)
        rest = [t for t in rest if t.cost < least + FAR]
        told = self.fits.scores(sorted(rest, key=lambda t: t.cost))
        likeliest = min(rest, key=lambda t: t.cost + told[t].cost)
        close = [t for t in rest if t is likeliest or not self.tells(likeliest, t, told)]
        total = {t: t.cost + told[t].cost for t in close}

        roots = self.fits.apart.shape.roots
        inputs = {roots.get(name, name) for name in self.fits.task.plant.inputs}

        def rank(t: Tried) -> tuple[float, ...]:
            own = t.term.regressor
            follows = roots.get(own.plain.label) not in inputs
            turned = bool(own.speed) or bool(own.times)
            beside, fed = len(t.fit.keys), own.fed * (1 + t.term.point.sensor)
            return own.name == TIME, beside, own.travelled, fed, turned, follows, total[t]

        return tuple(sorted(close, key=rank))

    def simplest(self, best: Tried, tried: Sequence[Tried]) -> Tried:
        """The form of fewest parameters of the same variable in the same equation that the fitted
        records do not tell from the best one; a form gives way to none that is far less likely.
        """
        own, far = best.term, FAR if best.free is None else math.inf
        close = [
            t
            for t in tried
            if (t.term.point, t.term.regressor) == (own.point, own.regressor)
            and len(t.term.values) < len(own.values)
            and t.cost < best.cost + far
            and (
                t.cost < best.cost + self.fits.rules.entry
                or not self.tells(best, t, {best: PredictiveScore(), t: PredictiveScore()})
            )
        ]
        return min(close, key=lambda t: (len(t.term.values), t.cost), default=best)

    def tells(self, a: Tried, b: Tried, told: Mapping[Tried, PredictiveScore]) -> bool:
        """Whether the records prefer a term to another by more than their noise; by no more than
        the evidence itself falls.
        """
        fitted = [x - y for x, y in zip(_stretches(b), _stretches(a), strict=True)]
        unseen = [told[b].stretches[c] - own for c, own in told[a].stretches.items()]
        rest = b.cost - a.cost - sum(float(f.sum()) for f in fitted)  # Occam's share
        rest += told[b].price - told[a].price
        falls = np.concatenate([*fitted, *unseen])
        fall = min(noise.doubted(falls, self.fits.rules.doubt), float(falls.sum()))
        return fall + rest > self.fits.rules.entry


def _stretches(tried: Tried) -> list[Array]:
    return [tried.fit.stretches[c] for c in sorted(tried.fit.stretches)]
