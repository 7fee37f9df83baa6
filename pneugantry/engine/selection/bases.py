"""What other effects lead to than those that explain most by themselves.

A search goes on from the best effect. One that stands in for two may leave nothing to add, by what
it bends, or find its place beside another: the two show from either of them alone.
"""

from __future__ import annotations

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.selection.contenders import tried_beside
from pneugantry.engine.selection.screening import screen
from pneugantry.engine.selection.trail import Trail
from pneugantry.engine.selection.trials import best_fit, best_of_each, main_forms, spent

__all__ = ["from_others"]

MUCH = 0.5  # share of what the best of as many effects gains, from which on others lead further
BASES = 2  # tried, at most


def from_others(trail: Trail, best: Fit) -> Fit:
    """The best of an answer and of what its rivals of one effect less lead to. An answer of one
    effect has such only where it bends tolerance far: nothing else is left for a second one.
    """
    fitter = trail.fitter
    if not best.keys or (len(best.keys) == 1 and not fitter.bent(best)):
        return best
    found: list[Fit] = []
    for base in _bases(trail, best):
        if spent(fitter) >= 1:
            break
        forms = main_forms(fitter, trail.beside(base.keys))
        fitter.prepare_any(base.hypothesis, trail.offered.values())
        screened = screen(fitter, base, forms, {})
        found += tried_beside(trail, base, screened, forms, best)
    top = best_fit([best, *found]) or best
    better = best.evidence - top.evidence > fitter.rules.entry
    return trail.replaced(best, top) if better else best


def _bases(trail: Trail, best: Fit) -> list[Fit]:
    """What gains nearly as much as the best of as many effects, with some that the answer lacks."""
    size = max(len(best.keys) - 1, 1)
    null = trail.null.evidence
    of_size = [f for f in trail.tried if len(f.keys) == size]
    least = null - MUCH * max((null - f.evidence for f in of_size), default=0.0)
    each = [f for f in best_of_each(of_size) if not set(f.keys) <= set(best.keys)]
    return [f for f in each if f.evidence < min(least, null - trail.bar)][:BASES]
