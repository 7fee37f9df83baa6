"""Which equation lacks a term, and of what variable: every pair of both is tried, as a smooth curve
beside all that was fitted. What a pair foretells of logs that its curve has not seen counts.

How the residuals reply to an addend is simulated once for each equation (see `reply`); variables,
curves and waves are then linear algebra.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pneugantry.engine.fitter import Fit
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.simulation import Cell
from pneugantry.learn.curve import SIZES, Basis, Wave, finer, knots_over
from pneugantry.learn.linear import Answer, Base, Stats, base_of, solved
from pneugantry.learn.points import Opened, OpenedView, Point
from pneugantry.learn.regressors import TIME, Regressor, regressors_of
from pneugantry.learn.reply import Pulses, Reply, blocks_of, means, reply_of
from pneugantry.learn.waves import periods_of

__all__ = ["Candidate", "Screen", "screened"]

WAVE = 9.0  # rad/s, of the term that probes an equation
FIRST = 1e-3  # its size at first
PROBES = 3
NEAR = 5.0  # factor by which its answer may miss one noise level
PULSE = 10.0  # size of a first pulse, in units of the wave's
PULSES = 24  # simulations of a record for an equation's reply, at most
PATIENCE = 0.4  # s of one core, for the same
FEWEST = 3.0  # periods in the covered range, of a wave along a variable
LINES = 400  # such periods, at most
RESOLVED = 4.0  # blocks in a period, at least
FINE = 0.05  # step of the number of periods about the best one
ALIKE = 0.999  # cosine of the answers to one term from which on two equations are one
PAIRS = 256  # waves that are tried at once


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
    bend: float  # its further parameter, see `Basis.bends`
    base: Base  # what it was tried beside
    columns: Mapping[Cell, Array]  # of its coefficients, whitened
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
    seconds: float  # of one simulation


@dataclass(frozen=True, eq=False)
class _Course:
    """A regressor over the records."""

    values: Mapping[str, Array]
    signs: Mapping[str, Array] | None  # by which its term is multiplied

    def shapes(self, *bases: Basis) -> dict[str, Array]:
        """Shapes (rows, n) of each record."""
        found = {r: np.column_stack([b.shapes(v) for b in bases]) for r, v in self.values.items()}
        signs = self.signs
        return found if signs is None else {r: s * signs[r][:, None] for r, s in found.items()}


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
        self.views = {v.name: v for v in self.opened.views}
        self.of_name = {r.name: r for r in self.records}
        self.plain = self._cost(self.base.stats({}, 0), np.zeros((0, 0)))

    def run(self, views: Collection[str] | None) -> Screen:
        groups = self._groups(views)
        wanted = {g.points[0]: self.opened.variables(g.points[0]) for g in groups}
        series = regressors_of(self.opened, wanted, self.records, self.values)
        found: list[Candidate] = []
        for group in groups:
            replies = {c: self._reply(group, c) for c in group.cells}
            known = {c: r for c, r in replies.items() if r is not None}
            if not known:
                continue
            for regressor, values in series.items():
                if regressor.within(group.points[0]):
                    signs = regressor.signs(series)
                    found += self._of_pair(group, known, regressor, _Course(values, signs))
        ordered = tuple(sorted(found, key=lambda c: -c.gain))
        return Screen(self.fit, ordered, series, len(found))

    # -- equations

    def _groups(self, views: Collection[str] | None) -> list[_Group]:
        """Equations that residuals answer to, those that answer alike together."""
        groups: list[_Group] = []
        for point in self.opened.points:
            reached = {v.name for v in self.opened.readers(point)}
            if views is not None and not reached & set(views):
                continue  # no need to simulate
            group = self._probed(point)
            if group is None or (views is not None and not {c[0] for c in group.cells} & {*views}):
                continue
            for other in groups:
                same = group.cells == other.cells and len(group.answer) == len(other.answer)
                if same and abs(float(group.answer @ other.answer)) > ALIKE:
                    other.points.append(point)
                    break
            else:
                groups.append(group)
        return groups

    def _probed(self, point: Point) -> _Group | None:
        """An equation's answer to a slow wave in the first record that answers, the one with the
        largest residuals first.
        """
        sizes = {
            r.name: sum(float(w @ w) for c, w in self.base.white.items() if c[1] == r.name)
            for r in self.records
        }
        for record in sorted(self.records, key=lambda r: -sizes[r.name]):
            began = time.process_time()
            cells, answer, unit, runs = self._probe(point, record)
            seconds = (time.process_time() - began) / max(runs, 1)
            if unit > 0:
                names = {c[0] for c in cells}
                every = tuple(c for c in sorted(self.base.white) if c[0] in names)
                return _Group([point], every, answer, unit, seconds)
        return None

    def _probe(self, point: Point, record: Record) -> tuple[list[Cell], Array, float, int]:
        """Cells that answer, their answers one behind the other (of length 1), the size that
        changes them by one noise level (0: nothing answers), and how many runs that took.
        """
        wave = np.sin(WAVE * np.arange(record.rows) * record.period)
        views = [v for v in self.opened.readers(point) if (v.name, record.name) in self.base.white]
        size, runs = FIRST, 0
        for _ in range(PROBES):
            told: dict[Cell, Array] = {}
            for view in views:
                cell = (view.name, record.name)
                change = self._answers(view, record, point)([size * wave])[0]
                told[cell] = self.base.whitened(cell, change)
                runs += 1
            rms = max((float(np.sqrt(np.mean(t**2))) for t in told.values()), default=0.0)
            if not 0.0 < rms < np.inf:
                return [], np.zeros(0), 0.0, runs
            if 1 / NEAR < rms < NEAR:
                break
            size /= rms
        cells = sorted(c for c in told if np.any(told[c]))
        whole = np.concatenate([told[c] for c in cells])
        return cells, whole / np.linalg.norm(whole), size / rms, runs

    def _answers(
        self, view: OpenedView, record: Record, point: Point
    ) -> Callable[[Sequence[Array]], Array]:
        """Changes of a view's residual (n, rows, signals) with series of an addend."""
        quiet, own, cell = (
            self.quiet[record.name],
            self.values[record.name],
            (view.name, record.name),
        )
        if cell not in self._zero:
            self._zero[cell] = view.answers(quiet, own, [{}])[0]

        def answer(series: Sequence[Array]) -> Array:
            fed = [{point.variable: s} for s in series]
            return np.asarray(view.answers(quiet, own, fed) - self._zero[cell])

        return answer

    def _reply(self, group: _Group, cell: Cell) -> Reply | None:
        view, record = self.views[cell[0]], self.of_name[cell[1]]
        block = blocks_of(view, record)
        height = record.rows // view.decimation
        sigma = np.array([w.sigma for w in self.base.weighing.noise[cell]])
        most = int(np.clip(PATIENCE / max(group.seconds, 1e-6), 3, PULSES))
        pulses = Pulses(cell, record.rows, height, block, block // view.decimation, sigma, most)
        answer = self._answers(view, record, group.points[0])
        return reply_of(pulses, answer, PULSE * group.unit)

    # -- variables

    def _of_pair(
        self,
        group: _Group,
        replies: Mapping[Cell, Reply],
        regressor: Regressor,
        course: _Course,
    ) -> list[Candidate]:
        """Curves of a variable in an equation: smooth, with narrow features, and waves."""
        knots = knots_over(np.concatenate(list(course.values.values())))
        if knots is None:
            return []
        bases: list[Basis] = [knots, finer(knots)]
        if regressor.name == TIME:
            periods = periods_of(self.fit, group.cells, self.opened.period_of)
        else:
            periods = [] if course.signs else self._lines(replies, course)
        bases += [Wave(p) for p in periods]
        return [self._candidate(group, replies, regressor, b, course) for b in bases]

    def _columns(
        self, replies: Mapping[Cell, Reply], shapes: Mapping[str, Array]
    ) -> dict[Cell, Array]:
        """Whitened replies to shapes (rows, n) of each record."""
        return {
            c: self.base.whitened_all(c, reply.to(shapes[c[1]])) for c, reply in replies.items()
        }

    def _lines(self, replies: Mapping[Cell, Reply], course: _Course) -> list[float]:
        """The period of a variable along which residuals repeat most, many of which lie in its
        range; it is one that blocks of rows resolve.
        """
        values = list(course.values.values())
        low, high = np.quantile(np.concatenate(values), (0.005, 0.995))
        block = next(iter(replies.values())).block
        moved = [np.abs(np.diff(means(v, block)[:, 0])) for v in values]
        step = float(np.median(np.concatenate(moved)))
        span = float(high - low)
        most = min(LINES, span / max(RESOLVED * step, 1e-12))
        if most <= FEWEST:
            return []
        rough = np.arange(FEWEST, most, 0.5)
        best = float(rough[np.argmax(self._powers(replies, course, span / rough))])
        near = np.arange(best - 0.5, best + 0.5 + FINE, FINE)
        return [span / float(near[np.argmax(self._powers(replies, course, span / near))])]

    def _powers(self, replies: Mapping[Cell, Reply], course: _Course, periods: Array) -> Array:
        """Falls of the squares of residuals with a wave of each period."""
        found: list[float] = []
        for start in range(0, len(periods), PAIRS):
            waves = [Wave(float(p)) for p in periods[start : start + PAIRS]]
            columns = self._columns(replies, course.shapes(*waves))
            j = np.concatenate([columns[c] for c in columns])
            r = np.concatenate([self.base.white[c] for c in columns])
            for k in range(len(waves)):
                pair = j[:, 2 * k : 2 * k + 2]
                pull = pair.T @ r
                found.append(float(pull @ np.linalg.solve(pair.T @ pair + 1e-12 * np.eye(2), pull)))
        return np.array(found)

    def _candidate(
        self,
        group: _Group,
        replies: Mapping[Cell, Reply],
        regressor: Regressor,
        basis: Basis,
        course: _Course,
    ) -> Candidate:
        point, unit = group.points[0], group.unit
        shapes = course.shapes(basis)
        width = next(iter(shapes.values())).shape[1]
        columns = self._columns(replies, shapes)
        stats = self.base.stats(columns, width)
        tried = [(unit * size, bend) for size in SIZES for bend in basis.bends]
        answers = [solved(self.base, stats.values(), basis.prior(*t)) for t in tried]
        best = int(np.argmin([a.cost for a in answers]))
        gain = self.plain - self._cost(stats, basis.prior(*tried[best]))
        return Candidate(
            point,
            regressor,
            basis,
            answers[best],
            gain,
            unit,
            *tried[best],
            base=self.base,
            columns=columns,
            alike=tuple(group.points[1:]),
        )

    def _cost(self, stats: Mapping[str, Stats], prior: Array) -> float:
        """-2 log density of each fold as foretold by the others, summed."""
        whole = solved(self.base, stats.values(), prior).cost
        rest = [
            solved(self.base, [s for n, s in stats.items() if n != fold], prior).cost
            for fold in stats
        ]
        return sum(whole - r for r in rest)
