"""Which effects the records need: forward selection by evidence, with a backward step.

Every start of every form is screened by a score test: a column of the Jacobian, or the difference
that the start itself makes, beside the nuisances' columns. What gains most by it is fitted near the
base, and the best of that with all views together. Where that leaves more than noise, effects are
tested and fitted from the nominal plant as well (`_afresh`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pneugantry.engine.catalogue import Effect, Form, Parameter
from pneugantry.engine.descent import Weighing, flat_noise
from pneugantry.engine.fitter import Fit, Fitter
from pneugantry.engine.hypothesis import Coordinate, Hypothesis, effect_coordinate
from pneugantry.engine.noise import Noise, doubted, loss, weights
from pneugantry.engine.plant import Array
from pneugantry.engine.relief import Reliefs
from pneugantry.engine.simulation import Cell

__all__ = ["Candidate", "Search", "Step", "screen", "search"]


@dataclass(frozen=True)
class Candidate:
    """A form of an effect from one of its starts, and what a score test predicts of it."""

    effect: Effect
    form: Form
    starts: Mapping[str, float]
    gain: float  # of -2 log likelihood, under the base's noise
    plain: float  # the same under white noise as quoted
    afresh: float = 0.0  # from the nominal plant on, under white noise of what the base leaves


# What a start, counted, of a form changes in a cell: 0 the start itself, n its n-th parameter.
Traces = dict[tuple[str, str, int, Cell, int], Array]


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
        return {_told(f.hypothesis.effects) for f in self.tried}

    def beside(self, keys: Collection[str]) -> list[Effect]:
        return [e for k, e in self.offered.items() if k not in keys]

    def polished(self, fit: Fit) -> Fit:
        """At its best optimum, without what it no longer needs."""
        best = _pruned(self, self.fitter.again(fit, thorough=True))
        self.tried.append(best)
        return best


def search(fitter: Fitter, null: Fit, catalogue: Mapping[str, Effect]) -> Search:
    """Effects are added while one brings evidence, and dropped where a later one replaces them;
    in the end each is held against what else may be in its place.
    """
    offered = {k: e for k, e in catalogue.items() if any(fitter.readable(f) for f in e.forms)}
    trail = _Trail(fitter, offered, [null])
    best = _exchanged(trail, _gathered(trail, null))
    null = min((f for f in trail.tried if not f.keys), key=lambda f: f.evidence)
    tried = tuple(f for f in trail.tried if not f.negligible(fitter.rules))
    return Search(null, best, tuple(trail.steps), tried, tuple(trail.screened))


def _gathered(trail: _Trail, null: Fit) -> Fit:
    """Forward, each effect in its main form and the best in their others."""
    fitter, best, thorough = trail.fitter, null, False
    near, far = _Memory(), _Memory()
    for _ in range(fitter.rules.rounds):
        forms = _main_forms(fitter, trail.beside(best.keys), every=bool(fitter.loud(best)))
        if best.keys:  # there are too many pairs to prepare each
            fitter.prepare_any(best.hypothesis, trail.offered.values())
        trail.screened = screen(fitter, best, forms, near.about(fitter, best))
        fits = _fits(fitter, best, trail.screened, trail.bar, forms, far)
        finals = _finals(fitter, best, fits, trail.bar)
        trail.tried += [*fits, *finals]
        top = max(finals, key=lambda f: f.gain(best, fitter.rules), default=None)
        if top is not None and top.gain(best, fitter.rules) < trail.bar:
            top = None
        if top is not None:
            trail.steps.append(Step(top.keys[-1], best.evidence - top.evidence, top))
        elif thorough:
            break
        before, thorough = best, True  # whose own best optimum may still be elsewhere
        best = trail.polished(top or best)
        if top is not None and fitter.loud(best):
            best = _reformed(trail, best)
        least = fitter.rules.entry if top is None else trail.bar
        if set(best.keys) == set(before.keys) and before.evidence - best.evidence < least:
            best = min(before, best, key=lambda f: f.evidence)
            break  # nothing to be screened that was not; what came was dropped again
    return best


def _reformed(trail: _Trail, best: Fit) -> Fit:
    """With another form of an effect that came before the last, where it does better beside it."""
    fitter, fits = trail.fitter, []
    for effect, form in best.hypothesis.effects[:-1]:
        for other in filter(fitter.readable, effect.forms):
            hypothesis = best.hypothesis.without(effect.key).plus(effect, other)
            if other is not form and _told(hypothesis.effects) not in trail.known:
                fits.append(fitter.explore(hypothesis, best, [best.values(None)], thorough=False))
    trail.tried += fits
    top = min((best, *fits), key=lambda f: f.evidence)
    return trail.polished(top) if best.evidence - top.evidence > fitter.rules.entry else best


def _exchanged(trail: _Trail, best: Fit) -> Fit:
    """With another effect in the place of one, where that does better."""
    rivals = _rivals(trail, best)
    trail.tried += rivals
    top = min((best, *rivals), key=lambda f: f.evidence)
    if top is best:
        return best
    if set(top.keys) != set(best.keys):
        trail.steps.append(Step(top.keys[-1], best.evidence - top.evidence, top))
        trail.steps += [Step(k, 0.0, top, dropped=True) for k in best.keys if k not in top.keys]
    return trail.polished(top)


Offer = tuple[Effect, Form]


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
    for effect, _ in best.hypothesis.effects:
        rest = set(best.keys) - {effect.key}
        bases = [f for f in trail.tried if set(f.keys) == rest]
        if not bases:
            continue
        base = min(bases, key=lambda f: f.evidence)
        forms = [
            (e, f)
            for e in trail.beside(rest)
            for f in e.forms
            if e.block == effect.block and fitter.readable(f)
            if _told(base.hypothesis.plus(e, f).effects) not in known
        ]
        screened = screen(fitter, base, forms, {})
        least = max(base.evidence - best.evidence, trail.bar)
        for own in _chosen(fitter, screened, least, ("gain", "plain")):
            fits.append(_added(fitter, base, own, best))
    return fits


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
        if len(fit.keys) != len(best.keys) + 1 or len(more) != 1 or _told(effects) in seen:
            continue
        if fit.evidence > best.evidence + trail.bar:
            break
        gone = [e.key for e, _ in effects if e.block == more[0].block and e is not more[0]]
        if not seen and fit.evidence < best.evidence - trail.fitter.rules.entry:
            gone.append(more[0].key)
        fits += [trail.fitter.explore(fit.hypothesis.without(key), fit) for key in gone]
        seen.add(_told(effects))
    return fits


def _told(effects: Sequence[Offer]) -> frozenset[tuple[str, str]]:
    return frozenset((e.key, f.name) for e, f in effects)


class _Memory:
    """Traces about a fit that changes from round to round, as long as they serve."""

    def __init__(self) -> None:
        self._fit: Fit | None = None
        self._traces: Traces = {}

    def about(self, fitter: Fitter, fit: Fit) -> Traces:
        """Those that serve about a fit; what is added to them is kept."""
        if self._fit is not None and fit is not self._fit:
            self._traces = _kept(fitter, self._traces, self._fit, fit)
        self._fit = fit
        return self._traces


def _kept(fitter: Fitter, traces: Traces, before: Fit, after: Fit) -> Traces:
    """Traces that still serve: of starts, in cells that no effect of either fit touches; of the
    base's own slopes, in cells where nothing moved: beside columns of another point they would not
    add up.
    """
    changed = {*fitter.touched(after.hypothesis), *fitter.touched(before.hypothesis)}
    moved = {
        c for c, r in after.residuals.items() if not np.array_equal(r, before.residuals[c])
    } | changed
    alone = {k[:4] for k in traces if k[4] == 0}  # of starts that differ from the base
    return {k: v for k, v in traces.items() if k[3] not in (changed if k[:4] in alone else moved)}


def _fits(
    fitter: Fitter,
    base: Fit,
    screened: Sequence[Candidate],
    bar: float,
    forms: Sequence[Offer],
    far: _Memory,
) -> list[Fit]:
    """What is predicted to gain most, with the best in their other forms. Where all that leaves
    more than noise in some views, whatever else these read: an event that a simulation misses (a
    break-away) shows in no prediction. Where that does, too, also what is predicted from the
    nominal plant on, of which `far` is.
    """
    rough: list[Fit] = []
    measures = ("gain", "plain")
    for own in _chosen(fitter, screened, bar, measures):
        rough.append(_added(fitter, base, own, _ahead(rough)))
    left = fitter.loud(min((base, *rough), key=lambda f: f.evidence))
    known = {(e.key, form.name) for f in rough for e, form in f.hypothesis.effects[-1:]}
    rest = [c for c in screened if _form_of(c) not in known and _reaches(fitter, c, left)]
    for own in _chosen(fitter, rest, bar, measures, every=True):
        hypothesis, starts = _from(fitter, base, own)
        if fitter.scouted(hypothesis, base, starts, left) > bar:
            rough.append(_added(fitter, base, own, _ahead(rough)))
    if fitter.loud(min((base, *rough), key=lambda f: f.evidence)):
        for own in _chosen(fitter, _afresh(fitter, base, forms, far), bar, ("afresh",)):
            hypothesis = base.hypothesis.plus(own[0].effect, own[0].form)
            rough.append(fitter.from_afar(hypothesis, base, [c.starts for c in own]))
    return rough + _other_forms(fitter, base, rough)


def _reaches(fitter: Fitter, c: Candidate, views: Collection[str]) -> bool:
    """Whether any of some views reads anything of a candidate."""
    return any(cell[0] in views for cell in fitter.touched(Hypothesis().plus(c.effect, c.form)))


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
    they leave more than noise, or none gains anything, they are surveyed first.
    """
    foremost = _best_of_each(fits)[: fitter.rules.finalists]
    least = fitter.rules.hopeful * max((base.evidence - f.evidence for f in foremost), default=0.0)
    hopeful = [f for f in foremost if base.evidence - f.evidence > least]
    surveyed = [_surveyed(fitter, base, f) for f in hopeful or foremost]
    chosen = [f for f in surveyed if f.evidence < base.evidence and not f.negligible(fitter.rules)]
    if len(chosen) == 1 and chosen[0].gain(base, fitter.rules) > bar:
        return chosen
    return [fitter.again(f) for f in chosen]


def _surveyed(fitter: Fitter, base: Fit, fit: Fit) -> Fit:
    """The best of a fit, a thorough one from where it ended, and one of the effect's main form from
    the nominal plant, where it leaves more than noise and has not been surveyed, for its equations
    are the base's. Tolerance that is bent to make up for an effect holds it where it is.
    """
    if fit.hypothesis.settings != base.hypothesis.settings or not fitter.loud(fit):
        return fit
    other = fitter.explore(fit.hypothesis, base, [fit.values(None)], fit)
    effect, form = fit.hypothesis.effects[-1]
    main = next(f for f in effect.forms if f.settings == form.settings and fitter.readable(f))
    starts = [{**_nominal(base), **s} for s in _usual(fitter, base, main)]
    far = fitter.from_afar(base.hypothesis.plus(effect, main), base, starts[:SIDES])
    return min(fit, other, far, key=lambda f: f.evidence)


def _pruned(trail: _Trail, fit: Fit) -> Fit:
    """Without effects whose removal costs less evidence than an effect must bring: of what was
    fitted to a worse optimum, or what a later effect replaces. Nor one of a size that is none.
    """
    fitter = trail.fitter
    while fit.keys:
        trail.tried.append(fit)
        drops = [fitter.explore(fit.hypothesis.without(k), fit) for k in fit.keys]
        trail.tried += drops
        idle = fit.negligible(fitter.rules)
        least = min((d for d in drops if not set(d.keys) & set(idle[:1])), key=lambda f: f.evidence)
        if not idle and least.evidence - fit.evidence > trail.bar:
            return fit
        gone = next(k for k in fit.keys if k not in least.keys)
        trail.steps.append(Step(gone, fit.evidence - least.evidence, least, dropped=True))
        fit = fitter.again(least, thorough=True)
    return fit


def _added(fitter: Fitter, base: Fit, own: Sequence[Candidate], ahead: Fit | None) -> Fit:
    """An effect from the base, from its candidates' starts, and from the others."""
    hypothesis, starts = _from(fitter, base, own)
    return fitter.explore(hypothesis, base, starts, ahead, thorough=False)


def _from(
    fitter: Fitter, base: Fit, own: Sequence[Candidate]
) -> tuple[Hypothesis, list[Mapping[str, float]]]:
    """A base with the effect of some candidates, and where it starts beside the base."""
    effect, form = own[0].effect, own[0].form
    candidates = [c.starts for c in own]
    listed = [*candidates, *(s for s in _starts(fitter, base, form) if s not in candidates)]
    return base.hypothesis.plus(effect, form), [s for s in listed if s][:STARTS]


def _other_forms(fitter: Fitter, base: Fit, fits: Sequence[Fit]) -> list[Fit]:
    """The best effects in their other forms; where none gains anything and more than noise is left,
    the best of those, too.
    """
    made: list[Fit] = []
    known = {_told(f.hypothesis.effects[-1:]) for f in fits}
    best = _best_of_each(fits)
    least = NEARLY * max((base.evidence - f.evidence for f in fits), default=0.0)
    near = [f for f in best if base.evidence - f.evidence > max(least, 0.0)]
    if not near and fitter.loud(base):
        near = best
    for fit in near[: fitter.rules.reformed]:
        effect, _ = fit.hypothesis.effects[-1]
        for form in effect.forms:
            if _told([(effect, form)]) in known or not fitter.readable(form):
                continue
            hypothesis = base.hypothesis.plus(effect, form)
            starts = [fit.values(None), *(s for s in _starts(fitter, base, form) if s)]
            ahead = _ahead([*fits, *made])
            made.append(fitter.explore(hypothesis, base, starts[:STARTS], ahead, thorough=False))
    return made


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


@dataclass(frozen=True)
class _Trial:
    """One start of an effect's form."""

    effect: Effect
    form: Form
    number: int
    starts: Mapping[str, float]

    @property
    def key(self) -> tuple[str, str, int]:
        return self.effect.key, self.form.name, self.number

    @property
    def moves(self) -> bool:
        """Whether the start differs from the base."""
        return bool(self.starts or self.form.settings)

    def columns(self, known: Traces, cells: Sequence[Cell]) -> dict[Cell, list[Array]]:
        """What is known of what it changes, as many columns in each cell that it reaches."""
        parts = range(1 + len(self.form.parameters))
        own = {(c, n): known[k] for c in cells for n in parts if (k := (*self.key, c, n)) in known}
        told = sorted({n for _, n in own})
        reached = {c: column for (c, _), column in own.items()}
        return {
            c: [own.get((c, n), np.zeros_like(column)) for n in told]
            for c, column in reached.items()
        }


def screen(fitter: Fitter, base: Fit, forms: Sequence[Offer], known: Traces) -> list[Candidate]:
    """Score test of every start of effects' forms; where there are many, the parameters'
    columns only of those that tell most without. `known`: traces simulated before, of cells where
    the base is much as it was then; new ones are added to it.
    """
    by_form = _trials(forms, lambda form: _starts(fitter, base, form))
    prepared = [own[0] for own in by_form if not base.keys or own[0].form.settings]
    fitter.prepare([base.hypothesis.plus(t.effect, t.form) for t in prepared])
    tests = (
        _Test(fitter, base, base.noise),
        _Test(fitter, base, fitter.plain(base.residuals)),
    )
    cells = fitter.simulation.cells

    def columns(t: _Trial) -> dict[Cell, list[Array]]:
        return t.columns(known, cells)

    trials = [t for own in by_form if len(own) <= FEW for t in own]
    many = [own for own in by_form if len(own) > FEW]
    _trace(fitter, base, [t for own in many for t in own], known, alone=True)
    for own in many:
        hoped = [[test.onward(c) for test in tests] for c in map(columns, own)]
        ranked = [sorted(range(len(own)), key=lambda i: -hoped[i][k]) for k in range(len(tests))]
        trials += [own[i] for i in sorted({i for order in ranked for i in order[:FEW]})]
    _trace(fitter, base, trials, known)
    made = [
        Candidate(t.effect, t.form, t.starts, *(test.gain(c) for test in tests))
        for t, c in ((t, columns(t)) for t in trials)
    ]
    reliefs = Reliefs(fitter, base)
    for own in by_form:
        effect, form = own[0].effect, own[0].form
        relief = reliefs.of(form)
        if relief is not None:
            made.append(Candidate(effect, form, relief.starts, relief.gain, relief.gain))
    return made


def _afresh(fitter: Fitter, base: Fit, forms: Sequence[Offer], far: _Memory) -> list[Candidate]:
    """The same tests about the nominal plant, each effect at its usual size to either side: what it
    gains beyond most of what tolerance alone is to leave there over the base. far: of that plant,
    from round to round.

    Where much is missing, tolerance bends far from the truth to make up for it, and from there no
    slope tells what would do so better.
    """
    nominal = fitter.afresh(base)
    if not all(np.isfinite(r).all() for r in nominal.residuals.values()):
        return []
    known = far.about(fitter, nominal)
    test = _Test(fitter, nominal, flat_noise(fitter.simulation, base.residuals))
    behind = (1 - CLOSE) * (test.ahead - test.standing(base))
    cells, back = fitter.simulation.cells, _nominal(base)
    by_form = _trials(forms, lambda form: _usual(fitter, base, form))

    def gain(t: _Trial) -> float:
        return test.gain(t.columns(known, cells)) - behind

    _trace(fitter, nominal, [t for own in by_form for t in own], known, alone=True)
    first = {id(t): gain(t) for own in by_form for t in own}
    best = [max(own, key=lambda t: first[id(t)]) for own in by_form if own]
    few = sorted(best, key=lambda t: -first[id(t)])[: 2 * fitter.rules.screened]
    _trace(fitter, nominal, few, known)
    return [Candidate(t.effect, t.form, {**back, **t.starts}, 0.0, 0.0, gain(t)) for t in few]


def _nominal(fit: Fit) -> dict[str, float]:
    """What every rig has off, as if nothing were; what is of one record is left out."""
    rest = (c for c in fit.point.coordinates if not c.effect and c.record is None)
    return {c.parameter: c.value(0.0) for c in rest}


def _trials(
    forms: Sequence[Offer], starts_of: Callable[[Form], Sequence[Mapping[str, float]]]
) -> list[list[_Trial]]:
    """The starts of each form."""
    return [[_Trial(e, f, i, s) for i, s in enumerate(starts_of(f))] for e, f in forms]


def _coordinates(fitter: Fitter, form: Form) -> list[Coordinate]:
    """Of a form's parameters."""
    spread = fitter.rules.effect_prior
    return [effect_coordinate(p, fitter.neutral(p.name), spread) for p in form.parameters]


def _usual(fitter: Fitter, base: Fit, form: Form) -> list[dict[str, float]]:
    """The starts that a form lists; else its usual sizes to either side."""
    listed = [s for s in _starts(fitter, base, form) if s]
    if listed:
        return listed
    coordinates = _coordinates(fitter, form)
    neutral = {c.parameter: c.value(0.0) for c in coordinates}
    sides = [{c.parameter: c.value(side) for c in coordinates} for side in (1.0, -1.0)]
    return [s for s in sides if s != neutral]


Job = tuple[dict[str, float], float]  # values to simulate, step in theta


def _trace(
    fitter: Fitter, base: Fit, trials: Sequence[_Trial], known: Traces, alone: bool = False
) -> None:
    """What each trial changes in the cells that read it: the difference that its start makes, if it
    has one, and its parameters' columns there; alone: only the difference, if it has one.
    """
    jobs: dict[Cell, list[dict[str, float]]] = {}
    owners: list[tuple[_Trial, Cell, int, list[Job]]] = []
    for t in {id(t): t for t in trials}.values():
        points = _points(fitter, base, t.form, t.starts)[: 1 if alone and t.moves else None]
        names = {p.name for p in t.form.parameters} | set(t.form.settings)
        shared = _shared(fitter, base, t.form) if not t.starts else None
        for cell in fitter.simulation.cells:
            view, key = fitter.simulation.views[cell[0]], (*t.key, cell)
            there = known.get((*key, 0))
            if not any(view.depends_on(n) for n in names) or (*key, len(points) - 1) in known:
                continue
            if shared is not None:
                for n, (name, ratio) in enumerate(shared, 1):
                    nothing = np.zeros_like(base.residuals[cell])
                    known[(*key, n)] = ratio * base.columns.get((cell, name), nothing)
            elif there is None or there.any():  # where a start changes nothing, its slopes do not
                own = jobs.setdefault(cell, [])
                owners.append((t, cell, len(own), points))
                own += [{**base.values(cell[1]), **moved} for moved, _ in points]
    found = fitter.simulation.run(jobs)
    for t, cell, at, points in owners:
        runs = found[cell][at : at + len(points)]
        if t.moves:
            known[*t.key, cell, 0] = runs[0] - base.residuals[cell]
        for n, (_, step) in enumerate(points[1:], 1):
            known[*t.key, cell, n] = (runs[n] - runs[0]) / step


def _points(
    fitter: Fitter, base: Fit, form: Form, starts: Mapping[str, float]
) -> list[tuple[dict[str, float], float]]:
    """Where to simulate: the start (second member 1 if it differs from the base), and a step off it
    in each parameter, with the step in theta.
    """
    known, coordinates = base.values(None), _coordinates(fitter, form)
    at = dict(form.settings)
    for c in coordinates:
        at[c.parameter] = starts.get(c.parameter, known.get(c.parameter, c.value(0.0)))
    points = [(dict(at), 1.0 if starts or form.settings else 0.0)]
    for c in coordinates:
        theta = c.theta(at[c.parameter])
        size = 0.5 if starts or form.settings else NEAR
        step = size if c.value(theta + size) != c.value(theta) else -size
        points.append(({**at, c.parameter: c.value(theta + step)}, step))
    return points


def _shared(fitter: Fitter, base: Fit, form: Form) -> list[tuple[str, float]] | None:
    """Where the base fits all parameters of a form as nuisances: their names, and what theta of the
    effect is in theta of the nuisance. Their columns are then exact: the effect only has a wider
    prior. None where it does not.
    """
    if form.settings:
        return None
    at = {c.name: (c, t) for c, t in zip(base.point.coordinates, base.point.theta, strict=True)}
    found = []
    for p in form.parameters:
        if p.name not in at:
            return None
        own, theta = at[p.name]
        effect = effect_coordinate(p, fitter.neutral(p.name), fitter.rules.effect_prior)
        found.append((p.name, _slope(effect, effect.theta(own.value(theta))) / _slope(own, theta)))
    return found


def _slope(c: Coordinate, theta: float) -> float:
    """d value / d theta."""
    return c.unit * c.value(theta) if c.logarithmic else c.unit


def _starts(fitter: Fitter, base: Fit, form: Form) -> list[dict[str, float]]:
    """Combinations of the starts that a form lists; an empty one where it lists none, and where the
    base fits the same parameters as nuisances.
    """

    def value(p: Parameter, start: float) -> float:
        return start * abs(fitter.neutral(p.name)) if p.relative else start

    listed = [[(p.name, value(p, s)) for s in p.starts] for p in form.parameters if p.starts]
    found = [dict(chosen) for chosen in itertools.product(*listed)]
    return [{}, *found] if found[0] and not form.settings else found


NEAR = 0.05  # usual sizes off the base, where its own slopes are taken
NEARLY = 0.1  # share of the largest gain from which on an effect's other forms are tried
STARTS = 2  # from which a form is fitted, beside the base
SIDES = 2  # usual sizes from which an effect is fitted on the nominal plant
FEW = 2  # starts that are screened with all their columns
SHARES = (1.0, 0.5, 0.25)  # of a predicted step that are tried on paper
CLOSE = 0.3  # of what tolerance alone is predicted to leave over a base, from the nominal plant on
NOTHING = 0.1  # share of `Rules.effect`; a start whose slopes predict less is looked at no closer
CHUNK = 50  # rows of a residual that are drawn together where a gain is predicted


@dataclass(frozen=True, eq=False)
class _Cell:
    """A cell at the base: innovations (rows,), roots of their weights, nuisances' columns."""

    innovations: Array
    roots: Array
    index: list[int]
    columns: Array  # (nuisances, rows)

    def along(self, nuisances: Array) -> Array:
        """Change of the innovations (rows,) by a step of all nuisances."""
        return nuisances[self.index] @ self.columns if self.index else np.zeros(len(self.roots))


class _Test:
    """Score tests about a fit, under given noise."""

    def __init__(self, fitter: Fitter, base: Fit, of_views: Noise) -> None:
        self.weighing = Weighing(of_views, fitter.rules)
        self.rules, self.tails, point = fitter.rules, fitter.rules.tails, base.point
        self.theta = point.theta
        self.precision = np.array([1 / c.spread**2 for c in point.coordinates])
        self.worth = np.array(
            [fitter.rules.tolerated if c.scales else 1 for c in point.coordinates]
        )
        normal, gradient = self.weighing.normal(point, base.residuals, base.columns)
        self.inverse = np.linalg.inv(normal + np.diag(self.precision))
        self.gradient = gradient + self.precision * point.theta
        self.plain = np.asarray(-self.inverse @ self.gradient)  # the nuisances' own step
        names = [c.name for c in point.coordinates]
        self.cells: dict[Cell, _Cell] = {}
        for cell in fitter.simulation.cells:
            w = self.weighing.innovations(cell, base.residuals[cell])
            index = [i for i, name in enumerate(names) if (cell, name) in base.columns]
            own = [names[i] for i in index]
            j = self.weighing.whitened(base.columns, cell, own) if own else np.zeros((1, len(w)))
            roots = np.sqrt(weights(w, self.tails))
            self.cells[cell] = _Cell(w, roots, index, j)
        self.least = {
            c: loss(at.innovations + at.along(self.plain), self.tails)
            for c, at in self.cells.items()
        }

    @property
    def ahead(self) -> float:
        """-2 log posterior to which the nuisances' own step is to lead."""
        cost = sum(float(terms.sum()) for terms in self.least.values())
        return cost + float((self.worth * self.precision) @ (self.theta + self.plain) ** 2)

    def standing(self, fit: Fit) -> float:
        """That of a fit of the same coordinates."""
        costs = self.weighing.costs(fit.residuals)
        return sum(costs.values()) + float((self.worth * self.precision) @ fit.point.theta**2)

    def gain(self, columns: Mapping[Cell, Sequence[Array]]) -> float:
        """Fall of -2 log posterior that a step along these columns is to bring, less its doubt."""
        straight, step, nuisances, white = self._stepped(columns)
        if straight < NOTHING * self.rules.effect:
            return straight
        along = {
            cell: at.along(nuisances) + (step @ white[cell] if cell in white else 0.0)
            for cell, at in self.cells.items()
            if cell in white or at.index
        }
        return max(self._fall(along, share, step, nuisances) for share in SHARES)

    def onward(self, columns: Mapping[Cell, Sequence[Array]]) -> float:
        """The same of a step towards a start, were the cost a parabola: what lies the other way is
        another start's.
        """
        straight, step, _, _ = self._stepped(columns)
        return straight if np.all(step > 0) else 0.0

    def _stepped(
        self, columns: Mapping[Cell, Sequence[Array]]
    ) -> tuple[float, Array, Array, dict[Cell, Array]]:
        """Fall of the parabola, the step along the columns, the nuisances' beside it, and the
        columns as innovations.
        """
        k = max((len(c) for c in columns.values()), default=0)
        if k == 0 or not all(np.isfinite(c).all() for cs in columns.values() for c in cs):
            return 0.0, np.zeros(k), self.plain, {}
        square, pull = np.eye(k) / self.rules.effect_prior**2, np.zeros(k)
        cross = np.zeros((len(self.gradient), k))
        white = {}
        for cell, raw in columns.items():
            at = self.cells[cell]
            white[cell] = d = self.weighing.innovations(cell, np.stack(raw))
            weighed = d * at.roots
            square += weighed @ weighed.T
            pull += weighed @ (at.innovations * at.roots)
            if at.index:
                cross[at.index] += at.columns @ (weighed * at.roots).T
        square = square - cross.T @ self.inverse @ cross
        pull = pull - cross.T @ self.inverse @ self.gradient
        step = np.asarray(-np.linalg.lstsq(square, pull, rcond=1e-10)[0])
        nuisances = np.asarray(-self.inverse @ (self.gradient + cross @ step))
        return float(-step @ pull), step, nuisances, white

    def _fall(
        self, along: Mapping[Cell, Array], share: float, step: Array, nuisances: Array
    ) -> float:
        """Of the cost, were all as straight as the columns, against a step of the nuisances. along:
        change of the innovations by the whole of both steps.
        """
        falls = []
        for cell, moved in along.items():
            at = self.cells[cell]
            fall = self.least[cell] - loss(at.innovations + share * moved, self.tails)
            falls.append(np.add.reduceat(fall, np.arange(0, len(fall), CHUNK)))
        before, after = self.theta + self.plain, self.theta + share * nuisances
        prior = float((self.worth * self.precision) @ (before**2 - after**2))
        prior -= share**2 * float(step @ step) / self.rules.effect_prior**2
        return prior + doubted(np.concatenate(falls), self.rules.doubt)
