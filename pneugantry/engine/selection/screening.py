"""Which effects promise most: score tests of every start of every form about a fit.

A test takes a column of the Jacobian, or the difference that a start itself makes, beside the
nuisances' columns, and predicts what a step along them gains.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.fitting.noise import Noise, doubted, loss, weights
from pneugantry.engine.fitting.weighing import Weighing
from pneugantry.engine.hypotheses.catalogue import Effect, Form, Parameter
from pneugantry.engine.hypotheses.hypothesis import Coordinate
from pneugantry.engine.plant import Array
from pneugantry.engine.selection.relief import Reliefs
from pneugantry.engine.views.simulation import Cell

__all__ = [
    "Candidate",
    "Memory",
    "Offer",
    "Traces",
    "screen",
    "starts_of",
    "usual",
]

NEAR = 0.05  # usual sizes off the base, where its own slopes are taken
FEW = 2  # starts that are screened with all their columns
MANY = 16  # starts that are screened in all records
WINNOWED = 3  # of a view's records, one of so many tells which of more starts these are
SHARES = (1.0, 0.5, 0.25)  # of a predicted step that are tried on paper
NOTHING = 0.1  # share of `Rules.effect`; a start whose slopes predict less is looked at no closer
CHUNK = 50  # rows of a residual that are drawn together where a gain is predicted
Offer = tuple[Effect, Form]


@dataclass(frozen=True)
class Candidate:
    """A form of an effect from one of its starts, and what a score test predicts of it."""

    effect: Effect
    form: Form
    starts: Mapping[str, float]
    gain: float  # of -2 log likelihood, under the base's noise
    plain: float  # the same under white noise as quoted


# What a start, counted, of a form changes in a cell: 0 the start itself, n its n-th parameter.
Traces = dict[tuple[str, str, int, Cell, int], Array]


class Memory:
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
    changed = {
        *fitter.coordinates.touched(after.hypothesis),
        *fitter.coordinates.touched(before.hypothesis),
    }
    moved = {
        c for c, r in after.residuals.items() if not np.array_equal(r, before.residuals[c])
    } | changed
    alone = {k[:4] for k in traces if k[4] == 0}  # of starts that differ from the base
    return {k: v for k, v in traces.items() if k[3] not in (changed if k[:4] in alone else moved)}


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
    by_form = _trials(forms, lambda form: starts_of(fitter, base, form))
    prepared = [own[0] for own in by_form if not base.keys or own[0].form.settings]
    fitter.prepare([base.hypothesis.plus(t.effect, t.form) for t in prepared])
    tests = (
        _Test(fitter, base, base.noise),
        _Test(fitter, base, fitter.noise.plain(base.residuals)),
    )
    cells = fitter.simulation.cells

    def columns(t: _Trial) -> dict[Cell, list[Array]]:
        return t.columns(known, cells)

    def onward(t: _Trial, told: Sequence[Cell]) -> list[float]:
        return [test.onward(t.columns(known, told), either=not t.moves) for test in tests]

    trials = [t for own in by_form if len(own) <= FEW for t in own]
    many = [own for own in by_form if len(own) > FEW]
    many = _winnowed(fitter, base, many, known, onward)
    _trace(fitter, base, [t for own in many for t in own], known, alone=True)
    trials += [t for own in many for t in _foremost(own, [onward(t, cells) for t in own], FEW)]
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


def _winnowed(
    fitter: Fitter,
    base: Fit,
    by_form: Sequence[list[_Trial]],
    known: Traces,
    hoped: Callable[[_Trial, Sequence[Cell]], list[float]],
) -> list[list[_Trial]]:
    """Of forms of many starts those that hope for most, by any measure, in the records of each view
    that are met worst.
    """
    told = _worst_records(fitter, base)
    many = [own for own in by_form if len(own) > MANY]
    _trace(fitter, base, [t for own in many for t in own], known, alone=True, cells=told)
    return [
        _foremost(own, [hoped(t, told) for t in own], MANY) if len(own) > MANY else own
        for own in by_form
    ]


def _worst_records(fitter: Fitter, base: Fit) -> list[Cell]:
    """Of each view's cells one of `WINNOWED`, those that are met worst."""
    told: list[Cell] = []
    for view in fitter.simulation.views:
        own = [c for c in fitter.simulation.cells if c[0] == view]
        own.sort(key=lambda c: -fitter.simulation.misfit(c, base.residuals[c]))
        told += own[: -(-len(own) // WINNOWED)]
    return told


def _foremost(own: Sequence[_Trial], hoped: Sequence[Sequence[float]], count: int) -> list[_Trial]:
    """So many by each measure, in the order that they have."""
    ranked = [sorted(range(len(own)), key=lambda i: -hoped[i][k]) for k in range(len(hoped[0]))]
    return [own[i] for i in sorted({i for order in ranked for i in order[:count]})]


def _trials(
    forms: Sequence[Offer], listed: Callable[[Form], Sequence[Mapping[str, float]]]
) -> list[list[_Trial]]:
    """The starts of each form."""
    return [[_Trial(e, f, i, s) for i, s in enumerate(listed(f))] for e, f in forms]


def _coordinates(fitter: Fitter, form: Form) -> list[Coordinate]:
    """Of a form's parameters."""
    return [fitter.coordinates.of_effect(p) for p in form.parameters]


def usual(fitter: Fitter, base: Fit, form: Form) -> list[dict[str, float]]:
    """The starts that a form lists; else its usual sizes to either side."""
    listed = [s for s in starts_of(fitter, base, form) if s]
    if listed:
        return listed
    coordinates = _coordinates(fitter, form)
    neutral = {c.parameter: c.value(0.0) for c in coordinates}
    sides = [{c.parameter: c.value(side) for c in coordinates} for side in (1.0, -1.0)]
    return [s for s in sides if s != neutral]


Job = tuple[dict[str, float], float]  # values to simulate, step in theta


def _trace(
    fitter: Fitter,
    base: Fit,
    trials: Sequence[_Trial],
    known: Traces,
    alone: bool = False,
    cells: Sequence[Cell] = (),
) -> None:
    """What each trial changes in the cells that read it: the difference that its start makes, if it
    has one, and its parameters' columns there; alone: only the difference, if it has one. cells:
    those that are simulated; none: all.
    """
    asked: list[tuple[Cell, list[dict[str, float]]]] = []
    owners: list[tuple[_Trial, list[Job]]] = []
    for t in {id(t): t for t in trials}.values():
        points = _points(fitter, base, t.form, t.starts)[: 1 if alone and t.moves else None]
        names = {p.name for p in t.form.parameters} | set(t.form.settings)
        shared = _shared(fitter, base, t.form) if not t.starts else None
        for cell in cells or fitter.simulation.cells:
            view, key = fitter.simulation.views[cell[0]], (*t.key, cell)
            there = known.get((*key, 0))
            if not any(view.depends_on(n) for n in names) or (*key, len(points) - 1) in known:
                continue
            if shared is not None:
                for n, (name, ratio) in enumerate(shared, 1):
                    nothing = np.zeros_like(base.residuals[cell])
                    known[(*key, n)] = ratio * base.columns.get((cell, name), nothing)
            elif there is None or there.any():  # where a start changes nothing, its slopes do not
                owners.append((t, points))
                asked.append((cell, [{**base.values(cell[1]), **moved} for moved, _ in points]))
    found = fitter.simulation.about(asked)
    for (t, points), (cell, _), runs in zip(owners, asked, found, strict=True):
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
        at[c.parameter] = starts.get(c.parameter, known.get(c.parameter, c.value(c.none)))
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
        effect = fitter.coordinates.of_effect(p)
        found.append((p.name, _slope(effect, effect.theta(own.value(theta))) / _slope(own, theta)))
    return found


def _slope(c: Coordinate, theta: float) -> float:
    """d value / d theta."""
    return c.unit * c.value(theta) if c.logarithmic else c.unit


def starts_of(fitter: Fitter, base: Fit, form: Form) -> list[dict[str, float]]:
    """Combinations of the starts that a form lists; an empty one where it lists none, and where the
    base fits the same parameters as nuisances.
    """

    def value(p: Parameter, start: float) -> float:
        return start * abs(fitter.coordinates.neutral(p.name)) if p.relative else start

    listed = [[(p.name, value(p, s)) for s in p.starts] for p in form.parameters if p.starts]
    found = [dict(chosen) for chosen in itertools.product(*listed)]
    return [{}, *found] if found[0] and not form.settings else found


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
            [1 if c.effect else fitter.rules.tolerated for c in point.coordinates]
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

    def onward(self, columns: Mapping[Cell, Sequence[Array]], *, either: bool) -> float:
        """The same of a step towards a start, were the cost a parabola: what lies the other way is
        another start's. either: whether it may go either way, as from the base itself.
        """
        straight, step, _, _ = self._stepped(columns)
        return straight if either or np.all(step > 0) else 0.0

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
