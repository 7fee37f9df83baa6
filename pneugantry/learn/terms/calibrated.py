"""A sensor's learnt error taken out of its readings: other views take them as known, and positions
are smoothed by speeds before any view sees them. What all views make of the corrected readings
tells its parameters.

Readings' density is that of what they stand for times the slope of one by the other, at each row.
Without it an error that turns noise into less noise would be likely: a reading less a play of
itself is such a one.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.engine.recent import Recent
from pneugantry.engine.views.view import Run, View
from pneugantry.learn.terms.term import Term

__all__ = ["Calibrated", "calibrated", "read_by"]

KEPT = 256  # records that a view keeps
ROUNDS = 60  # steps of the inversion, at most
FLAT = 1e-3  # slope that counts as none
EXACT = 1e-3  # of an error's size, left by the last one


def read_by(plant: Plant, term: Term) -> str | None:
    """The signal whose error a term is, as a function of what that sensor reads; None: none's."""
    if not (term.regressor.alone and term.point.is_read(term.variable)):
        return None
    left = term.point.equation.left
    return next((s.name for s in plant.signals if s.variable == left), None)


def calibrated(record: Record, signal: str, term: Term) -> Record | None:
    """A record without the term in a signal's readings; None: they have no single origin."""
    if signal not in record.signals:
        return record
    read = np.asarray(record.signals[signal], dtype=float)
    true = read
    for _ in range(ROUNDS):
        with np.errstate(over="ignore", invalid="ignore"):  # an error that grows faster than that
            error = _error(true, record.period, term)
            moved = float(np.abs(read - error - true).max())
        if not math.isfinite(moved):
            break
        true = read - error
        if moved <= EXACT * float(np.abs(error).max()):
            return replace(record, signals={**record.signals, signal: true})
    return None


@dataclass(eq=False)
class Calibrated:
    """A view that is shown readings without a sensor's error, of which the parameters are those of
    a term.
    """

    view: View
    signal: str
    term: Term

    def __post_init__(self) -> None:
        view = self.view
        self.name, self.signals, self.blocks = view.name, view.signals, view.blocks
        self.sigmas, self.decimation = view.sigmas, view.decimation
        self._records: Recent[Record | None] = Recent(KEPT)
        self._slopes: Recent[float] = Recent(KEPT)

    @property
    def defaults(self) -> Mapping[str, float]:
        return self.view.defaults

    @property
    def remembers(self) -> bool:
        return self.view.remembers

    def shows(self, record: Record) -> bool:
        return self.view.shows(record)

    def depends_on(self, parameter: str) -> bool:
        return parameter in self.term.parameters or self.view.depends_on(parameter)

    def prepare(self, moving: Collection[str], settings: Mapping[str, float]) -> None:
        self.view.prepare({*moving}.difference(self.term.parameters), settings)

    def residuals(self, runs: Sequence[Run]) -> list[Array]:
        """NaN where the readings have no single origin."""
        alike: dict[tuple[float, ...], list[int]] = {}
        for i, (_, given) in enumerate(runs):
            own = zip(self.term.parameters, self.term.values, strict=True)
            alike.setdefault(tuple(given.get(n, v) for n, v in own), []).append(i)
        found: list[Array] = [np.zeros((0, 0))] * len(runs)
        for values, members in alike.items():
            shown = [self._record(runs[i][0], values) for i in members]
            made = [(r or runs[i][0], runs[i][1]) for r, i in zip(shown, members, strict=True)]
            for i, r, residual in zip(members, shown, self.view.residuals(made), strict=True):
                told = residual * self._slope(r, values) if r is not None else np.nan * residual
                found[i] = told
        return found

    def _slope(self, record: Record, values: tuple[float, ...]) -> Array:
        """Of each column, by what it is to be multiplied: of the sensor's own the mean slope of its
        readings by what they stand for, row by row; the geometric one, as densities have it.
        """
        found = np.ones(len(self.signals))
        if self.signal in self.signals:
            column, term = self.signals.index(self.signal), self.term.at(values)
            sigma = self.sigmas[column] * math.sqrt(self.decimation)
            found[column] = self._slopes.of(
                (record, values), lambda: _steep(record, sigma, self.signal, term)
            )
        return found

    def _record(self, record: Record, values: tuple[float, ...]) -> Record | None:
        term = self.term.at(values)
        return self._records.of((record, values), lambda: calibrated(record, self.signal, term))


def _steep(record: Record, sigma: float, signal: str, term: Term) -> float:
    """Slope of readings by what they stand for, with what came before: a geometric mean."""
    true, law = np.asarray(record.signals[signal], dtype=float), term.law
    if law.memory is None:
        ends = [law.law(true + sign * sigma, term.values) for sign in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * sigma)
    else:
        size, *rest = term.values
        off = law.memory.walk(true, record.period, rest)
        slope = size * np.asarray(law.memory.slope(off, record.period, rest))
    return float(np.exp(np.mean(np.log(np.abs(1 + slope) + FLAT))))


def _error(true: Array, period: float, term: Term) -> Array:
    memory = term.law.memory
    if memory is not None:
        return np.asarray(term.values[0] * memory.walk(true, period, term.values[1:]))
    return np.asarray(term.law.law(true, term.values), dtype=float)
