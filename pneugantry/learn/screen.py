"""Which equation lacks a term, and of what variable: every pair of both is tried, as a smooth curve
beside all that was fitted. What a pair foretells of logs that its curve has not seen counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pneugantry.engine.fitter import Fit
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.simulation import Cell
from pneugantry.learn.curve import BENDS, SIZES, Knots, knots_over
from pneugantry.learn.linear import Answer, Stats, base_of, solved
from pneugantry.learn.points import Opened, Point

__all__ = ["Candidate", "Screen", "screened"]

WAVE = 9.0  # rad/s, of the term that probes an equation
FIRST = 1e-3  # its size at first
ALIKE = 0.999  # cosine of the answers to one term from which on two equations are one
TIME = "time"


@dataclass(frozen=True, eq=False)
class Candidate:
    """A curve of a variable in an equation."""

    point: Point
    regressor: str  # variable of the component, or time
    knots: Knots
    answer: Answer  # coefficients: values of the curve at the knots, in the addend's unit
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
    series: Mapping[str, Mapping[str, Array]]  # of the variables, by name and record


def screened(opened: Opened, fit: Fit, records: Sequence[Record], rules: Rules) -> Screen:
    """Every equation with every variable of its component, and time. records: those of the fit."""
    return _Screening(opened, fit, records, rules).run()


class _Screening:
    def __init__(self, opened: Opened, fit: Fit, records: Sequence[Record], rules: Rules) -> None:
        self.opened, self.fit = opened, fit
        self.records = {r.name: r for r in records}
        self.base = base_of(fit, rules)
        self.values = {r.name: fit.values(r.name) for r in records}
        self._zero: dict[Cell, Array] = {}
        self._runs = 0

    def run(self) -> Screen:
        groups = self._groups()
        names = sorted({n for points, _ in groups for n in self.opened.variables(points[0])})
        made = self.opened.series(names, list(self.records.values()), self.values)
        series = {n: {r: made[r][:, i] for r in made} for i, n in enumerate(names)}
        series[TIME] = {
            n: np.asarray(np.arange(r.rows) * r.period) for n, r in self.records.items()
        }
        plain = self._cost(self.base.stats({}, 0), np.zeros((0, 0)))
        found = []
        for points, unit in groups:
            for name in (*self.opened.variables(points[0]), TIME):
                one = self._candidate(points, unit, name, series[name], plain)
                if one is not None:
                    found.append(one)
        return Screen(self.fit, tuple(sorted(found, key=lambda c: -c.gain)), series)

    def _groups(self) -> list[tuple[tuple[Point, ...], float]]:
        """Equations that residuals answer to, those that answer alike together, and the size of
        an addend that shows.
        """
        groups: list[tuple[list[Point], tuple[Cell, ...], Array, float]] = []
        for point in self.opened.points:
            answers, unit = self._probe(point)
            if unit == 0.0:
                continue
            cells = tuple(sorted(answers))
            whole = np.concatenate([self.base.whitened(c, answers[c]) for c in cells])
            whole = whole / np.linalg.norm(whole)
            for members, others, other, _ in groups:
                if cells == others and abs(float(whole @ other)) > ALIKE:
                    members.append(point)
                    break
            else:
                groups.append(([point], cells, whole, unit))
        return [(tuple(members), unit) for members, _, _, unit in groups]

    def _probe(self, point: Point) -> tuple[dict[Cell, Array], float]:
        """Answers to a slow wave, and the size that changes residuals by one noise level; 0 where
        nothing answers.
        """
        waves = {n: np.sin(WAVE * np.arange(r.rows) * r.period) for n, r in self.records.items()}
        size, found = FIRST, dict[Cell, Array]()
        for _ in range(3):
            found = self.responses(point, waves, size)
            told = [self.base.whitened(c, r) for c, r in found.items()]
            rms = max((float(np.sqrt(np.mean(t**2))) for t in told), default=0.0)
            if rms <= 0.0:
                return found, 0.0
            size = 1 / rms
        return found, size

    def responses(
        self, point: Point, series: Mapping[str, Array], size: float
    ) -> dict[Cell, Array]:
        """Change of the residuals per addend of a series (by record); size: of the addend that is
        simulated.
        """
        found = {}
        self._runs += 1
        for view in self.opened.readers(point):
            for name, record in self.records.items():
                cell = (view.name, name)
                if cell not in self.base.white:
                    continue
                own = [self.values[name]]
                if cell not in self._zero:
                    quiet = self.opened.fed(record, {}, name)
                    self._zero[cell] = view.residuals(quiet, own)[0]
                fed = {point.variable: size * series[name]}
                moved = self.opened.fed(record, fed, f"{name} {self._runs}")
                found[cell] = (view.residuals(moved, own)[0] - self._zero[cell]) / size
        return found

    def _candidate(
        self,
        points: tuple[Point, ...],
        unit: float,
        name: str,
        series: Mapping[str, Array],
        plain: float,
    ) -> Candidate | None:
        knots = knots_over(np.concatenate(list(series.values())))
        if knots is None:
            return None
        hats = {r: knots.hats(v) for r, v in series.items()}
        columns: dict[Cell, list[Array]] = {}
        for k in range(len(knots.at)):
            one = self.responses(points[0], {r: h[:, k] for r, h in hats.items()}, unit)
            for cell, response in one.items():
                columns.setdefault(cell, []).append(response)
        stats = self.base.stats(columns, len(knots.at))
        tried = [(unit * size, bend) for size in SIZES for bend in BENDS]
        answers = [solved(self.base, stats.values(), knots.prior(*t)) for t in tried]
        best = int(np.argmin([a.cost for a in answers]))
        gain = plain - self._cost(stats, knots.prior(*tried[best]))
        size, bend = tried[best]
        return Candidate(points[0], name, knots, answers[best], gain, unit, size, bend, points[1:])

    def _cost(self, stats: Mapping[str, Stats], prior: Array) -> float:
        """-2 log density of each fold as foretold by the others, summed."""
        whole = solved(self.base, stats.values(), prior).cost
        rest = [
            solved(self.base, [s for n, s in stats.items() if n != fold], prior).cost
            for fold in stats
        ]
        return sum(whole - r for r in rest)
