"""What may be in the place of an answer's effects, or beside them."""

from __future__ import annotations

import math

from pneugantry.engine.fitting.fit import Fit, Race
from pneugantry.engine.hypotheses.hypothesis import Forms, Hypothesis
from pneugantry.engine.selection.excess import unexplained
from pneugantry.engine.selection.screening import screen, usual
from pneugantry.engine.selection.trail import Trail
from pneugantry.engine.selection.trials import (
    added,
    best_of_each,
    explored,
    foremost,
    form_of,
    main_forms,
    predicted,
    told_of,
    unbent_values,
)

__all__ = ["exchanged", "reformed"]

Named = tuple[str, str]  # an effect's key, and the name of its form
MUCH = 0.5  # share of an effect's gain from which on another of its block is tried beside it


def reformed(trail: Trail, best: Fit) -> Fit:
    """With another form of one of its effects, where it does better beside the others, from where
    these have been fitted; asked once of a fit.
    """
    if trail.reformed is best:
        return best
    fitter, tried, trail.reformed = trail.fitter, [], best
    for effect, form in best.hypothesis.effects:
        for other in filter(fitter.coordinates.readable, effect.forms):
            hypothesis = best.hypothesis.without(effect.key).plus(effect, other)
            if other is not form:  # tried before, too: from a worse optimum, that says little
                tried.append((hypothesis, [best.values(None)]))
    fits = explored(fitter, best, tried, best)
    trail.tried += fits
    top = min((best, *fits), key=lambda f: f.evidence)
    return trail.polished(top) if best.evidence - top.evidence > fitter.rules.entry else best


def exchanged(trail: Trail, best: Fit) -> Fit:
    """With another effect in the place of one, or beside it, where that does better."""
    rivals = [*_rivals(trail, best), *_joined(trail, best), *_in_place(trail, best)]
    trail.tried += rivals
    enough = best.evidence - trail.fitter.rules.entry  # for the same again, a little better
    others = [
        f for f in rivals if f.evidence < enough or f.hypothesis.forms != best.hypothesis.forms
    ]
    top = min((best, *others), key=lambda f: f.evidence)
    return best if top is best else trail.replaced(best, top)


def _rivals(trail: Trail, best: Fit) -> list[Fit]:
    """Instead of each effect what may be in its block: where it was fitted beside the effect, from
    there; else if it is predicted to do better, in forms that were not tried beside the others, for
    a form of the right effect may look worse than one of a wrong effect.
    """
    fitter, known = trail.fitter, trail.known
    fits = _replacing(trail, best)
    short = math.inf if unexplained(fitter, best) else fitter.rules.hopeless
    worth = 1.0 if len(best.keys) > 1 else None  # of one effect rivals are bases of other searches
    for effect, form in best.hypothesis.effects:
        rest = best.hypothesis.without(effect.key)
        base = trail.best_of(rest)
        offers = [
            (e, f)
            for e in trail.beside(rest.keys)
            for f in e.forms
            if e.block == effect.block and fitter.coordinates.readable(f)
            if (f is form) or base.hypothesis.plus(e, f).forms not in known
            if not _outdone(trail, best, (effect.key, form.name), (e.key, f.name))
        ]
        screened = screen(fitter, base, offers, {})
        chosen = predicted(fitter, screened, trail.bar, ("gain", "plain"), short=short)
        own = (effect.key, form.name)
        told = [told_of(fitter, base, c) for c in chosen if form_of(c[0]) != own]
        fits += added(fitter, base, told, best, worth)
    return fits


def _outdone(trail: Trail, best: Fit, own: Named, other: Named) -> bool:
    """Whether another effect, or form, was behind an effect of the best beside some of its others,
    hopelessly and by more than the rest of them brought then.
    """
    least: dict[Forms, float] = {}
    for fit in trail.tried:
        forms = fit.hypothesis.forms
        least[forms] = min(fit.evidence, least.get(forms, math.inf))
    others = best.hypothesis.forms - {own}
    for forms, evidence in least.items():
        at = least.get((forms - {other}) | {own}) if other in forms else None
        if at is not None and forms <= others | {other}:
            brought = max(at - best.evidence, 0.0)
            if evidence - at > brought + trail.fitter.rules.hopeless:
                return True
    return False


def _joined(trail: Trail, best: Fit) -> list[Fit]:
    """Beside each effect, in each form that was tried, what alone explains nearly as much in its
    block, from where it did so: one form with more parameters may stand in for both, and no slope
    at its optimum tells that they do better.
    """
    fitter, tried = trail.fitter, []
    for effect, _ in best.hypothesis.effects:
        rest = best.hypothesis.without(effect.key)
        beside = [f for f in trail.tried if f.keys[:-1] == rest.keys and f.keys]
        own = {f.hypothesis.forms: f.hypothesis for f in beside if f.keys[-1] == effect.key}
        before = trail.best_of(rest).evidence
        least = before - MUCH * (before - best.evidence)
        for rival in best_of_each([f for f in beside if f.evidence < least]):
            other, its = rival.hypothesis.effects[-1]
            if other.block == effect.block and other.key not in best.keys:
                tried += [(h.plus(other, its), [rival.values(None)]) for h in own.values()]
    untried = [t for t in tried if t[0].forms not in trail.known]
    fits = explored(fitter, best, untried, best)
    return [f for f in fits if best.evidence - f.evidence > trail.bar]


def _in_place(trail: Trail, best: Fit) -> list[Fit]:
    """Where an answer leaves what stands out, instead of each effect there what else may be in its
    block. Without the effect tolerance bends as far as it may to make up for it, and about such a
    base no slope tells of a rival: rivals start where that is unbent, with no effect and with usual
    ones.
    """
    fitter = trail.fitter
    left, fits = unexplained(fitter, best), list[Fit]()
    for effect, form in best.hypothesis.effects:
        views = fitter.coordinates.readers(form).intersection(left)
        cells = [c for c in fitter.simulation.cells if c[0] in views]
        rest = trail.best_of(best.hypothesis.without(effect.key))
        back = unbent_values(fitter, rest)
        if cells and back is not None:
            rivals = [e for e in trail.beside(best.keys) if e.block == effect.block]
            told = [
                (
                    rest.hypothesis.plus(e, f),
                    [back, *({**back, **s} for s in usual(fitter, rest, f))],
                )
                for e, f in main_forms(fitter, rivals)
            ]
            fits += foremost(fitter, rest, told, cells)
    return fits


def _replacing(trail: Trail, best: Fit) -> list[Fit]:
    """From what was fitted with one effect more: without each other effect of its block. What can
    stand in for another finds its place beside it, and by itself may not. From the best of it also
    without that effect: it may stand in a better optimum only.
    """
    fitter, seen = trail.fitter, set[Forms]()
    tried: list[tuple[Hypothesis, Fit]] = []
    for fit in sorted(trail.tried, key=lambda f: f.evidence):
        effects = fit.hypothesis.effects
        more = [e for e, _ in effects if e.key not in best.keys]
        if len(fit.keys) != len(best.keys) + 1 or len(more) != 1 or fit.hypothesis.forms in seen:
            continue
        if fit.evidence > best.evidence + trail.bar:
            break
        gone = [e.key for e, _ in effects if e.block == more[0].block and e is not more[0]]
        if not seen and fit.evidence < best.evidence - fitter.rules.entry:
            gone.append(more[0].key)
        tried += [(fit.hypothesis.without(k), fit) for k in gone]
        seen.add(fit.hypothesis.forms)
    race = Race(best, 1.0)  # what ends far behind replaces nothing
    return fitter.together(
        lambda t: fitter.explore(*t, race=race), tried, [fewer for fewer, _ in tried]
    )
