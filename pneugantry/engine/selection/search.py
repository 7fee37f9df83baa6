"""Which effects the records need: forward selection by evidence, with a backward step.

What gains most by the score tests of `screening` is fitted near the base, and the best of that with
all views together. Where what that leaves stands out, effects are tested and fitted from the
nominal plant as well.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import FRESH, Fitter
from pneugantry.engine.hypotheses.catalogue import Effect
from pneugantry.engine.hypotheses.hypothesis import Hypothesis
from pneugantry.engine.selection.excess import unexplained
from pneugantry.engine.selection.scouts import Scouts
from pneugantry.engine.selection.screening import (
    Candidate,
    Memory,
    Offer,
    afresh,
    nominal_values,
    screen,
    starts_of,
    usual,
)
from pneugantry.engine.views.simulation import Cell

__all__ = ["Search", "Step", "resumed", "search"]

MUCH = 0.5  # share of an effect's gain from which on another of its block is tried beside it
NEARLY = 0.1  # share of the largest gain from which on an effect's other forms are tried
STARTS = 2  # from which a form is fitted, beside the base
SIDES = 2  # usual sizes from which an effect is fitted on the nominal plant
SCOUTED = 8  # effects that are tried in single views at once
LAST = 4.0  # times `Rules.effort` from which on no further effect is looked for (0150)
Forms = frozenset[tuple[str, str]]  # of a hypothesis
Told = tuple[Hypothesis, Sequence[Mapping[str, float]]]  # a hypothesis, and where it starts


@dataclass(frozen=True)
class Step:
    """One step of the search."""

    effect: str
    gain: float  # of -2 log evidence
    fit: Fit
    dropped: bool = False


@dataclass(frozen=True, eq=False)
class Search:
    """All that was fitted."""

    null: Fit
    best: Fit
    steps: tuple[Step, ...]
    tried: tuple[Fit, ...]
    screened: tuple[Candidate, ...] = field(default=())
    cut: bool = False  # it has spent what it may: not all was tried that it would have


@dataclass(eq=False)
class _Trail:
    """What a search has to choose from, and where it has been."""

    fitter: Fitter
    offered: Mapping[str, Effect]
    tried: list[Fit]
    steps: list[Step] = field(default_factory=list)
    screened: list[Candidate] = field(default_factory=list)

    @property
    def bar(self) -> float:
        """Fall of -2 log evidence that an effect must bring."""
        return self.fitter.rules.effect + 2 * math.log(max(len(self.offered), 1))

    @property
    def known(self) -> set[frozenset[tuple[str, str]]]:
        """Which effects were tried together, in which forms."""
        return {f.hypothesis.forms for f in self.tried}

    def beside(self, keys: Collection[str]) -> list[Effect]:
        return [e for k, e in self.offered.items() if k not in keys]

    def best_of(self, hypothesis: Hypothesis) -> Fit:
        """Of what was fitted of a hypothesis."""
        fits = (f for f in self.tried if f.hypothesis.forms == hypothesis.forms)
        return min(fits, key=lambda f: f.evidence)

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


def search(fitter: Fitter, null: Fit, catalogue: Mapping[str, Effect]) -> Search:
    """Effects are added while one brings evidence, and dropped where a later one replaces them;
    in the end each is held against what else may be in its place, and where what is left stands
    out, tried in its other forms.
    """
    trail = _Trail(fitter, _offered(fitter, catalogue), [null])
    return _ended(trail, _gathered(trail, null))


def resumed(fitter: Fitter, found: Search, catalogue: Mapping[str, Effect]) -> Search:
    """A search that goes on from where it ended, with effects that bring other equations: no slope
    tells of them, and where all views are quiet they have not been tried. What brings too little
    by itself is still weighed; `found` where none brings any, or all has been spent.
    """
    if _spent(fitter) >= LAST:
        return found
    offered, best = _offered(fitter, catalogue), found.best
    trail = _Trail(fitter, offered, [*found.tried], [*found.steps], [*found.screened])
    known = trail.known
    tried = [
        (hypothesis, [s for s in starts_of(fitter, best, form) if s][:STARTS])
        for effect, form in _main_forms(fitter, trail.beside(best.keys), every=True)
        if form.settings and (hypothesis := best.hypothesis.plus(effect, form)).forms not in known
    ]
    fits = _explored(fitter, best, tried, None)
    fits += _other_forms(fitter, best, fits, known)
    finals = _finals(fitter, best, fits, trail.bar)
    trail.tried += [*fits, *finals]
    top = trail.foremost(finals, best)
    if top is None:
        better = [f for f in (*fits, *finals) if f.evidence < best.evidence]
        return replace(found, tried=(*found.tried, *better)) if better else found
    trail.steps.append(Step(top.keys[-1], best.evidence - top.evidence, top))
    best = trail.polished(top)
    if unexplained(fitter, best):
        best = _reformed(trail, best, best.hypothesis.effects)
    return _ended(trail, _gathered(trail, best, polished=True))


def _offered(fitter: Fitter, catalogue: Mapping[str, Effect]) -> dict[str, Effect]:
    """Effects that some view reads."""
    return {k: e for k, e in catalogue.items() if any(fitter.readable(f) for f in e.forms)}


def _ended(trail: _Trail, best: Fit) -> Search:
    """What was gathered, held against what else may be in its place."""
    fitter = trail.fitter
    best = _exchanged(trail, best)
    if unexplained(fitter, best):
        best = _reformed(trail, best, best.hypothesis.effects)
    null = min((f for f in trail.tried if not f.keys), key=lambda f: f.evidence)
    tried = tuple(f for f in trail.tried if not f.negligible(fitter.rules))
    cut = _spent(fitter) >= 1 and bool(unexplained(fitter, best))
    return Search(null, best, tuple(trail.steps), tried, tuple(trail.screened), cut)


def _spent(fitter: Fitter) -> float:
    """Of what a search may spend, a share."""
    return fitter.simulation.evaluations / fitter.rules.effort


def _unexplained(fitter: Fitter, fit: Fit) -> list[str]:
    """Views in which a fit leaves what stands out, as long as more may be spent on them: where
    nothing explains a view, everything would be tried in it, and again beside each effect.
    """
    return [] if _spent(fitter) >= 1 else unexplained(fitter, fit)


def _gathered(trail: _Trail, base: Fit, polished: bool = False) -> Fit:
    """Forward, each effect in its main form and the best in their others. polished: the base is at
    its best optimum already.
    """
    fitter = trail.fitter
    # a rig without anything to explain is screened once, about its best optimum
    thorough = polished or not unexplained(fitter, base)
    best = trail.polished(base) if thorough and not polished else base
    near, far = Memory(), Memory()
    for _ in range(fitter.rules.rounds):
        forms = _main_forms(fitter, trail.beside(best.keys), every=bool(_unexplained(fitter, best)))
        if best.keys:  # there are too many pairs to prepare each
            fitter.prepare_any(best.hypothesis, trail.offered.values())
        trail.screened = screen(fitter, best, forms, near.about(fitter, best))
        fits = _fits(fitter, best, trail.screened, trail.bar, forms, far)
        finals = _finals(fitter, best, fits, trail.bar)
        trail.tried += [*fits, *finals]
        top = trail.foremost(finals, best)
        if top is not None:
            trail.steps.append(Step(top.keys[-1], best.evidence - top.evidence, top))
        elif thorough:
            break
        before, thorough = best, True  # whose own best optimum may still be elsewhere
        best = trail.polished(top or best)
        before = fitter.under(before, best.scale)
        if top is not None and unexplained(fitter, best):
            best = _reformed(trail, best, best.hypothesis.effects)
        least = fitter.rules.entry if top is None else trail.bar
        if _spent(fitter) >= LAST:
            break
        if set(best.keys) == set(before.keys) and before.evidence - best.evidence < least:
            best = min(before, best, key=lambda f: f.evidence)
            break  # nothing to be screened that was not; what came was dropped again
    return best


def _reformed(trail: _Trail, best: Fit, effects: Sequence[Offer]) -> Fit:
    """With another form of one of some effects, where it does better beside the others, from where
    these have been fitted.
    """
    fitter, tried = trail.fitter, []
    for effect, form in effects:
        for other in filter(fitter.readable, effect.forms):
            hypothesis = best.hypothesis.without(effect.key).plus(effect, other)
            if other is not form:  # tried before, too: from a worse optimum, that says little
                tried.append((hypothesis, [best.values(None)]))
    fits = _explored(fitter, best, tried, None)
    trail.tried += fits
    top = min((best, *fits), key=lambda f: f.evidence)
    return trail.polished(top) if best.evidence - top.evidence > fitter.rules.entry else best


def _exchanged(trail: _Trail, best: Fit) -> Fit:
    """With another effect in the place of one, or beside it, where that does better."""
    rivals = [*_rivals(trail, best), *_joined(trail, best), *_in_place(trail, best)]
    trail.tried += rivals
    top = min((best, *rivals), key=lambda f: f.evidence)
    if top is best:
        return best
    if set(top.keys) != set(best.keys):
        trail.steps.append(Step(top.keys[-1], best.evidence - top.evidence, top))
        trail.steps += [Step(k, 0.0, top, dropped=True) for k in best.keys if k not in top.keys]
    return trail.polished(top)


def _main_forms(fitter: Fitter, effects: Sequence[Effect], every: bool = False) -> list[Offer]:
    """Of each effect the first form that a view reads; every: of each set of equations, for none
    tells how another does.
    """
    made: dict[tuple[str, object], Offer] = {}
    for e in effects:
        for f in filter(fitter.readable, e.forms):
            made.setdefault((e.key, frozenset(f.settings.items()) if every else None), (e, f))
    return list(made.values())


def _rivals(trail: _Trail, best: Fit) -> list[Fit]:
    """Instead of each effect what may be in its block: where it was fitted beside the effect, from
    there; else if it is predicted to do better, in forms that were not tried beside the others, for
    a form of the right effect may look worse than one of a wrong effect.
    """
    fitter, known = trail.fitter, trail.known
    fits = _replacing(trail, best)
    for effect, form in best.hypothesis.effects:
        rest = best.hypothesis.without(effect.key)
        base = trail.best_of(rest)
        offers = [
            (e, f)
            for e in trail.beside(rest.keys)
            for f in e.forms
            if e.block == effect.block and fitter.readable(f)
            if (f is form) or base.hypothesis.plus(e, f).forms not in known
        ]
        screened = screen(fitter, base, offers, {})
        chosen = _chosen(fitter, screened, trail.bar, ("gain", "plain"))
        own = (effect.key, form.name)
        fits += _added(fitter, base, [c for c in chosen if _form_of(c[0]) != own], best)
    return fits


def _joined(trail: _Trail, best: Fit) -> list[Fit]:
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
        for rival in _best_of_each([f for f in beside if f.evidence < least]):
            other, its = rival.hypothesis.effects[-1]
            if other.block == effect.block and other.key not in best.keys:
                tried += [(h.plus(other, its), [rival.values(None)]) for h in own.values()]
    fits = _explored(fitter, best, [t for t in tried if t[0].forms not in trail.known], None)
    return [f for f in fits if best.evidence - f.evidence > trail.bar]


def _in_place(trail: _Trail, best: Fit) -> list[Fit]:
    """Where an answer leaves what stands out, instead of each effect there what else may be in its
    block. Without the effect tolerance bends as far as it may to make up for it, and about such a
    base no slope tells of a rival: rivals start where that is unbent, with no effect and with usual
    ones.
    """
    fitter = trail.fitter
    left, fits = unexplained(fitter, best), list[Fit]()
    for effect, form in best.hypothesis.effects:
        views = fitter.readers(form).intersection(left)
        cells = [c for c in fitter.simulation.cells if c[0] in views]
        rest = trail.best_of(best.hypothesis.without(effect.key))
        back = _unbent_values(fitter, rest)
        if cells and back is not None:
            rivals = [e for e in trail.beside(best.keys) if e.block == effect.block]
            told = [
                (
                    rest.hypothesis.plus(e, f),
                    [back, *({**back, **s} for s in usual(fitter, rest, f))],
                )
                for e, f in _main_forms(fitter, rivals)
            ]
            fits += _foremost(fitter, rest, told, cells)
    return fits


def _foremost(fitter: Fitter, base: Fit, told: Sequence[Told], cells: Sequence[Cell]) -> list[Fit]:
    """Of some hypotheses fits of those that come farthest below a base in some cells."""
    every = [h for h, _ in told]
    leads = fitter.together(lambda t: fitter.ahead(t[0], base, t[1], cells), told, every)
    least = max([0.0, *(lead.gain for lead in leads)]) - fitter.rules.hopeless
    ranked = sorted(zip(leads, every, strict=True), key=lambda each: -each[0].gain)
    few = [each for each in ranked[: fitter.rules.finalists] if each[0].gain > least]
    return fitter.together(
        lambda t: fitter.from_afar(t[1], base, [t[0].values]), few, [h for _, h in few]
    )


def _replacing(trail: _Trail, best: Fit) -> list[Fit]:
    """From what was fitted with one effect more: without each other effect of its block. What can
    stand in for another finds its place beside it, and by itself may not. From the best of it also
    without that effect: it may stand in a better optimum only.
    """
    fits: list[Fit] = []
    seen: set[frozenset[tuple[str, str]]] = set()
    for fit in sorted(trail.tried, key=lambda f: f.evidence):
        effects = fit.hypothesis.effects
        more = [e for e, _ in effects if e.key not in best.keys]
        if len(fit.keys) != len(best.keys) + 1 or len(more) != 1 or fit.hypothesis.forms in seen:
            continue
        if fit.evidence > best.evidence + trail.bar:
            break
        gone = [e.key for e, _ in effects if e.block == more[0].block and e is not more[0]]
        if not seen and fit.evidence < best.evidence - trail.fitter.rules.entry:
            gone.append(more[0].key)
        fits += _without(trail.fitter, fit, gone)
        seen.add(fit.hypothesis.forms)
    return fits


def _fits(
    fitter: Fitter,
    base: Fit,
    screened: Sequence[Candidate],
    bar: float,
    forms: Sequence[Offer],
    far: Memory,
) -> list[Fit]:
    """What is predicted to gain most, with the best in their other forms. Where what all that
    leaves stands out in some views, whatever else these read: an event that a simulation misses (a
    break-away) shows in no prediction, and a fit of that view alone tells which are worth one of
    all. Where that does, too, also what is predicted from the nominal plant on, of which `far` is.
    """
    rough = _added(fitter, base, _chosen(fitter, screened, bar, ("gain", "plain")), None)
    rough += _unbent(fitter, base, rough)
    reformed = _other_forms(fitter, base, rough)
    rough += reformed
    if _spent(fitter) < 1:
        rough += _unbent(fitter, base, reformed)
    rough += _scouted(fitter, base, screened, rough, bar)
    if _open(fitter, base, rough, bar):
        distant = _chosen(fitter, afresh(fitter, base, forms, far), bar, ("afresh",))
        told = [
            (base.hypothesis.plus(own[0].effect, own[0].form), [c.starts for c in own])
            for own in distant
        ]
        rough += fitter.together(
            lambda t: fitter.from_afar(t[0], base, t[1]), told, [h for h, _ in told]
        )
    return rough + _other_forms(fitter, base, rough)


def _scouted(
    fitter: Fitter, base: Fit, screened: Sequence[Candidate], rough: Sequence[Fit], bar: float
) -> list[Fit]:
    """Of what reads a view that stays open, whatever is predicted of it, what gains in that view by
    itself.
    """
    left = _open(fitter, base, rough, bar)
    known = {(e.key, form.name) for f in rough for e, form in f.hypothesis.effects[-1:]}
    rest = [
        c
        for c in screened
        if _form_of(c) not in known and not fitter.readers(c.form).isdisjoint(left)
    ]
    scouts, worth = Scouts(fitter, base, left), []
    others = _chosen(fitter, rest, bar, ("gain", "plain"), every=True)
    for at in range(0, len(others), SCOUTED):
        if _spent(fitter) >= 1:
            break
        few = others[at : at + SCOUTED]
        gains = scouts.gains([_from(fitter, base, own) for own in few])
        worth += [own for own, gain in zip(few, gains, strict=True) if gain > bar]
    return _added(fitter, base, worth, _ahead(rough))


def _open(fitter: Fitter, base: Fit, fits: Sequence[Fit], bar: float) -> list[str]:
    """Views in which the best of some fits leaves what stands out. Where that is a step, only those
    that it touches: the others are looked at beside it, for it changes nothing in them.
    """
    best = min((base, *fits), key=lambda f: f.evidence)
    left = _unexplained(fitter, best)
    if best is base or best.gain(base, fitter.rules) < bar:
        return left
    return [v for v in left if v in fitter.readers(best.hypothesis.effects[-1][1])]


def _unbent(fitter: Fitter, base: Fit, fits: Sequence[Fit]) -> list[Fit]:
    """The best effects again, from where what tolerance bears far beyond itself is nominal: it may
    have made up for the effect, and holds a fit from there in a worse optimum.
    """
    tried = []
    for fit in _best_of_each(fits)[: fitter.rules.finalists]:
        back = _unbent_values(fitter, fit)
        if back is not None:
            tried.append((fit, back))
    return fitter.together(
        lambda t: fitter.from_afar(t[0].hypothesis, base, [t[1]]),
        tried,
        [fit.hypothesis for fit, _ in tried],
    )


def _unbent_values(fitter: Fitter, fit: Fit) -> dict[str, float] | None:
    """Of a fit, what tolerance bears far beyond itself nominal; None where it bears nothing so."""
    far = [c.parameter for c in fit.point.coordinates if c.name in fitter.far_off(fit)]
    return {**fit.values(None), **{p: fitter.neutral(p) for p in far}} if far else None


def _ahead(fits: Sequence[Fit]) -> Fit | None:
    return min(fits, key=lambda f: f.evidence, default=None)


def _best_of_each(fits: Sequence[Fit]) -> list[Fit]:
    """Of each effect that came last its best fit, the best of all first."""
    best: dict[str, Fit] = {}
    for fit in sorted(fits, key=lambda f: f.evidence):
        best.setdefault(fit.keys[-1], fit)
    return list(best.values())


def _finals(fitter: Fitter, base: Fit, fits: Sequence[Fit], bar: float) -> list[Fit]:
    """The best effects, each in its best form, fitted to the end where there are several. Where
    what they leave stands out, or none gains anything, they are surveyed first.
    """
    foremost = _best_of_each(fits)[: fitter.rules.finalists]
    least = fitter.rules.hopeful * max((base.evidence - f.evidence for f in foremost), default=0.0)
    hopeful = [f for f in foremost if base.evidence - f.evidence > least]
    surveyed = hopeful or foremost
    if _spent(fitter) < 1:
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
    return fit.keys[-1] in fit.negligible(fitter.rules)


def _in_main_form(fitter: Fitter, base: Fit, fit: Fit) -> Hypothesis:
    """A base with the effect that came last in a fit, in its first form of the same equations."""
    effect, form = fit.hypothesis.effects[-1]
    main = next(f for f in effect.forms if f.settings == form.settings and fitter.readable(f))
    return base.hypothesis.plus(effect, main)


def _surveyed(fitter: Fitter, base: Fit, fit: Fit) -> Fit:
    """The best of a fit, a thorough one from where it ended, and one of the effect's main form from
    the nominal plant, where what it leaves stands out and it has not been surveyed, for its
    equations are the base's. Tolerance that is bent to make up for an effect holds it where it is.
    """
    if fit.hypothesis.settings != base.hypothesis.settings or not unexplained(fitter, base):
        return fit
    if not unexplained(fitter, fit):
        return fit
    other = fitter.explore(fit.hypothesis, base, [fit.values(None)], fit)
    main = _in_main_form(fitter, base, fit)
    starts = [{**nominal_values(base), **s} for s in usual(fitter, base, main.effects[-1][1])]
    far = fitter.from_afar(main, base, starts[:SIDES])
    return min(fit, other, far, key=lambda f: f.evidence)


def _pruned(trail: _Trail, fit: Fit) -> Fit:
    """Without effects whose removal costs less evidence than an effect must bring: of what was
    fitted to a worse optimum, or what a later effect replaces. Nor one of a size that is none.
    """
    fitter = trail.fitter
    while fit.keys:
        trail.tried.append(fit)
        drops = _without(fitter, fit, fit.keys)
        trail.tried += drops
        idle = fit.negligible(fitter.rules)
        least = min((d for d in drops if not set(d.keys) & set(idle[:1])), key=lambda f: f.evidence)
        if not idle and least.evidence - fit.evidence > trail.bar:
            return fit
        gone = next(k for k in fit.keys if k not in least.keys)
        trail.steps.append(Step(gone, fit.evidence - least.evidence, least, dropped=True))
        fit = fitter.again(least, thorough=True)
    return fit


def _without(fitter: Fitter, fit: Fit, keys: Sequence[str]) -> list[Fit]:
    """A fit without each of some effects."""
    fewer = [fit.hypothesis.without(k) for k in keys]
    return fitter.together(lambda h: fitter.explore(h, fit), fewer, fewer)


def _added(
    fitter: Fitter, base: Fit, chosen: Sequence[Sequence[Candidate]], ahead: Fit | None
) -> list[Fit]:
    """Effects from the base, each from its candidates' starts, and from the others; those that keep
    the base's equations first, for they tell how much the others are to gain.
    """
    made: list[Fit] = []
    settings = base.hypothesis.settings
    tried = [_from(fitter, base, own) for own in chosen]
    for keeps in (True, False):
        front = _ahead([*made, *([ahead] if ahead else [])])
        own = [t for t in tried if (t[0].settings == settings) is keeps]
        made += _explored(fitter, base, own, front)
    return made


def _explored(
    fitter: Fitter,
    base: Fit,
    tried: Sequence[Told],
    ahead: Fit | None,
) -> list[Fit]:
    """Hypotheses near a base, each from some starts, side by side. Where the best so far leaves
    nothing to explain, other equations are surveyed only where they contend with it.
    """
    if not tried:
        return []
    best = min((f for f in (base, ahead) if f is not None), key=lambda f: f.evidence)
    fresh = FRESH if _unexplained(fitter, best) else 1

    def explored(each: Told) -> Fit:
        return fitter.explore(each[0], base, each[1], ahead, thorough=False, fresh=fresh)

    return fitter.together(explored, tried, [h for h, _ in tried])


def _from(
    fitter: Fitter, base: Fit, own: Sequence[Candidate]
) -> tuple[Hypothesis, list[Mapping[str, float]]]:
    """A base with the effect of some candidates, and where it starts beside the base."""
    effect, form = own[0].effect, own[0].form
    candidates = [c.starts for c in own]
    listed = [*candidates, *(s for s in starts_of(fitter, base, form) if s not in candidates)]
    return base.hypothesis.plus(effect, form), [s for s in listed if s][:STARTS]


def _other_forms(
    fitter: Fitter, base: Fit, fits: Sequence[Fit], tried: Collection[Forms] = ()
) -> list[Fit]:
    """The best effects in their other forms, but for what has been tried; where none gains anything
    and what is left stands out, the best of those, too.
    """
    known = {f.hypothesis.forms for f in fits}.union(tried)
    best = _best_of_each(fits)
    least = NEARLY * max((base.evidence - f.evidence for f in fits), default=0.0)
    near = [f for f in best if base.evidence - f.evidence > max(least, 0.0)]
    if not near and _unexplained(fitter, base):
        near = best
    told = []
    for fit in near[: fitter.rules.reformed]:
        effect, _ = fit.hypothesis.effects[-1]
        for form in effect.forms:
            hypothesis = base.hypothesis.plus(effect, form)
            if hypothesis.forms in known or not fitter.readable(form):
                continue
            starts = [fit.values(None), *(s for s in starts_of(fitter, base, form) if s)]
            told.append((hypothesis, starts[:STARTS]))
    return _explored(fitter, base, told, _ahead(fits))


def _chosen(
    fitter: Fitter,
    screened: Sequence[Candidate],
    bar: float,
    measures: Sequence[str],
    every: bool = False,
) -> list[list[Candidate]]:
    """The effects of the largest predicted gain, by any measure, each with its best starts: the
    measures may differ in them. every: all of them, however little is predicted.
    """
    chosen: dict[tuple[str, str], list[Candidate]] = {}
    for measure in measures:
        ranked = sorted(screened, key=lambda c: -getattr(c, measure))
        hopeful = fitter.rules.hopeful * getattr(ranked[0], measure) if ranked else 0.0
        least = -math.inf if every else max(bar, hopeful)
        few = len(ranked) if every else fitter.rules.screened
        best = {_form_of(c): c for c in reversed(ranked) if getattr(c, measure) > least}
        for c in sorted(best.values(), key=lambda c: -getattr(c, measure))[:few]:
            own = chosen.setdefault(_form_of(c), [])
            if c not in own:
                own.append(c)
    return list(chosen.values())


def _form_of(c: Candidate) -> tuple[str, str]:
    return c.effect.key, c.form.name
