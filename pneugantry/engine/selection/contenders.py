"""What contends at a step of the search: the effects of the largest predicted gain, what they leave
untried, and the best of them fitted to the end.
"""

from __future__ import annotations

from collections.abc import Sequence

from pneugantry.engine.fitting.fit import Fit, Race
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.hypotheses.hypothesis import Hypothesis
from pneugantry.engine.selection.excess import unexplained
from pneugantry.engine.selection.scouts import Scouts
from pneugantry.engine.selection.screening import (
    Candidate,
    Offer,
    usual,
)
from pneugantry.engine.selection.trail import Trail
from pneugantry.engine.selection.trials import (
    Trial,
    added,
    best_fit,
    best_of_each,
    contending_with,
    foremost,
    form_of,
    left_open,
    other_forms,
    predicted,
    spent,
    told_of,
    unbent_values,
)

__all__ = ["contending", "distant", "finalists", "tried_beside"]

SIDES = 2  # usual sizes from which an effect is fitted on the nominal plant
SCOUTED = 8  # effects that are tried in single views at once


def tried_beside(
    trail: Trail,
    base: Fit,
    screened: Sequence[Candidate],
    forms: Sequence[Offer],
    ahead: Fit | None = None,
) -> list[Fit]:
    """What contends beside a base, the best of it fitted to the end; all that was fitted for it is
    noted. ahead: as of `contending`.
    """
    fits = trail.named(contending(trail, base, screened, forms, ahead), base)
    finals = finalists(trail.fitter, base, fits, trail.bar)
    trail.tried += [*fits, *finals]
    return finals


def contending(
    trail: Trail,
    base: Fit,
    screened: Sequence[Candidate],
    forms: Sequence[Offer],
    ahead: Fit | None = None,
) -> list[Fit]:
    """What is predicted to gain most, with the best in their other forms. Where what the first
    leaves stands out in some views, what these read comes from the nominal plant on, too, for no
    prediction tells where tolerance has bent to make up for an effect; then, whatever is predicted,
    whatever else they read: an event that a simulation misses (a break-away) shows in no
    prediction, and a fit of that view alone tells which are worth one of all. It comes before other
    forms where nothing predicted gains, for they cost more. ahead: an answer that it has to come
    near, if any.
    """
    fitter, bar = trail.fitter, trail.bar
    foretold = predicted(fitter, screened, bar, ("gain", "plain"))
    rough = added(fitter, base, [told_of(fitter, base, own) for own in foretold], ahead)
    rough += _unbent(fitter, base, rough, rough)
    rough += distant(fitter, base, forms, _open(fitter, base, rough, bar))
    in_vain = all(f.evidence >= base.evidence for f in rough)
    if in_vain:
        rough += _scouted(fitter, base, screened, rough, bar, sized=True)
    reformed = other_forms(fitter, base, rough, ahead=ahead)
    rough += reformed
    if spent(fitter) < 1:
        rough += _unbent(fitter, base, reformed, rough)
    if not in_vain:
        rough += _scouted(fitter, base, screened, rough, bar)
    return rough + other_forms(fitter, base, rough, ahead=ahead)


def distant(fitter: Fitter, base: Fit, forms: Sequence[Offer], left: Sequence[str]) -> list[Fit]:
    """Of what reads views that stay open, what comes farthest from the nominal plant on in the
    record that each meets worst. Where much is missing, tolerance bends far from the truth to make
    up for it, and from there no slope tells what would do so better.
    """
    read = [(e, f) for e, f in forms if not fitter.coordinates.readers(f).isdisjoint(left)]
    told = [
        (base.hypothesis.plus(e, f), [{**base.nominal, **s} for s in usual(fitter, base, f)])
        for e, f in read
    ]
    own = [[c for c in fitter.simulation.cells if c[0] == v] for v in left]
    cells = [fitter.simulation.worst_met(view, base.residuals) for view in own]
    return foremost(fitter, base, told, cells)


def _scouted(
    fitter: Fitter,
    base: Fit,
    screened: Sequence[Candidate],
    rough: Sequence[Fit],
    bar: float,
    sized: bool = False,
) -> list[Fit]:
    """Of what reads a view that stays open, whatever is predicted of it, what gains in that view by
    itself. sized: from usual sizes, too, where nothing predicts one.
    """
    left = _open(fitter, base, rough, bar)
    known = {(e.key, form.name) for f in rough for e, form in f.hypothesis.effects[-1:]}
    rest = [
        c
        for c in screened
        if form_of(c) not in known and not fitter.coordinates.readers(c.form).isdisjoint(left)
    ]
    scouts, worth = Scouts(fitter, base, left), list[Trial]()
    others = predicted(fitter, rest, bar, ("gain", "plain"), every=True)
    for at in range(0, len(others), SCOUTED):
        if spent(fitter) >= 1:
            break
        told = [told_of(fitter, base, own) for own in others[at : at + SCOUTED]]
        if sized:
            told = [(h, s or usual(fitter, base, h.effects[-1][1])[:SIDES]) for h, s in told]
        gains = scouts.gains(told)
        worth += [trial for trial, gain in zip(told, gains, strict=True) if gain > bar]
    return added(fitter, base, worth, best_fit(rough))


def _open(fitter: Fitter, base: Fit, fits: Sequence[Fit], bar: float) -> list[str]:
    """Views in which the best of some fits leaves what stands out. Where that is a step, only those
    that it touches: the others are looked at beside it, for it changes nothing in them.
    """
    best = min((base, *fits), key=lambda f: f.evidence)
    left = left_open(fitter, best)
    if best is base or best.gain(base, fitter.rules) < bar:
        return left
    return [v for v in left if v in fitter.coordinates.readers(best.hypothesis.effects[-1][1])]


def _unbent(fitter: Fitter, base: Fit, fits: Sequence[Fit], beside: Sequence[Fit]) -> list[Fit]:
    """The best effects again, from where what tolerance bears far beyond itself is nominal: it may
    have made up for the effect, and holds a fit from there in a worse optimum. Where the best of
    those beside leaves nothing to explain, only what contends with it.
    """
    tried, foremost = [], best_of_each(fits)[: fitter.rules.finalists]
    for fit in contending_with(fitter, best_fit(beside), foremost):
        back = unbent_values(fitter, fit)
        if back is not None:
            tried.append((fit, back))
    return fitter.together(
        lambda t: fitter.from_afar(t[0].hypothesis, base, [t[1]]),
        tried,
        [fit.hypothesis for fit, _ in tried],
    )


def finalists(fitter: Fitter, base: Fit, fits: Sequence[Fit], bar: float) -> list[Fit]:
    """The best effects, each in its best form, fitted to the end where there are several. Where
    what they leave stands out, or none gains anything, they are surveyed first. Where the best
    leaves nothing to explain, only what contends with it.
    """
    foremost = best_of_each(fits)[: fitter.rules.finalists]
    foremost = contending_with(fitter, best_fit(foremost), foremost)
    least = fitter.rules.hopeful * max((base.evidence - f.evidence for f in foremost), default=0.0)
    hopeful = [f for f in foremost if base.evidence - f.evidence > least]
    surveyed = hopeful or foremost
    if spent(fitter) < 1:
        hypotheses = [h for f in surveyed for h in (f.hypothesis, _in_main_form(fitter, base, f))]
        surveyed = fitter.together(lambda f: _surveyed(fitter, base, f), surveyed, hypotheses)
    chosen = [f for f in surveyed if f.evidence < base.evidence and not _idle(fitter, f)]
    if len(chosen) == 1 and chosen[0].gain(base, fitter.rules) > bar:
        return chosen
    return fitter.together(fitter.again, chosen, [f.hypothesis for f in chosen])


def _idle(fitter: Fitter, fit: Fit) -> bool:
    """Whether the effect that came last is of a size that is none; an older one may be so because
    the last is what it stood in for.
    """
    return fit.keys[-1] in fitter.negligible(fit)


def _in_main_form(fitter: Fitter, base: Fit, fit: Fit) -> Hypothesis:
    """A base with the effect that came last in a fit, in its first form of the same equations."""
    effect, form = fit.hypothesis.effects[-1]
    main = next(
        f for f in effect.forms if f.settings == form.settings and fitter.coordinates.readable(f)
    )
    return base.hypothesis.plus(effect, main)


def _surveyed(fitter: Fitter, base: Fit, fit: Fit) -> Fit:
    """The best of a fit, a thorough one from where it ended, and one of the effect's main form from
    the nominal plant, where what it leaves stands out and it has not been surveyed, for its
    equations are the base's. Tolerance that is bent to make up for an effect holds it where it is.
    """
    if fit.hypothesis.settings != base.hypothesis.settings or not unexplained(fitter, fit):
        return fit
    other = fitter.explore(fit.hypothesis, base, [fit.values(None)], Race(fit, 0.0))
    main = _in_main_form(fitter, base, fit)
    starts = [{**base.nominal, **s} for s in usual(fitter, base, main.effects[-1][1])]
    far = fitter.from_afar(main, base, starts[:SIDES])
    return min(fit, other, far, key=lambda f: f.evidence)
