"""Which effects the records need: forward selection by evidence, with a backward step.

Every start of every form is screened by a score test: a column of the Jacobian, or the difference
that the start itself makes, beside the nuisances' columns. What gains most by it is fitted near the
base, and the best of that with all views together.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pneugantry.engine.catalogue import Effect, Form, Parameter
from pneugantry.engine.descent import Weighing
from pneugantry.engine.fitter import Fit, Fitter
from pneugantry.engine.hypothesis import Coordinate, effect_coordinate
from pneugantry.engine.noise import Noise, doubted, loss, weights
from pneugantry.engine.plant import Array
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


# what an effect's start, counted, changes in a cell
Traces = dict[tuple[str, int, Cell], list[Array]]


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


def search(fitter: Fitter, null: Fit, catalogue: Mapping[str, Effect]) -> Search:
    """Effects are added while one brings evidence, and dropped where a later one replaces them."""
    best, steps, tried, thorough = null, [], [null], False
    offered = {k: e for k, e in catalogue.items() if any(fitter.readable(f) for f in e.forms)}
    bar = fitter.rules.entry + 2 * math.log(max(len(offered), 1))
    screened: list[Candidate] = []
    traces: Traces = {}
    for _ in range(fitter.rules.rounds):
        rest = {k: e for k, e in offered.items() if k not in best.keys}
        screened = screen(fitter, best, rest, traces)
        fits = _fits(fitter, best, screened, bar)
        finals = _finals(fitter, best, fits, bar)
        tried += [*fits, *finals]
        top = max(finals, key=lambda f: f.gain(best, fitter.rules), default=None)
        if top is None or top.gain(best, fitter.rules) < bar:
            if thorough:
                break
            top = best  # whose own best optimum may still be elsewhere
        else:
            steps.append(Step(top.keys[-1], best.evidence - top.evidence, top))
        before, thorough = best, True
        best = _pruned(fitter, fitter.again(top, thorough=True), bar, steps, tried)
        tried.append(best)
        changed = {*fitter.touched(best.hypothesis), *fitter.touched(before.hypothesis)}
        traces = {k: c for k, c in traces.items() if k[2] not in changed}
    null = min((f for f in tried if not f.keys), key=lambda f: f.evidence)
    return Search(null, best, tuple(steps), tuple(tried), tuple(screened))


def _fits(fitter: Fitter, base: Fit, screened: Sequence[Candidate], bar: float) -> list[Fit]:
    """What is predicted to gain most, with the best in their other forms."""
    rough = [_added(fitter, base, c) for c in _chosen(fitter, screened, bar)]
    return rough + _other_forms(fitter, base, rough)


def _finals(fitter: Fitter, base: Fit, fits: Sequence[Fit], bar: float) -> list[Fit]:
    """The best effects, each in its best form, fitted to the end where there are several."""
    best: dict[str, Fit] = {}
    largest = max((base.evidence - f.evidence for f in fits), default=0.0)
    for fit in sorted(fits, key=lambda f: f.evidence):
        if base.evidence - fit.evidence > max(fitter.rules.hopeful * largest, 0.0):
            best.setdefault(fit.keys[-1], fit)
    chosen = list(best.values())[: fitter.rules.finalists]
    if len(chosen) == 1 and chosen[0].gain(base, fitter.rules) > bar:
        return chosen
    return [fitter.again(f) for f in chosen]


def _pruned(fitter: Fitter, fit: Fit, bar: float, steps: list[Step], tried: list[Fit]) -> Fit:
    """Without effects whose removal costs less evidence than an effect must bring: of what was
    fitted to a worse optimum, or what a later effect replaces.
    """
    while fit.keys:
        tried.append(fit)
        drops = [fitter.explore(fit.hypothesis.without(k), fit) for k in fit.keys]
        tried += drops
        least = min(drops, key=lambda f: f.evidence)
        if least.evidence - fit.evidence > bar:
            return fit
        gone = next(k for k in fit.keys if k not in least.keys)
        steps.append(Step(gone, fit.evidence - least.evidence, least, dropped=True))
        fit = fitter.again(least, thorough=True)
    return fit


def _added(fitter: Fitter, base: Fit, c: Candidate) -> Fit:
    """From the start of the largest predicted gain; from the base where that ends worse."""
    hypothesis = base.hypothesis.plus(c.effect, c.form)
    fit = fitter.explore(hypothesis, base, c.starts)
    if c.starts and fit.evidence > base.evidence:
        return min(fit, fitter.explore(hypothesis, base), key=lambda f: f.evidence)
    return fit


def _other_forms(fitter: Fitter, base: Fit, fits: Sequence[Fit]) -> list[Fit]:
    """The best effects in their other forms."""
    made = []
    near = [f for f in sorted(fits, key=lambda f: f.evidence) if f.evidence < base.evidence]
    for fit in near[: fitter.rules.reformed]:
        effect, main = fit.hypothesis.effects[-1]
        for form in effect.forms:
            if form.name == main.name or not fitter.readable(form):
                continue
            hypothesis = base.hypothesis.plus(effect, form)
            made.append(
                min(
                    (fitter.explore(hypothesis, base, s) for s in _starts(fitter, base, form)[:2]),
                    key=lambda f: f.evidence,
                )
            )
    return made


def _chosen(fitter: Fitter, screened: Sequence[Candidate], bar: float) -> list[Candidate]:
    """The best start of the effects of the largest predicted gain, in either order: the two may
    differ in the start.
    """
    chosen: dict[tuple[str, str, tuple[float, ...]], Candidate] = {}
    for measure in ("gain", "plain"):
        ranked = sorted(screened, key=lambda c: -getattr(c, measure))
        least = max(bar, fitter.rules.hopeful * getattr(ranked[0], measure)) if ranked else bar
        best = {c.effect.key: c for c in reversed(ranked) if getattr(c, measure) > least}
        for c in sorted(best.values(), key=lambda c: -getattr(c, measure))[: fitter.rules.screened]:
            chosen.setdefault((c.effect.key, c.form.name, tuple(c.starts.values())), c)
    return list(chosen.values())


def screen(
    fitter: Fitter, base: Fit, effects: Mapping[str, Effect], known: Traces
) -> list[Candidate]:
    """Score test of every start of every effect's main form. `known`: traces simulated before, of
    cells where the base is much as it was then; new ones are added to it.
    """
    trials = [
        (effect, form, i, starts)
        for effect in effects.values()
        for form in [next(f for f in effect.forms if fitter.readable(f))]
        for i, starts in enumerate(_starts(fitter, base, form))
    ]
    _trace(fitter, base, trials, known)
    tests = (
        _Test(fitter, base, base.noise),
        _Test(fitter, base, fitter.flat(base.residuals)),
    )
    result = []
    for effect, form, i, starts in trials:
        columns = {
            cell: known[effect.key, i, cell]
            for cell in fitter.simulation.cells
            if (effect.key, i, cell) in known
        }
        gain, plain = (test.gain(columns) for test in tests)
        result.append(Candidate(effect, form, starts, gain, plain))
    return result


def _trace(
    fitter: Fitter,
    base: Fit,
    trials: Sequence[tuple[Effect, Form, int, Mapping[str, float]]],
    known: Traces,
) -> None:
    """What each trial changes in the cells that read it: the difference that its start makes, if it
    has one, and its parameters' columns there.
    """
    jobs: dict[Cell, list[dict[str, float]]] = {}
    owners: list[tuple[tuple[str, int, Cell], int, list[tuple[dict[str, float], float]]]] = []
    for effect, form, i, starts in trials:
        points = _points(fitter, base, form, starts)
        names = {p.name for p in form.parameters} | set(form.settings)
        for cell in fitter.simulation.cells:
            view = fitter.simulation.views[cell[0]]
            if (effect.key, i, cell) in known or not any(view.depends_on(n) for n in names):
                continue
            own = jobs.setdefault(cell, [])
            shared = _shared(fitter, base, form) if not starts else None
            if shared is not None:
                known[effect.key, i, cell] = [
                    ratio * base.columns[cell, name]
                    if (cell, name) in base.columns
                    else np.zeros_like(base.residuals[cell])
                    for name, ratio in shared
                ]
                continue
            owners.append(((effect.key, i, cell), len(own), points))
            own += [{**base.values(cell[1]), **moved} for moved, _ in points]
    found = fitter.simulation.run({cell: own for cell, own in jobs.items() if own})
    for key, at, points in owners:
        runs = found[key[2]][at : at + len(points)]
        first = [runs[0] - base.residuals[key[2]]] if points[0][1] else []
        slopes = [
            (run - runs[0]) / step for run, (_, step) in zip(runs[1:], points[1:], strict=True)
        ]
        known[key] = [*first, *slopes]


def _points(
    fitter: Fitter, base: Fit, form: Form, starts: Mapping[str, float]
) -> list[tuple[dict[str, float], float]]:
    """Where to simulate: the start (second member 1 if it differs from the base), and a step off it
    in each parameter, with the step in theta.
    """
    known = base.values(None)
    coordinates = [
        effect_coordinate(p, fitter.neutral(p.name), fitter.rules.effect_prior)
        for p in form.parameters
    ]
    at = dict(form.settings)
    for c in coordinates:
        at[c.parameter] = starts.get(c.parameter, known.get(c.parameter, c.value(0.0)))
    points = [(dict(at), 1.0 if starts or form.settings else 0.0)]
    for c in coordinates:
        theta = c.theta(at[c.parameter])
        step = 0.5 if c.value(theta + 0.5) != c.value(theta) else -0.5
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
    return [{}, *found] if found[0] and _shared(fitter, base, form) else found


SHARES = (1.0, 0.5, 0.25)  # of a predicted step that are tried on paper
CHUNK = 50  # rows of a residual that are drawn together where a gain is predicted


@dataclass(frozen=True, eq=False)
class _Cell:
    """A cell at the base: innovations (rows,), roots of their weights, nuisances' columns."""

    innovations: Array
    roots: Array
    index: list[int]
    columns: Array  # (rows, nuisances)


class _Test:
    """Score tests about a fit, under given noise."""

    def __init__(self, fitter: Fitter, base: Fit, of_views: Noise) -> None:
        self.weighing = Weighing(of_views, fitter.rules)
        self.rules, self.tails, point = fitter.rules, fitter.rules.tails, base.point
        self.theta = point.theta
        self.precision = np.array([1 / c.spread**2 for c in point.coordinates])
        normal, gradient = self.weighing.normal(point, base.residuals, base.columns)
        self.inverse = np.linalg.inv(normal + np.diag(self.precision))
        self.gradient = gradient + self.precision * point.theta
        self.plain = np.asarray(-self.inverse @ self.gradient)  # the nuisances' own step
        names = [c.name for c in point.coordinates]
        self.cells: dict[Cell, _Cell] = {}
        for cell in fitter.simulation.cells:
            w = self.weighing.innovations(cell, base.residuals[cell])
            index = [i for i, name in enumerate(names) if (cell, name) in base.columns]
            columns = [self.weighing.innovations(cell, base.columns[cell, names[i]]) for i in index]
            j = np.nan_to_num(np.column_stack(columns or [np.zeros(len(w))]))
            roots = np.sqrt(weights(w, self.tails))
            self.cells[cell] = _Cell(w, roots, index, j)
        self.least = {
            c: loss(self._moved(at, self.plain), self.tails) for c, at in self.cells.items()
        }

    def gain(self, columns: Mapping[Cell, Sequence[Array]]) -> float:
        """Fall of -2 log posterior that a step along these columns is to bring, less its doubt."""
        k = max((len(c) for c in columns.values()), default=0)
        if k == 0 or not all(np.isfinite(c).all() for cs in columns.values() for c in cs):
            return 0.0
        square, pull = np.eye(k) / self.rules.effect_prior**2, np.zeros(k)
        cross = np.zeros((len(self.gradient), k))
        white = {}
        for cell, raw in columns.items():
            at = self.cells[cell]
            d = np.column_stack([self.weighing.innovations(cell, c) for c in raw])
            white[cell] = d
            weighed = d * at.roots[:, None]
            square += weighed.T @ weighed
            pull += weighed.T @ (at.innovations * at.roots)
            if at.index:
                cross[at.index] += (at.columns * at.roots[:, None]).T @ weighed
        square = square - cross.T @ self.inverse @ cross
        pull = pull - cross.T @ self.inverse @ self.gradient
        step = np.asarray(-np.linalg.lstsq(square, pull, rcond=1e-10)[0])
        nuisances = np.asarray(-self.inverse @ (self.gradient + cross @ step))
        return max(self._fall(white, share * step, share * nuisances) for share in SHARES)

    def _fall(self, white: Mapping[Cell, Array], step: Array, nuisances: Array) -> float:
        """Of the cost, were all as straight as the columns, against a step of the nuisances."""
        falls = []
        for cell, at in self.cells.items():
            if cell not in white and not at.index:
                continue
            moved = self._moved(at, nuisances)
            if cell in white:
                moved = moved + white[cell] @ step
            fall = self.least[cell] - loss(moved, self.tails)
            falls.append(np.add.reduceat(fall, np.arange(0, len(fall), CHUNK)))
        before, after = self.theta + self.plain, self.theta + nuisances
        prior = float(self.precision @ (before**2 - after**2))
        prior -= float(step @ step) / self.rules.effect_prior**2
        return prior + doubted(np.concatenate(falls), self.rules.doubt)

    def _moved(self, at: _Cell, nuisances: Array) -> Array:
        return at.innovations + (at.columns @ nuisances[at.index] if at.index else 0.0)
