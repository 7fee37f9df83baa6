"""Views over records: residuals of many parameter sets, and their derivatives.

A residual depends on few parameters, so it is kept by view and record (a cell).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

from pneugantry.engine.hypothesis import Coordinate
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.threads import THREADS
from pneugantry.engine.views import View

__all__ = ["Cell", "Columns", "Point", "Residuals", "Simulation"]

SHARES = 4  # of a view's runs, so that the threads end together
SHARE = 8  # runs at least: as many are simulated side by side
MOST = 64  # runs of one call: their signals are in memory together
USUAL = 0.1  # a tolerance's spread, in an effect's usual sizes
Cell = tuple[str, str]  # view, record
_Job = tuple[Cell, Mapping[str, float]]  # a run
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


class Simulation:
    """Runs views on threads of its own."""

    def __init__(self, views: Sequence[View], records: Sequence[Record], rules: Rules) -> None:
        self.views = {v.name: v for v in views}
        self.records = {r.name: r for r in records}
        self.cells = [(v.name, r.name) for v in views for r in records if v.shows(r)]
        self.rules = rules
        self.seconds = 0.0  # of records, simulated so far
        self._pool = ThreadPoolExecutor(THREADS)

    def close(self) -> None:
        self._pool.shutdown()

    def prepare(self, fits: Sequence[tuple[Collection[str], Mapping[str, float]]]) -> None:
        """Tells the views what fits move, and which settings they keep."""
        of_records = {n for r in self.records.values() for n in r.parameters}

        def tell(view: View, moving: Collection[str], settings: Mapping[str, float]) -> None:
            view.prepare({*moving, *of_records}, settings)

        told = [self._pool.submit(tell, v, *fit) for fit in fits for v in self.views.values()]
        for done in told:
            done.result()

    def reads(self, parameter: str, record: str | None = None) -> bool:
        """Whether any view reads a parameter, in a record or at all."""
        return any(
            self.views[v].depends_on(parameter) for v, r in self.cells if record in (None, r)
        )

    def run(self, jobs: Mapping[Cell, Sequence[Mapping[str, float]]]) -> dict[Cell, list[Array]]:
        """Residuals (rows, signals) of each cell's runs."""

        def one(share: list[_Job]) -> list[Array]:
            view = self.views[share[0][0][0]]
            return view.residuals([(self.records[c[1]], values) for c, values in share])

        shares = self._shares([(cell, values) for cell, own in jobs.items() for values in own])
        order = sorted(range(len(shares)), key=lambda i: -self._seconds(shares[i]))
        made = dict(zip(order, self._pool.map(one, [shares[i] for i in order]), strict=True))
        found: dict[Cell, list[Array]] = {}
        for i, share in enumerate(shares):
            for (cell, _), residual in zip(share, made[i], strict=True):
                found.setdefault(cell, []).append(residual)
        return found

    def _shares(self, jobs: Sequence[_Job]) -> list[list[_Job]]:
        """Runs of one view each, that are simulated in one call: few calls, and lanes that are
        full, but work for all threads.
        """
        of_views: dict[str, list[_Job]] = {}
        for job in jobs:
            of_views.setdefault(job[0][0], []).append(job)
        everything = self._seconds(jobs)
        self.seconds += everything
        shares = []
        for own in of_views.values():
            size = min(SHARE * -(-len(own) // (SHARES * SHARE)), MOST)
            if len(own) <= 2 * SHARE:
                halved = self._seconds(own) > 0.5 * everything
                size = -(-len(own) // 2) if halved else len(own)
            shares += [own[at : at + size] for at in range(0, len(own), size)]
        return shares

    def _seconds(self, jobs: Sequence[_Job]) -> float:
        """Of records, that runs go over."""
        records = (self.records[cell[1]] for cell, _ in jobs)
        return sum(r.rows * r.period for r in records)

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
        else by such as look over events, where a view has any.
        """
        jobs: dict[Cell, list[dict[str, float]]] = {}
        moved: dict[Cell, list[tuple[Coordinate, float]]] = {}
        for cell in cells:
            base = point.values(cell[1])
            jobs[cell], moved[cell] = [], []
            for c, theta in zip(point.coordinates, point.theta, strict=True):
                if c.name in wanted and self.in_cell(c, cell):
                    step = self.step(c, theta, fine or not self.views[cell[0]].remembers)
                    jobs[cell].append({**base, c.parameter: c.value(theta + step)})
                    moved[cell].append((c, step))
        found = self.run({cell: job for cell, job in jobs.items() if job})
        return {
            (cell, c.name): (found[cell][i] - residuals[cell]) / step
            for cell, steps in moved.items()
            for i, (c, step) in enumerate(steps)
        }

    def step(self, c: Coordinate, theta: float, fine: bool) -> float:
        """Step of a difference quotient, away from a bound."""
        if fine:
            size = self.rules.difference * self.rules.fine * (USUAL if c.effect else 1.0)
        else:
            size = self.rules.stride if c.effect else self.rules.difference
        return size if c.value(theta + size) != c.value(theta) else -size

    def in_cell(self, c: Coordinate, cell: Cell) -> bool:
        """Whether a cell reads a coordinate."""
        return c.record in (None, cell[1]) and self.views[cell[0]].depends_on(c.parameter)
