"""How well a curve over another variable would do in place of the one that an effect has.

A form of an effect may be a curve: a force over a position, say. What records show is a change
over time. It speaks for a variable where they pass its values again, after another way; where they
pass them once, a curve over the way travelled, or a drift, leaves no more. Which variable a curve
is over need not be known: at each row it is where the columns of the curve's nodes have their
centre.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pneugantry.engine.answer.decide import UNKNOWN, Evidence, Weighed
from pneugantry.engine.chances import Chances
from pneugantry.engine.fitting import noise
from pneugantry.engine.fitting.fit import Fit, known_beside
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.fitting.problem import Parabola
from pneugantry.engine.fitting.weighing import Weighing
from pneugantry.engine.hypotheses.catalogue import Form
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.signals.hats import hats
from pneugantry.engine.signals.sensors import sensed
from pneugantry.engine.task import Task
from pneugantry.engine.views.simulation import Cell

__all__ = ["OTHERS", "Imitation", "expected", "has_curves", "imitations", "imitators"]

OTHERS = ("way travelled", "time")  # of a record; a curve over time is each record's own
FEWEST = 3  # nodes of a curve
NODE = re.compile(r"(.+)\[(\d+)\]")
SMOOTH = 9  # rows over which columns are averaged: they may be none where a part rests
LEAST = 1e-3  # of a curve's largest columns, below which a row tells no place on it
ROUNDS = 6  # of least squares, weighted anew
NOTE = (
    "a curve over the {} does as well in these records; one that comes back to the same values by "
    "another way would tell"
)
LIKELY = 1e-3  # share of the likeliest hypothesis from which on one is asked

_Basis = Mapping[tuple[str, int], Array]  # curves over a cell's rows, by record ("": all) and node


@dataclass(frozen=True)
class Imitation:
    """An effect's curve over another variable."""

    key: str  # the effect
    variable: str  # of `OTHERS`
    behind: float  # rise of -2 log evidence from the effect's own curve, less its doubt


def imitators(
    fitter: Fitter, found: Sequence[Evidence], chances: Chances
) -> tuple[list[Weighed], list[str]]:
    """Hypotheses in which something unknown imitates an effect: to begin with, that another
    variable is behind it is as likely as the effect, and each other variable as any. And what is
    said of those of the likeliest fit.
    """
    e_fold = 2 * chances.temper  # -2 log evidence that makes one e times likelier
    cost = {e: e.cost + chances.entry * len(e.fit.keys) for e in found}
    best = min(found, key=lambda e: cost[e])
    made: list[Weighed] = []
    notes: list[str] = []
    for e in (e for e in found if cost[e] < cost[best] - e_fold * math.log(LIKELY)):
        for own in imitations(fitter, e.fit):
            rest = tuple(k for k in e.fit.keys if k != own.key)
            behind = max(own.behind, 0.0)
            made.append(((*rest, UNKNOWN), e.cost + behind + e_fold * math.log(len(OTHERS))))
            if e is best and behind < e_fold:
                notes.append(f"{own.key}: {NOTE.format(own.variable)}")
    return made, notes


def has_curves(fit: Fit) -> bool:
    """Whether any effect of a fit is a curve."""
    return any(True for _, form in fit.hypothesis.effects for _ in _curves(form))


def imitations(fitter: Fitter, fit: Fit) -> list[Imitation]:
    """Each curve of a fit's effects over each other variable."""
    made = []
    for effect, form in fit.hypothesis.effects:
        for nodes in _curves(form):
            curve = _Curve.of(fitter, fit, nodes)
            behind = curve.behind() if curve else {}
            made += [Imitation(effect.key, name, rise) for name, rise in behind.items()]
    return made


def expected(task: Task, fit: Fit, record: Record, rules: Rules, level: float) -> list[Imitation]:
    """The same once a further record is measured, as it would be if the effect is what is there.
    record: simulated, its sensors exact but for noise; level: of the rig's noise.
    """
    values, taken = fit.values(None), {r.name for r in task.data.fitted}
    signals = {n: sensed(n, y, record, values) for n, y in record.signals.items()}
    name = next(n for n in (record.name + k * "+" for k in range(len(taken) + 1)) if n not in taken)
    record = replace(record, name=name, signals=signals)
    fitter = Fitter(task.plant, task.views, [*task.data.fitted, record], rules, level)
    try:
        return imitations(fitter, fitter.in_more_records(fit))
    finally:
        fitter.close()


def _curves(form: Form) -> Iterator[list[str]]:
    """Names of the nodes of a form's curves, in their order."""
    found: dict[str, dict[int, str]] = {}
    for p in form.parameters:
        if match := NODE.fullmatch(p.name):
            found.setdefault(match[1], {})[int(match[2])] = p.name
    for own in found.values():
        if len(own) >= FEWEST:
            yield [own[k] for k in sorted(own)]


@dataclass(frozen=True, eq=False)
class _Line:
    """Innovations of a cell, as far as it is straight: `rest` and what `columns` add to it."""

    index: list[int]  # of the columns among all that is fitted
    columns: Array  # (columns, rows)
    rest: Array  # (rows,)
    first: Array  # (rows,), of the fit itself


@dataclass(frozen=True, eq=False)
class _Told:
    """-2 log evidence of a curve over a variable."""

    stretches: Array  # its likelihood's
    bend: float  # what of it is prior, and views that do not show the curve
    factor: float = 0.0  # Occam's

    def behind(self, other: _Told, doubt: float) -> float:
        """Rise from another one to here, that of the likelihood less its doubt."""
        rise = noise.doubted(self.stretches - other.stretches, doubt)
        return rise + self.bend - other.bend + self.factor - other.factor


@dataclass(frozen=True, eq=False)
class _Curve:
    """A curve of a fit, in the cells that show it; all but the curve may move beside it."""

    fitter: Fitter
    fit: Fit
    nodes: Sequence[str]
    cells: Sequence[Cell]
    columns: Mapping[Cell, Array]  # (nodes, rows, signals)
    known: Parabola  # of all else, by what these cells do not show

    @staticmethod
    def of(fitter: Fitter, fit: Fit, nodes: Sequence[str]) -> _Curve | None:
        """None where no cell shows it."""
        cells = [c for c in fit.residuals if all((c, n) in fit.columns for n in nodes)]
        cells = [c for c in cells if np.isfinite(fit.residuals[c]).all()]
        columns = {c: np.stack([fit.columns[c, n] for n in nodes]) for c in cells}
        cells = [c for c in cells if np.isfinite(columns[c]).all() and columns[c].any()]
        if not cells:
            return None
        columns = {c: columns[c] for c in cells}
        known = known_beside(fit.point.coordinates, fit, {c[0] for c in cells})
        rest = [n for n in known.names if n not in nodes]
        return _Curve(fitter, fit, nodes, cells, columns, known.of(rest, fit.point.theta))

    def behind(self) -> dict[str, float]:
        """Rise of -2 log evidence from the curve over its own variable to that over each other one,
        that of the likelihood less its doubt. None where the place on the curve is not told: over
        it the curve is not what it was.
        """
        places = self._places()
        ways = {r: _travelled(p) for r, p in places.items()}
        count, farthest = len(self.nodes), max(float(w[-1]) for w in ways.values())
        longest = round(farthest) + 1

        def over(variable: str, cell: Cell) -> _Basis:
            record, rows = cell[1], self.columns[cell].shape[1]
            if variable == "time":
                at = np.linspace(0.0, count - 1.0, rows)
                return {(record, k): h for k, h in enumerate(hats(at, count).T)}
            at, nodes = (places[record], count) if not variable else (ways[record], longest + 1)
            at = np.interp(np.linspace(0.0, 1.0, rows), np.linspace(0.0, 1.0, len(at)), at)
            return {("", k): h for k, h in enumerate(hats(at, nodes).T)}

        own = self._evidence({c: over("", c) for c in self.cells})
        rules, found = self.fitter.rules, dict[str, float]()
        if own.behind(self._itself(), rules.doubt) - own.factor > rules.hopeless:
            return found
        for name in OTHERS:
            other = self._evidence({c: over(name, c) for c in self.cells})
            found[name] = other.behind(own, rules.doubt)
        return found

    def _itself(self) -> _Told:
        """The same of the fit, without an Occam factor."""
        weighing, tails = Weighing(self.fit.noise, self.fitter.rules), self.fitter.rules.tails
        left = {c: weighing.of_residual(c, self.fit.residuals[c]) for c in self.cells}
        stretches = [self._by_stretch(c, noise.loss(e, tails)) for c, e in left.items()]
        point = zip(self.fit.point.coordinates, self.fit.point.theta, strict=True)
        at = {c.name: float(t) - c.none * (c.name in self.nodes) for c, t in point}
        rest, curve = (np.array([at[n] for n in own]) for own in (self.known.names, self.nodes))
        bend = self.known.cost(rest) + self._precision * float(curve @ curve)
        return _Told(np.concatenate(stretches), bend)

    @property
    def _precision(self) -> float:
        """Of the prior of a curve's nodes."""
        spreads = [c.spread for c in self.fit.point.coordinates if c.name in self.nodes]
        return float(np.mean(spreads)) ** -2.0

    def _places(self) -> dict[str, Array]:
        """Of each record the place on the curve (rows,), in nodes from the first one, by the cell
        that shows most of it.
        """
        shown: dict[str, tuple[float, Array]] = {}
        for (view, record), columns in self.columns.items():
            sizes = np.abs(columns) / np.array(self.fitter.simulation.views[view].sigmas)
            told = np.stack([_averaged(own) for own in sizes.sum(axis=2)])
            total = float(told.sum())
            if record not in shown or total > shown[record][0]:
                shown[record] = total, told
        return {record: _centre(told) for record, (_, told) in shown.items()}

    def _evidence(self, bases: Mapping[Cell, _Basis]) -> _Told:
        """With the curve over a basis in place of its own, as far as its columns and those of all
        else are straight.
        """
        tails, curve = self.fitter.rules.tails, _nodes(bases)
        precision, free = self._precision, len(self.known.names)
        square = np.diag(np.full(free + len(curve), precision))
        square[:free, :free] = self.known.square
        pull = np.concatenate([self.known.pull, np.zeros(len(curve))])
        lines = [self._line(c, bases[c], curve) for c in self.cells]
        left = [line.first for line in lines]
        theta, normal = np.zeros(len(pull)), square
        for _ in range(ROUNDS):
            weights = [noise.weights(e, tails) for e in left]
            normal, slope = square.copy(), -pull
            for line, w in zip(lines, weights, strict=True):
                normal[np.ix_(line.index, line.index)] += (line.columns * w) @ line.columns.T
                slope[line.index] += line.columns @ (line.rest * w)
            theta = -np.linalg.solve(normal, slope)
            left = [line.rest + theta[line.index] @ line.columns for line in lines]
        pairs = zip(self.cells, left, strict=True)
        stretches = [self._by_stretch(c, noise.loss(e, tails)) for c, e in pairs]
        bend = float(theta @ square @ theta - 2 * pull @ theta)
        factor = float(np.linalg.slogdet(normal)[1]) - len(curve) * math.log(precision)
        return _Told(np.concatenate(stretches), bend, factor)

    def _line(self, cell: Cell, basis: _Basis, curve: Sequence[tuple[str, int]]) -> _Line:
        """A cell without the curve, and all that moves it."""
        fit, names = self.fit, self.known.names
        at = {
            c.name: (c, float(t))
            for c, t in zip(fit.point.coordinates, fit.point.theta, strict=True)
        }
        own = [n for n in names if (cell, n) in fit.columns]
        moved = [fit.columns[cell, n] for n in own]
        size = np.array([at[n][1] - at[n][0].none for n in self.nodes])
        rest = fit.residuals[cell] - np.tensordot(size, self.columns[cell], 1)
        for n, m in zip(own, moved, strict=True):
            rest = rest - at[n][1] * m
        whole = self.columns[cell].sum(axis=0)
        moved += [h[:, None] * whole for h in basis.values()]
        index = [*map(names.index, own), *(len(names) + curve.index(k) for k in basis)]
        weighing = Weighing(fit.noise, self.fitter.rules)
        white = np.nan_to_num(weighing.innovations(cell, np.stack(moved)))
        first = weighing.of_residual(cell, fit.residuals[cell])
        return _Line(index, white, weighing.innovations(cell, rest), first)

    def _by_stretch(self, cell: Cell, terms: Array) -> Array:
        """Sums by stretch of a cell's record, of one signal after the other."""
        signals, noise_of = np.split(terms, self.columns[cell].shape[2]), self.fitter.noise
        return np.concatenate([noise_of.by_stretch(cell, s) for s in signals])


def _nodes(bases: Mapping[Cell, _Basis]) -> list[tuple[str, int]]:
    """Of all cells' curves, each once."""
    return list(dict.fromkeys(k for basis in bases.values() for k in basis))


def _averaged(values: Array) -> Array:
    """Means over `SMOOTH` rows about each of some values (rows,)."""
    return np.convolve(values, np.full(SMOOTH, 1 / SMOOTH), "same")


def _centre(told: Array) -> Array:
    """Place (rows,) of columns' sizes (nodes, rows); in between where they are none."""
    size = told.sum(axis=0)
    known = np.flatnonzero(size > LEAST * size.max())
    at = np.arange(len(told)) @ told[:, known] / size[known]
    return np.asarray(np.interp(np.arange(len(size)), known, at))


def _travelled(place: Array) -> Array:
    """Way (rows,) along the curve, in nodes."""
    steps = np.abs(np.diff(_averaged(np.pad(place, SMOOTH, "edge"))[SMOOTH:-SMOOTH]))
    return np.concatenate([[0.0], np.cumsum(steps)])
