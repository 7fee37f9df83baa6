"""Which equation lacks a term, and of what variable: every pair of both is tried, as a smooth curve
beside all that was fitted. What a pair foretells of logs that its curve has not seen counts.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pneugantry.engine.fitter import Fit
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.simulation import Cell
from pneugantry.learn.curve import BENDS, SIZES, Basis, Wave, knots_over
from pneugantry.learn.linear import Answer, Stats, base_of, solved
from pneugantry.learn.points import Opened, Point
from pneugantry.learn.regressors import TIME, Regressor, regressors_of
from pneugantry.learn.waves import periods_of

__all__ = ["Candidate", "Screen", "screened"]

WAVE = 9.0  # rad/s, of the term that probes an equation
FIRST = 1e-3  # its size at first
PROBES = 3
LINES = np.arange(3.0, 130.0, 0.5)  # periods in the covered range
PATIENCE = 20.0  # s, for the lines of one variable
ALIKE = 0.999  # cosine of the answers to one term from which on two equations are one


@dataclass(frozen=True, eq=False)
class Candidate:
    """A curve of a variable in an equation."""

    point: Point
    regressor: Regressor
    basis: Basis
    answer: Answer  # coefficients of the curve, in the addend's unit
    gain: float  # of -2 log density of logs left out
    unit: float  # of the addend: the size that changes residuals by one noise level
    size: float  # of the curve's prior, in the addend's unit
    bend: float  # of its bending, see `Knots.prior`
    alike: tuple[Point, ...] = ()  # equations whose addend does the same


@dataclass(frozen=True, eq=False)
class Screen:
    """All that was tried, the best first."""

    fit: Fit
    candidates: tuple[Candidate, ...]
    series: Mapping[Regressor, Mapping[str, Array]]  # by record
    tried: int = 0  # curves


def screened(
    opened: Opened,
    fit: Fit,
    records: Sequence[Record],
    rules: Rules,
    views: Collection[str] | None = None,
) -> Screen:
    """Every equation with every variable of its component, and time. records: those of the fit.
    views: only equations that reach one of these; None: all.
    """
    return _Screening(opened, fit, records, rules).run(views)


@dataclass(frozen=True, eq=False)
class _Group:
    """Equations whose addends do the same."""

    points: list[Point]
    cells: tuple[Cell, ...]
    answer: Array  # to a slow wave, of length 1
    unit: float
    seconds: float  # of one answer


@dataclass(eq=False)
class _Screening:
    opened: Opened
    fit: Fit
    records: Sequence[Record]
    rules: Rules
    _zero: dict[Cell, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.base = base_of(self.fit, self.rules)
        self.values = {r.name: self.fit.values(r.name) for r in self.records}
        self.quiet = {r.name: self.opened.quiet(r) for r in self.records}
        self.plain = self._cost(self.base.stats({}, 0), np.zeros((0, 0)))

    def run(self, views: Collection[str] | None) -> Screen:
        groups = self._groups(views)
        wanted = {g.points[0]: self.opened.variables(g.points[0]) for g in groups}
        series = regressors_of(self.opened, wanted, self.records, self.values)
        found, tried = [], 0
        for group in groups:
            for regressor, values in series.items():
                if not regressor.within(group.points[0]):
                    continue
                for basis in self._bases(group, regressor, values):
                    found.append(self._candidate(group, regressor, basis, values))
                    tried += 1
        return Screen(self.fit, tuple(sorted(found, key=lambda c: -c.gain)), series, tried)

    def _bases(
        self, group: _Group, regressor: Regressor, values: Mapping[str, Array]
    ) -> list[Basis]:
        """A curve; and waves of time whose period stands out of the residuals' spectrum."""
        knots = knots_over(np.concatenate(list(values.values())))
        if knots is None:
            return []
        if regressor.name == TIME:
            periods = periods_of(self.fit, group.cells, self.opened.period_of)
        else:
            periods = self._lines(group, regressor, values)
        return [knots, *(Wave(p) for p in periods)]

    def _lines(
        self, group: _Group, regressor: Regressor, values: Mapping[str, Array]
    ) -> list[float]:
        """The period of a state along which residuals repeat most, many of which lie in the range;
        none where trying them would take too long.
        """
        roots, states = self.opened.shape.roots, self.opened.shape.states
        if roots.get(regressor.label) not in states or 2 * len(LINES) * group.seconds > PATIENCE:
            return []
        low, high = np.quantile(np.concatenate(list(values.values())), (0.005, 0.995))
        waves = [Wave(float(high - low) / k) for k in LINES]
        shapes = {r: np.column_stack([w.shapes(v) for w in waves]) for r, v in values.items()}
        answers = self.responses(group.points[0], shapes, group.unit)
        power = np.zeros(len(LINES))
        for k in range(len(LINES)):
            pair = [
                np.stack([self.base.whitened(c, a[i]) for i in (2 * k, 2 * k + 1)], axis=1)
                for c, a in answers.items()
            ]
            j = np.concatenate(pair)
            r = np.concatenate([self.base.white[c] for c in answers])
            pull = j.T @ r
            power[k] = pull @ np.linalg.solve(j.T @ j + 1e-12 * np.eye(2), pull)
        return [waves[int(np.argmax(power))].period]

    def _groups(self, views: Collection[str] | None) -> list[_Group]:
        """Equations that residuals answer to, those that answer alike together."""
        groups: list[_Group] = []
        for point in self.opened.points:
            reached = {v.name for v in self.opened.readers(point)}
            if views is not None and not reached & set(views):
                continue  # no need to simulate
            began = time.process_time()
            answers, unit = self._probe(point)
            seconds = (time.process_time() - began) / PROBES
            if unit == 0.0:
                continue
            cells = tuple(c for c in sorted(answers) if np.any(answers[c]))
            if views is not None and not {c[0] for c in cells} & set(views):
                continue
            whole = np.concatenate([self.base.whitened(c, answers[c]) for c in cells])
            whole = whole / np.linalg.norm(whole)
            for group in groups:
                if cells == group.cells and abs(float(whole @ group.answer)) > ALIKE:
                    group.points.append(point)
                    break
            else:
                groups.append(_Group([point], cells, whole, unit, seconds))
        return groups

    def _probe(self, point: Point) -> tuple[dict[Cell, Array], float]:
        """Answers to a slow wave, and the size that changes residuals by one noise level; 0 where
        nothing answers.
        """
        waves = {r.name: np.sin(WAVE * np.arange(r.rows) * r.period) for r in self.records}
        columns = {n: w[:, None] for n, w in waves.items()}
        size, found = FIRST, dict[Cell, Array]()
        for _ in range(PROBES):
            found = {c: r[0] for c, r in self.responses(point, columns, size).items()}
            told = [self.base.whitened(c, r) for c, r in found.items()]
            rms = max((float(np.sqrt(np.mean(t**2))) for t in told), default=0.0)
            if not 0.0 < rms < np.inf:
                return found, 0.0
            size = 1 / rms
        return found, size

    def responses(
        self, point: Point, shapes: Mapping[str, Array], size: float
    ) -> dict[Cell, Array]:
        """Changes of the residuals (shapes, rows, signals) per addend of each shape (rows, shapes)
        by record; size: of the addend that is simulated.
        """
        found = {}
        for view in self.opened.readers(point):
            for record in self.records:
                cell = (view.name, record.name)
                if cell not in self.base.white:
                    continue
                quiet, own = self.quiet[record.name], self.values[record.name]
                if cell not in self._zero:
                    self._zero[cell] = view.answers(quiet, own, [{}])[0]
                fed = [{point.variable: size * s} for s in shapes[record.name].T]
                found[cell] = (view.answers(quiet, own, fed) - self._zero[cell]) / size
        return found

    def _candidate(
        self, group: _Group, regressor: Regressor, basis: Basis, values: Mapping[str, Array]
    ) -> Candidate:
        point, unit = group.points[0], group.unit
        shapes = {r: basis.shapes(v) for r, v in values.items()}
        width = next(iter(shapes.values())).shape[1]
        columns = self.responses(point, shapes, unit)
        stats = self.base.stats(columns, width)
        tried = [(unit * size, bend) for size in SIZES for bend in BENDS]
        answers = [solved(self.base, stats.values(), basis.prior(*t)) for t in tried]
        best = int(np.argmin([a.cost for a in answers]))
        gain = self.plain - self._cost(stats, basis.prior(*tried[best]))
        rest = tuple(group.points[1:])
        return Candidate(point, regressor, basis, answers[best], gain, unit, *tried[best], rest)

    def _cost(self, stats: Mapping[str, Stats], prior: Array) -> float:
        """-2 log density of each fold as foretold by the others, summed."""
        whole = solved(self.base, stats.values(), prior).cost
        rest = [
            solved(self.base, [s for n, s in stats.items() if n != fold], prior).cost
            for fold in stats
        ]
        return sum(whole - r for r in rest)
