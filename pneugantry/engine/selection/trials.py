"""Effects tried beside a base: which forms, from which starts, in which order."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from pneugantry.engine.fitting.fit import Fit, Race
from pneugantry.engine.fitting.fitter import FRESH, Fitter
from pneugantry.engine.hypotheses.catalogue import Effect
from pneugantry.engine.hypotheses.hypothesis import Forms, Hypothesis
from pneugantry.engine.selection.excess import unexplained
from pneugantry.engine.selection.screening import Candidate, Offer, starts_of
from pneugantry.engine.views.simulation import Cell

__all__ = [
    "STARTS",
    "Trial",
    "added",
    "best_fit",
    "best_of_each",
    "contending_with",
    "explored",
    "foremost",
    "form_of",
    "left_open",
    "main_forms",
    "other_forms",
    "predicted",
    "spent",
    "spent_in_all",
    "told_of",
    "unbent_values",
    "without",
]

NEARLY = 0.1  # share of the largest gain from which on an effect's other forms are tried
STARTS = 2  # from which a form is fitted, beside the base
Trial = tuple[Hypothesis, Sequence[Mapping[str, float]]]  # a hypothesis, and where it starts


def spent(fitter: Fitter) -> float:
    """Of what a search may spend on one more effect, a share."""
    return (fitter.simulation.evaluations - fitter.since) / fitter.rules.effort


def spent_in_all(fitter: Fitter) -> float:
    """The same of all effects."""
    return fitter.simulation.evaluations / fitter.rules.effort


def left_open(fitter: Fitter, fit: Fit) -> list[str]:
    """Views in which a fit leaves what stands out, as long as more may be spent on them: where
    nothing explains a view, everything would be tried in it, and again beside each effect.
    """
    return [] if spent(fitter) >= 1 else unexplained(fitter, fit)


def main_forms(fitter: Fitter, effects: Sequence[Effect], every: bool = False) -> list[Offer]:
    """Of each effect the first form that a view reads; every: of each set of equations, for none
    tells how another does.
    """
    made: dict[tuple[str, object], Offer] = {}
    for e in effects:
        for f in filter(fitter.coordinates.readable, e.forms):
            made.setdefault((e.key, frozenset(f.settings.items()) if every else None), (e, f))
    return list(made.values())


def unbent_values(fitter: Fitter, fit: Fit) -> dict[str, float] | None:
    """Of a fit, what tolerance bears far beyond itself nominal; None where it bears nothing so."""
    far = [c.parameter for c in fit.point.coordinates if c.name in fitter.far_off(fit)]
    return {**fit.values(None), **{p: fitter.coordinates.neutral(p) for p in far}} if far else None


def best_fit(fits: Sequence[Fit]) -> Fit | None:
    """The one of the most evidence; None of none."""
    return min(fits, key=lambda f: f.evidence, default=None)


def best_of_each(fits: Sequence[Fit]) -> list[Fit]:
    """Of each effect that came last its best fit, the best of all first."""
    best: dict[str, Fit] = {}
    for fit in sorted(fits, key=lambda f: f.evidence):
        best.setdefault(fit.keys[-1], fit)
    return list(best.values())


def contending_with(fitter: Fitter, best: Fit | None, fits: Sequence[Fit]) -> list[Fit]:
    """Those of some fits that may still be in the place of the best: all where that leaves what
    stands out, else those that are not hopelessly behind it.
    """
    if best is None or unexplained(fitter, best):
        return list(fits)
    least = best.evidence + fitter.rules.hopeless
    return [f for f in fits if f.evidence < least]


def without(fitter: Fitter, fit: Fit, keys: Sequence[str]) -> list[Fit]:
    """A fit without each of some effects."""
    fewer = [fit.hypothesis.without(k) for k in keys]
    return fitter.together(lambda h: fitter.explore(h, fit), fewer, fewer)


def added(
    fitter: Fitter,
    base: Fit,
    tried: Sequence[Trial],
    ahead: Fit | None,
    worth: float | None = None,
) -> list[Fit]:
    """Effects beside a base; those that keep its equations first, for they tell how much the others
    are to gain, then the others one by one: what explains all leaves little to try of the next.
    worth: as of `explored`.
    """
    settings = base.hypothesis.settings
    keep = [t for t in tried if t[0].settings == settings]
    others = [[t] for t in tried if t[0].settings != settings]
    made: list[Fit] = []
    for own in (keep, *others):
        front = best_fit([*made, *([ahead] if ahead else [])])
        made += explored(fitter, base, own, front, worth)
    return made


def explored(
    fitter: Fitter,
    base: Fit,
    tried: Sequence[Trial],
    ahead: Fit | None,
    worth: float | None = None,
) -> list[Fit]:
    """Hypotheses near a base, each from some starts, side by side. Where the best so far leaves
    nothing to explain, none can gain much more, and other equations are surveyed only where they
    contend with it. ahead: the best beside the base, if any; worth: share of its gain that a fit
    must have in sight (None: `Rules.hopeful`; all of it where it leaves nothing).
    """
    if not tried:
        return []
    best = min((f for f in (base, ahead) if f is not None), key=lambda f: f.evidence)
    fresh = FRESH if left_open(fitter, best) else 1
    race = None
    if ahead is not None:
        if worth is None:
            worth = fitter.rules.hopeful if unexplained(fitter, ahead) else 1.0
        race = Race(ahead, worth)

    def one(each: Trial) -> Fit:
        return fitter.explore(each[0], base, each[1], race, thorough=False, fresh=fresh)

    return fitter.together(one, tried, [h for h, _ in tried])


def foremost(fitter: Fitter, base: Fit, told: Sequence[Trial], cells: Sequence[Cell]) -> list[Fit]:
    """Of some hypotheses fits of those that come farthest below a base in some cells."""
    if not told:
        return []
    every = [h for h, _ in told]
    leads = fitter.together(lambda t: fitter.lead(t[0], base, t[1], cells), told, every)
    least = max([0.0, *(lead.gain for lead in leads)]) - fitter.rules.hopeless
    ranked = sorted(zip(leads, every, strict=True), key=lambda each: -each[0].gain)
    few = [each for each in ranked[: fitter.rules.finalists] if each[0].gain > least]
    return fitter.together(
        lambda t: fitter.from_afar(t[1], base, [t[0].values]), few, [h for _, h in few]
    )


def told_of(fitter: Fitter, base: Fit, own: Sequence[Candidate]) -> Trial:
    """A base with the effect of some candidates, and where it starts beside the base."""
    effect, form = own[0].effect, own[0].form
    candidates = [c.starts for c in own]
    listed = [*candidates, *(s for s in starts_of(fitter, base, form) if s not in candidates)]
    return base.hypothesis.plus(effect, form), [s for s in listed if s][:STARTS]


def other_forms(
    fitter: Fitter,
    base: Fit,
    fits: Sequence[Fit],
    tried: Collection[Forms] = (),
    ahead: Fit | None = None,
) -> list[Fit]:
    """The best effects in their other forms, but for what has been tried; where none gains anything
    and what is left stands out, the best of those, too. One that leaves nothing ends no race here:
    another form of it may still do better by hundreds. ahead: an answer that does, if any.
    """
    known = {f.hypothesis.forms for f in fits}.union(tried)
    best = best_of_each(fits)
    least = NEARLY * max((base.evidence - f.evidence for f in fits), default=0.0)
    near = [f for f in best if base.evidence - f.evidence > max(least, 0.0)]
    if not near and left_open(fitter, base):
        near = best
    told = []
    for fit in near[: fitter.rules.reformed]:
        effect, _ = fit.hypothesis.effects[-1]
        for form in effect.forms:
            hypothesis = base.hypothesis.plus(effect, form)
            if hypothesis.forms in known or not fitter.coordinates.readable(form):
                continue
            starts = [fit.values(None), *(s for s in starts_of(fitter, base, form) if s)]
            told.append((hypothesis, starts))
    if ahead is not None:
        return explored(fitter, base, told, ahead)
    return explored(fitter, base, told, best_fit(fits), fitter.rules.hopeful)


def predicted(
    fitter: Fitter,
    screened: Sequence[Candidate],
    bar: float,
    measures: Sequence[str],
    every: bool = False,
    short: float = math.inf,
) -> list[list[Candidate]]:
    """The effects of the largest predicted gain, by any measure, each with its best starts: the
    measures may differ in them. every: all of them, however little is predicted. short: of the
    largest, what an effect may be predicted to gain less.
    """
    chosen: dict[tuple[str, str], list[Candidate]] = {}
    for measure in measures:
        ranked = sorted(screened, key=lambda c: -getattr(c, measure))
        most = getattr(ranked[0], measure) if ranked else 0.0
        least = max(bar, fitter.rules.hopeful * most, most - short)
        least = -math.inf if every else least
        few = len(ranked) if every else fitter.rules.screened
        best = {form_of(c): c for c in reversed(ranked) if getattr(c, measure) > least}
        for c in sorted(best.values(), key=lambda c: -getattr(c, measure))[:few]:
            own = chosen.setdefault(form_of(c), [])
            if c not in own:
                own.append(c)
    return list(chosen.values())


def form_of(c: Candidate) -> tuple[str, str]:
    """Its effect and the name of its form."""
    return c.effect.key, c.form.name
