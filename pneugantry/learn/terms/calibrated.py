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
from dataclasses import dataclass, field, replace

import numpy as np

from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.engine.recent import Recent
from pneugantry.engine.views.view import Run, View
from pneugantry.learn.equations.points import signal_at
from pneugantry.learn.screening.regressors import TIME
from pneugantry.learn.terms.term import Term

__all__ = ["KEPT", "Calibrated", "Misreading", "misreading"]

KEPT = 256  # records that are kept
ROUNDS = 60  # steps of the inversion, at most
FLAT = 1e-3  # slope that counts as none
EXACT = 1e-3  # of an error's size, left by the last one


@dataclass(frozen=True)
class Misreading:
    """What a sensor's error is a function of: its own readings, another one's, or time."""

    signal: str  # whose error it is
    over: str  # signal, or `TIME`
    term: Term

    @property
    def of_itself(self) -> bool:
        return self.over == self.signal

    def at(self, values: Sequence[float]) -> Misreading:
        """The same with other values of the term's parameters."""
        return replace(self, term=self.term.at(values))

    def told(self, record: Record) -> bool:
        """Whether a record has what the error is a function of, or is not touched by it."""
        return self.signal not in record.signals or self.over in (TIME, *record.signals)

    def corrected(self, record: Record) -> Record | None:
        """A record without the error in the signal's readings; None: they have no single origin."""
        if self.signal not in record.signals:
            return record
        read = np.asarray(record.signals[self.signal], dtype=float)
        if not self.of_itself:
            true = read - self._error(self._known(record), record.period)
            return replace(record, signals={**record.signals, self.signal: true})
        true = read
        for _ in range(ROUNDS):
            with np.errstate(over="ignore", invalid="ignore"):  # it may grow faster than that
                error = self._error(true, record.period)
                moved = float(np.abs(read - error - true).max())
            if not math.isfinite(moved):
                break
            true = read - error
            if moved <= EXACT * float(np.abs(error).max()):
                return replace(record, signals={**record.signals, self.signal: true})
        return None

    def slope(self, record: Record, sigma: float) -> float:
        """Slope of readings of that noise by what they stand for, with what came before: a
        geometric mean.
        """
        if not self.of_itself:
            return 1.0
        term = self.term
        true, law = np.asarray(record.signals[self.signal], dtype=float), term.law
        if law.memory is None:
            ends = [law.law(true + sign * sigma, term.values) for sign in (1, -1)]
            slope = (ends[0] - ends[1]) / (2 * sigma)
        else:
            size, *rest = term.values
            off = law.memory.walk(true, record.period, rest)
            slope = size * np.asarray(law.memory.slope(off, record.period, rest))
        return float(np.exp(np.mean(np.log(np.abs(1 + slope) + FLAT))))

    def _known(self, record: Record) -> Array:
        """What the error is a function of, where that is not what it changes."""
        if self.over == TIME:
            return np.asarray(np.arange(record.rows) * record.period, dtype=np.float64)
        return np.asarray(record.signals[self.over], dtype=float)

    def _error(self, over: Array, period: float) -> Array:
        term = self.term
        memory = term.law.memory
        if memory is not None:
            return np.asarray(term.values[0] * memory.walk(over, period, term.values[1:]))
        return np.asarray(term.law.law(over, term.values), dtype=float)


def misreading(plant: Plant, term: Term, roots: Mapping[str, str]) -> Misreading | None:
    """What a sensor's error is a function of; None: the term is no error of a sensor, or one of
    what is not measured. roots: of the plant's variables, those that are one have the same.
    """
    own, point, signal = term.regressor, term.point, signal_at(plant, term.point)
    if not (own.alone and signal) or term.places:
        return None
    if own.name == TIME:
        return Misreading(signal, TIME, term)
    if point.is_read(own.name):
        return Misreading(signal, signal, term)
    measured = {roots.get(s.variable, s.variable): s.name for s in plant.signals}
    over = measured.get(roots.get(own.label, own.label))
    return None if over is None else Misreading(signal, over, term)


@dataclass(eq=False)
class Calibrated:
    """A view that is shown readings without a sensor's error, of which the parameters are those of
    a term.
    """

    view: View
    misread: Misreading
    # of records without the error, by record and values; views may share it
    kept: Recent[Record | None] = field(default_factory=lambda: Recent(KEPT))

    def __post_init__(self) -> None:
        view = self.view
        self.name, self.signals, self.blocks = view.name, view.signals, view.blocks
        self.sigmas, self.decimation = view.sigmas, view.decimation
        self.term = self.misread.term
        self._neutral = self.term.neutral
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
            alike.setdefault(tuple(given.get(n, v) for n, v in self._neutral.items()), []).append(i)
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
        if self.misread.signal in self.signals:
            column, misread = self.signals.index(self.misread.signal), self.misread.at(values)
            sigma = self.sigmas[column] * math.sqrt(self.decimation)
            found[column] = self._slopes.of((record, values), lambda: misread.slope(record, sigma))
        return found

    def _record(self, record: Record, values: tuple[float, ...]) -> Record | None:
        misread = self.misread.at(values)
        return self.kept.of((record, values), lambda: misread.corrected(record))
