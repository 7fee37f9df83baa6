"""Which effects the records need: forward selection by evidence, with a backward step.

What gains most by the score tests of `screening` is fitted near the base, and the best of that with
all views together. Where what that leaves stands out, effects are tested and fitted from the
nominal plant as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.hypotheses.catalogue import Effect
from pneugantry.engine.selection.bases import from_others
from pneugantry.engine.selection.contenders import finalists, tried_beside
from pneugantry.engine.selection.excess import unexplained
from pneugantry.engine.selection.rivals import exchanged, reformed
from pneugantry.engine.selection.screening import Candidate, Memory, screen, starts_of
from pneugantry.engine.selection.trail import Step, Trail
from pneugantry.engine.selection.trials import (
    STARTS,
    explored,
    left_open,
    main_forms,
    other_forms,
    spent,
    spent_in_all,
)

__all__ = ["Search", "resumed", "search"]

LAST = 6.0  # times `Rules.effort` from which on no further effect is looked for (0150, 0167)


@dataclass(frozen=True, eq=False)
class Search:
    """All that was fitted."""

    null: Fit
    best: Fit
    steps: tuple[Step, ...]
    tried: tuple[Fit, ...]
    screened: tuple[Candidate, ...] = field(default=())
    cut: bool = False  # it has spent what it may: not all was tried that it would have


def search(fitter: Fitter, null: Fit, catalogue: Mapping[str, Effect]) -> Search:
    """Effects are added while one brings evidence, and dropped where a later one replaces them;
    in the end each is held against what else may be in its place, and where what is left stands
    out, tried in its other forms.
    """
    trail = Trail(fitter, _offered(fitter, catalogue), [null])
    return _ended(trail, _gathered(trail, null))


def resumed(fitter: Fitter, found: Search, catalogue: Mapping[str, Effect]) -> Search:
    """A search that goes on from where it ended, with effects that bring other equations: no slope
    tells of them, and where all views are quiet they have not been tried. What brings too little
    by itself is still weighed; `found` where none brings any, or all has been spent. What it may
    spend is counted anew, for these equations have to be surveyed: no slope tells where they fit.
    """
    if spent_in_all(fitter) >= LAST:
        return found
    fitter.since = fitter.simulation.evaluations
    offered, best = _offered(fitter, catalogue), found.best
    trail = Trail(fitter, offered, [*found.tried], [*found.steps], [*found.screened])
    known = trail.known
    tried = [
        (hypothesis, [s for s in starts_of(fitter, best, form) if s][:STARTS])
        for effect, form in main_forms(fitter, trail.beside(best.keys), every=True)
        if form.settings and (hypothesis := best.hypothesis.plus(effect, form)).forms not in known
    ]
    fits = explored(fitter, best, tried, None)
    fits += other_forms(fitter, best, fits, known)
    finals = finalists(fitter, best, fits, trail.bar)
    trail.tried += [*fits, *finals]
    top = trail.foremost(finals, best)
    if top is None:
        better = [f for f in (*fits, *finals) if f.evidence < best.evidence]
        return replace(found, tried=(*found.tried, *better)) if better else found
    trail.steps.append(Step(top.keys[-1], best.evidence - top.evidence, top))
    best = trail.polished(top)
    if unexplained(fitter, best):
        best = reformed(trail, best)
    return _ended(trail, _gathered(trail, best, polished=True))


def _offered(fitter: Fitter, catalogue: Mapping[str, Effect]) -> dict[str, Effect]:
    """Effects that some view reads."""
    return {
        k: e for k, e in catalogue.items() if any(fitter.coordinates.readable(f) for f in e.forms)
    }


def _ended(trail: Trail, best: Fit) -> Search:
    """What was gathered, held against what else may be in its place."""
    fitter = trail.fitter
    best = exchanged(trail, best)
    if unexplained(fitter, best):
        best = reformed(trail, best)
    other = from_others(trail, best)
    if other is not best:
        best = _gathered(trail, other, polished=True)
    tried = tuple(f for f in trail.tried if not fitter.negligible(f))
    cut = spent(fitter) >= 1 and bool(unexplained(fitter, best))
    return Search(trail.null, best, tuple(trail.steps), tried, tuple(trail.screened), cut)


def _gathered(trail: Trail, base: Fit, polished: bool = False) -> Fit:
    """Forward, each effect in its main form and the best in their others. polished: the base is at
    its best optimum already.
    """
    fitter = trail.fitter
    # a rig without anything to explain is screened once, about its best optimum
    thorough = polished or not unexplained(fitter, base)
    best = trail.polished(base) if thorough and not polished else base
    near = Memory()
    for _ in range(fitter.rules.rounds):
        forms = main_forms(fitter, trail.beside(best.keys), every=bool(left_open(fitter, best)))
        if best.keys:  # there are too many pairs to prepare each
            fitter.prepare_any(best.hypothesis, trail.offered.values())
        trail.screened = screen(fitter, best, forms, near.about(fitter, best))
        finals = tried_beside(trail, best, trail.screened, forms)
        top = trail.foremost(finals, best)
        if top is not None:
            trail.steps.append(Step(top.keys[-1], best.evidence - top.evidence, top))
        elif thorough:
            break
        before, thorough = best, True  # whose own best optimum may still be elsewhere
        best = trail.polished(top or best)
        if top is not None:
            fitter.since = fitter.simulation.evaluations
        before = fitter.under(before, best.scale)
        if top is not None and unexplained(fitter, best):
            best = reformed(trail, best)
        least = fitter.rules.entry if top is None else trail.bar
        if spent_in_all(fitter) >= LAST:
            break
        if set(best.keys) == set(before.keys) and before.evidence - best.evidence < least:
            best = min(before, best, key=lambda f: f.evidence)
            break  # nothing to be screened that was not; what came was dropped again
    return best
