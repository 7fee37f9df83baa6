"""Effects of the catalogue as part of a curve that has no form: one is often Coulomb friction and a
drag that nobody knows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.hypotheses.hypothesis import Hypothesis
from pneugantry.engine.run import Found
from pneugantry.learn.fitting.joint import TermFits
from pneugantry.learn.fitting.shaping import Shaping
from pneugantry.learn.learned import Tried
from pneugantry.learn.terms.composite import composites
from pneugantry.learn.terms.term import Term

__all__ = ["Partly"]

SINGLES = 24  # effects of the catalogue that are tried as part of a curve
COMPOSITES = 5  # known effects with a form beside them that are fitted
BESIDE = 2  # known effects beside which a term is looked for once more


@dataclass(frozen=True, eq=False)
class Partly:
    """Fits known effects with a form beside them."""

    found: Found
    fits: TermFits

    def composites(self, tried: Sequence[Tried]) -> tuple[list[Tried], list[Fit]]:
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
        shaping = Shaping(self.fits)
        for c in likely[:COMPOSITES]:
            term = shaping.term(best.candidate, c.form)
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
        fitter = Fitter(task.plant, task.views, task.data.fitted, self.fits.rules)
        try:
            for key, effect in task.catalogue.items():
                hypothesis = Hypothesis().plus(effect, effect.forms[0])
                seen = reached & {c[0] for c in fitter.coordinates.touched(hypothesis)}
                if seen and (key,) not in found and len(found) < SINGLES:
                    found[key,] = fitter.explore(hypothesis, null)
        finally:
            fitter.close()
        return sorted(found.values(), key=lambda f: f.evidence)
