"""Views over records: residuals of many parameter sets, and their derivatives.

A residual depends on few parameters, so it is kept by view and record (a cell).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from threading import Lock
from typing import TypeVar

import numpy as np

from pneugantry.engine.hypotheses.hypothesis import Coordinate
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.threads import Pooled, on_threads
from pneugantry.engine.views.view import View

__all__ = ["Cell", "Columns", "Point", "Residuals", "Simulation"]

SIDE_BY_SIDE = 8  # runs that the lanes of a part hold
MOST = 64  # runs of one call: their signals are in memory together
MANY = 32  # points about one, of which it is asked whether any changes anything
USUAL = 0.1  # a tolerance's spread, in an effect's usual sizes
Cell = tuple[str, str]  # view, record
_Job = tuple[Cell, Mapping[str, float]]  # a run
T = TypeVar("T")
Found = TypeVar("Found")
Residuals = dict[Cell, Array]  # (rows, signals), in the signals' units
Columns = dict[tuple[Cell, str], Array]  # d residual / d theta, by the coordinate's name


@dataclass(frozen=True, eq=False)
class Point:
    """Values of coordinates, and settings that are not fitted."""

    coordinates: tuple[Coordinate, ...]
    theta: Array
    settings: Mapping[str, float]

    def values(self, record: str | None) -> dict[str, float]:
        """Parameters of a record; None: those of no record in particular."""
        pairs = zip(self.coordinates, self._values, strict=True)
        own = {c.parameter: value for c, value in pairs if c.record in (None, record)}
        return {**self.settings, **own}

    @cached_property
    def _values(self) -> list[float]:
        """Of each coordinate."""
        return [c.value(t) for c, t in zip(self.coordinates, self.theta.tolist(), strict=True)]

    def moved(self, theta: Array) -> Point:
        """The same with other values."""
        return Point(self.coordinates, theta, self.settings)


@dataclass(frozen=True)
class _Step:
    """Of a difference quotient."""

    name: str  # of the coordinate
    parameter: str
    value: float
    step: float  # in theta
    still: bool  # it changed nothing the last time

    def of(self, values: Mapping[str, float]) -> dict[str, float]:
        """Parameters with this one moved."""
        return {**values, self.parameter: self.value}


class Simulation:
    """Runs views on threads of its own. Threads may share it: what several of them ask of one view
    meanwhile is simulated in one call, for a lane costs the same whether or not it is used.
    """

    def __init__(self, views: Sequence[View], records: Sequence[Record], rules: Rules) -> None:
        self.views = {v.name: v for v in views}
        self.records = {r.name: r for r in records}
        self.cells = [(v.name, r.name) for v in views for r in records if v.shows(r)]
        self.rules = rules
        self.seconds = 0.0  # of records, for which runs have been asked so far
        self._counting = Lock()
        self._still: dict[Cell, frozenset[str]] = {}  # coordinates that changed nothing, last
        self._pooled: Pooled[str, _Job, Array] = Pooled(self._residuals, SIDE_BY_SIDE, MOST)

    def close(self) -> None:
        self._pooled.close()

    def side_by_side(self, call: Callable[[T], Found], values: Sequence[T]) -> list[Found]:
        """What a call makes of each value, in their order; their simulations are done together."""
        return self._pooled.side_by_side(call, values)

    @property
    def evaluations(self) -> float:
        """How often one view could have been simulated over all records by now."""
        return self.seconds / sum(r.rows * r.period for r in self.records.values())

    def prepare(self, fits: Sequence[tuple[Collection[str], Mapping[str, float]]]) -> None:
        """Tells the views what fits move, and which settings they keep."""
        of_records = {n for r in self.records.values() for n in r.parameters}

        def tell(view: View, moving: Collection[str], settings: Mapping[str, float]) -> None:
            view.prepare({*moving, *of_records}, settings)

        told = [(v, *fit) for fit in fits for v in self.views.values()]
        on_threads(lambda each: tell(*each), told)

    def reads(self, parameter: str, record: str | None = None) -> bool:
        """Whether any view reads a parameter, in a record or at all."""
        return any(
            self.views[v].depends_on(parameter) for v, r in self.cells if record in (None, r)
        )

    def run(self, jobs: Mapping[Cell, Sequence[Mapping[str, float]]]) -> dict[Cell, list[Array]]:
        """Residuals (rows, signals) of each cell's runs."""
        self._count([(cell, values) for cell, own in jobs.items() for values in own])
        return self.simulated(jobs)

    def simulated(
        self, jobs: Mapping[Cell, Sequence[Mapping[str, float]]]
    ) -> dict[Cell, list[Array]]:
        """The same, uncounted."""
        every = [(cell, values) for cell, own in jobs.items() for values in own]
        made = self._pooled.run([(job[0][0], job) for job in every])
        found: dict[Cell, list[Array]] = {}
        for (cell, _), residual in zip(every, made, strict=True):
            found.setdefault(cell, []).append(residual)
        return found

    def _residuals(self, view: str, jobs: Sequence[_Job]) -> list[Array]:
        return self.views[view].residuals([(self.records[c[1]], values) for c, values in jobs])

    def about(
        self, asked: Sequence[tuple[Cell, Sequence[Mapping[str, float]]]]
    ) -> list[list[Array]]:
        """Residuals of cells at points, the first one of each cell's and others that each move some
        of its parameters. Where these are many, every other one is moved at once before, and the
        rest: where neither changes anything, none of them does. (All at once may: a curve that
        counts from its own mean.)
        """
        self._count([(cell, values) for cell, points in asked for values in points])
        many = [i for i, (_, points) in enumerate(asked) if len(points) > MANY]
        ends = self._listed([(asked[i][0], _ends(asked[i][1])) for i in many])
        idle = {
            i: at
            for i, (at, *halves) in zip(many, ends, strict=True)
            if all(np.array_equal(at, half) for half in halves)
        }
        rest = [own for i, own in enumerate(asked) if i not in idle]
        made = iter(self._listed(rest))
        return [
            [idle[i]] * len(points) if i in idle else next(made)
            for i, (_, points) in enumerate(asked)
        ]

    def _listed(
        self, asked: Sequence[tuple[Cell, Sequence[Mapping[str, float]]]]
    ) -> list[list[Array]]:
        """Residuals of each cell's points; a cell may be there several times."""
        jobs: dict[Cell, list[Mapping[str, float]]] = {}
        for cell, points in asked:
            jobs.setdefault(cell, []).extend(points)
        found = {cell: iter(runs) for cell, runs in self.simulated(jobs).items()}
        return [[next(found[cell]) for _ in points] for cell, points in asked]

    def _count(self, jobs: Sequence[_Job]) -> None:
        """Adds the seconds of records that runs go over."""
        records = (self.records[cell[1]] for cell, _ in jobs)
        with self._counting:
            self.seconds += sum(r.rows * r.period for r in records)

    def residuals(self, point: Point, cells: Sequence[Cell]) -> Residuals:
        """At a point."""
        return {c: r[0] for c, r in self.run({c: [point.values(c[1])] for c in cells}).items()}

    def linearised(
        self, point: Point, cells: Sequence[Cell], wanted: set[str], fine: bool = True
    ) -> tuple[Residuals, Columns]:
        """Residuals and columns at a point."""
        found = self.run({cell: [point.values(cell[1])] for cell in cells})
        residuals = {cell: r[0] for cell, r in found.items()}
        return residuals, self.columns(point, residuals, cells, wanted, fine)

    def columns(
        self,
        point: Point,
        residuals: Residuals,
        cells: Sequence[Cell],
        wanted: set[str],
        fine: bool = True,
    ) -> Columns:
        """Columns of the coordinates named, about the residuals at a point. fine: by small steps;
        else by such as look over events, where a view has any. What changed nothing in a cell the
        last time is moved together there: where that changes nothing, none of it does.
        """
        at = {cell: point.values(cell[1]) for cell in cells}
        moved = {cell: self._steps(point, cell, wanted, fine) for cell in cells}
        self._count([(cell, at[cell]) for cell, steps in moved.items() for _ in steps])
        still = {cell: [s for s in own if s.still] for cell, own in moved.items()}
        jobs = {cell: [s.of(at[cell]) for s in own if not s.still] for cell, own in moved.items()}
        for cell, own in still.items():
            if own:
                jobs[cell].append({**at[cell], **{s.parameter: s.value for s in own}})
        found = self.simulated(jobs)
        idle = {c for c, own in still.items() if own and np.array_equal(found[c][-1], residuals[c])}
        alone = self.simulated({c: [s.of(at[c]) for s in still[c]] for c in cells if c not in idle})
        columns: Columns = {}
        for cell, steps in moved.items():
            runs, again = iter(found.get(cell, ())), iter(alone.get(cell, ()))
            for s in steps:
                if s.still and cell in idle:
                    columns[cell, s.name] = np.zeros_like(residuals[cell])
                else:
                    run = next(again if s.still else runs)
                    columns[cell, s.name] = (run - residuals[cell]) / s.step
            told = {s.name for s in steps}
            nothing = {n for n in told if not columns[cell, n].any()}
            self._still[cell] = (self._still.get(cell, frozenset()) - told) | nothing
        return columns

    def _steps(self, point: Point, cell: Cell, wanted: set[str], fine: bool) -> list[_Step]:
        """Of the coordinates of a cell among those that are wanted."""
        fine, still = fine or not self.views[cell[0]].remembers, self._still.get(cell, frozenset())
        found = []
        for c, theta in zip(point.coordinates, point.theta, strict=True):
            if c.name in wanted and self.in_cell(c, cell):
                step = self.step(c, theta, fine)
                value = c.value(theta + step)
                found.append(_Step(c.name, c.parameter, value, step, c.name in still))
        return found

    def step(self, c: Coordinate, theta: float, fine: bool) -> float:
        """Step of a difference quotient, away from a bound."""
        if fine:
            size = self.rules.difference * self.rules.fine * (USUAL if c.effect else 1.0)
        else:
            size = self.rules.stride if c.effect else self.rules.difference
        return size if c.value(theta + size) != c.value(theta) else -size

    def misfit(self, cell: Cell, residual: Array) -> float:
        """Sum of squares of a cell's residual (rows, signals), in the noise quoted of each."""
        return float(np.nansum((residual / np.asarray(self.views[cell[0]].sigmas)) ** 2))

    def worst_met(self, cells: Sequence[Cell], residuals: Mapping[Cell, Array]) -> Cell:
        """Of some cells the one whose record is met worst."""
        return max(cells, key=lambda c: self.misfit(c, residuals[c]))

    def in_cell(self, c: Coordinate, cell: Cell) -> bool:
        """Whether a cell reads a coordinate."""
        return c.record in (None, cell[1]) and self.views[cell[0]].depends_on(c.parameter)


def _ends(points: Sequence[Mapping[str, float]]) -> list[Mapping[str, float]]:
    """The first of some points, and two with what every other one of the rest moves in it."""
    first = points[0]
    halves = (points[1::2], points[2::2])
    moved = ({k: v for p in half for k, v in p.items() if v != first[k]} for half in halves)
    return [first, *({**first, **own} for own in moved)]
