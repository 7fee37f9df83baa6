"""What the diagnosis knows of a plant and of its records. No plant's own names stand in this
package.

A parameter is one of the model, or of a signal's sensor: "sensors.SIGNAL.WHAT" (see `sensors`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Data", "Epoch", "Nuisance", "Plant", "Record", "Signal", "straight", "thinned"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Signal:
    """A measured quantity."""

    name: str
    variable: str  # of the model
    sigma: float  # RMS of the sensor's noise as quoted, white but for the error of its converter
    unit: str = "1"
    error: float = 0.0  # RMS of what even a right model leaves besides, in the unit of sigma
    lasting: float = 1.0  # s, in which the correlation of that falls to 1/e
    step: float = 0.0  # of a converter coarser than the noise; sigma has its error, step/sqrt(12)

    @property
    def white(self) -> float:
        """RMS of the sensor's noise before its converter."""
        return math.sqrt(max(self.sigma**2 - self.step**2 / 12, 0.0))

    def averaged(self, rows: int) -> float:
        """RMS of the noise of a mean over so many rows. Of a converter's error a part lasts in it,
        the mean over its noise, which is periodic in the reading: the less, the more cells that
        noise reaches. (Its Fourier series: Widrow and Kollar, Quantization Noise, 2008.)
        """
        if not self.step:
            return self.sigma / math.sqrt(rows)
        k = np.arange(1, HARMONICS + 1)
        shares = np.exp(-((2 * np.pi * k * self.white / self.step) ** 2)) / k**2
        lasts = self.step**2 / (2 * np.pi**2) * float(shares.sum())
        return math.sqrt((self.sigma**2 - lasts) / rows + lasts)


@dataclass(frozen=True)
class Nuisance:
    """A parameter that every rig has somewhat off: no cause of a gap.

    sigma: RMS of its error, a share of the nominal value if `relative`. per_record: it differs from
    record to record. scales: its sigma grows with the rig's own tolerance, which is estimated.
    read: one of a record alone (a start) is read from the record before that is replayed.
    """

    parameter: str
    sigma: float
    relative: bool = False
    per_record: bool = False
    scales: bool = False
    read: bool = False


@dataclass(frozen=True)
class Plant:
    """Model, signals and what is known of its parameters."""

    name: str
    model: Path  # Modelica file
    class_name: str
    inputs: tuple[str, ...]  # of the model, known exactly
    signals: tuple[Signal, ...]
    parameters: Mapping[str, float]  # values that differ from the model's own
    nuisances: tuple[Nuisance, ...]
    blocks: Mapping[str, str]  # component path of the model -> block of the answer
    settings: Mapping[str, float] = field(default_factory=dict)  # of the solver
    in_views: Mapping[str, float] = field(default_factory=dict)  # the same where views need others


@dataclass(frozen=True, eq=False)
class Epoch:
    """One of several campaigns of a rig, between which something changed (see `change`).

    A parameter of this campaign alone is named "EPOCH:PARAMETER". neutral: values of the effects'
    parameters without any effect; settings: names of those that are switches.
    """

    name: str
    neutral: Mapping[str, float]
    settings: frozenset[str]

    def own(self, parameter: str) -> str:
        return f"{self.name}:{parameter}"

    @staticmethod
    def bare(parameter: str) -> str:
        """A parameter's name in the plant."""
        return parameter.split(":", 1)[-1]

    def known(self, parameter: str) -> str | None:
        """Its name in the plant; None for one of another campaign."""
        epoch, colon, bare = parameter.partition(":")
        return parameter if not colon else bare if epoch == self.name else None

    def read(self, given: Mapping[str, float], usual: Mapping[str, float]) -> dict[str, float]:
        """Values of the plant's parameters: what this campaign's own differ by from their neutral
        value is added to the shared ones, or to the `usual` ones where none is shared.
        """
        found = {n: v for n, v in given.items() if ":" not in n}
        for name, value in given.items():
            bare = self.known(name)
            if bare is None or bare == name:
                continue
            if bare in self.settings:
                found[bare] = value
                continue
            neutral = self.neutral.get(bare, 0.0)
            shared = found.get(bare, usual.get(bare, neutral))
            found[bare] = value if shared == neutral else shared + value - neutral
        return found


@dataclass(frozen=True, eq=False)
class Record:
    """One measured run: row k holds readings at k * period, and inputs held from then on."""

    name: str
    period: float  # s
    inputs: Mapping[str, Array]
    signals: Mapping[str, Array]
    parameters: Mapping[str, float]  # of this run alone
    judged: NDArray[np.bool_] | None = None  # rows that count; None: all
    skip: float = 0.0  # s at the start that do not count
    epoch: Epoch | None = None  # the campaign that it is of, where there are two
    within: Mapping[str, Array] = field(default_factory=dict)  # inputs (rows, n) in n parts of rows
    straight: frozenset[str] = frozenset()  # inputs that run straight to the next row; others hold
    told: frozenset[str] = frozenset()  # parameters that have been read from it (`Nuisance.read`)

    @property
    def rows(self) -> int:
        return len(next(iter(self.signals.values())))

    @property
    def first(self) -> int:
        """Row from which on it counts."""
        return round(self.skip / self.period)

    def read(self, given: Mapping[str, float]) -> dict[str, float]:
        """Values of the plant's parameters in this record, from a fit's."""
        return dict(given) if self.epoch is None else self.epoch.read(given, self.parameters)

    def driving(self, name: str) -> Array | tuple[Array, Array]:
        """An input as a simulation takes it: (rows,) held over rows, or at the rows and behind
        them, where it runs straight; (rows, n) there, where it was recorded finer than these rows.
        """
        if name in self.straight:
            return straight(np.asarray(self.inputs[name], dtype=float))
        parts = self.within.get(name)
        if parts is None:
            return np.asarray(self.inputs[name], dtype=float)
        return parts[:, 0], parts

    def moved(self, name: str, by: Array) -> Record:
        """The same with an input changed, by (rows,)."""
        inputs = {**self.inputs, name: np.asarray(self.inputs[name], dtype=float) + by}
        within = {**self.within}
        if name in within:
            within[name] = within[name] + by[:, None]
        return replace(self, inputs=inputs, within=within)


@dataclass(frozen=True, eq=False)
class Data:
    """The records that are fitted, one that no fit sees and whose gap is told, and further ones
    that no fit sees either.
    """

    fitted: tuple[Record, ...]
    held_out: Record | None
    also_held: tuple[Record, ...] = ()

    @property
    def unseen(self) -> tuple[Record, ...]:
        """All that no fit sees."""
        return self.also_held if self.held_out is None else (self.held_out, *self.also_held)

    def each(self, change: Callable[[Record], Record]) -> Data:
        """The same of changed records."""
        held = None if self.held_out is None else change(self.held_out)
        return Data(tuple(map(change, self.fitted)), held, tuple(map(change, self.also_held)))


def thinned(record: Record, every: int) -> Record:
    """One row in `every`: readings averaged about the row, inputs over what lies behind it; what
    they were within a row is kept, for a play or a delay feels each value. Rows about an impact are
    not judged.
    """
    if every <= 1:
        return record
    rows = record.rows // every
    jumps = _jumps(record)[: rows * every].reshape(rows, every).any(axis=1)
    return Record(
        record.name,
        record.period * every,
        {n: _behind(np.asarray(v, dtype=float), every) for n, v in record.inputs.items()},
        {n: _about(np.asarray(v, dtype=float), every) for n, v in record.signals.items()},
        record.parameters,
        ~(np.convolve(jumps, np.ones(ABOUT), "same") > 0),
        record.skip,
        record.epoch,
        {
            n: np.asarray(v, dtype=float)[: rows * every].reshape(rows, every)
            for n, v in record.inputs.items()
        },
        record.straight,
    )


def straight(values: Array) -> tuple[Array, Array]:
    """A signal at the rows, and its means over the periods behind them."""
    return values, np.append(0.5 * (values[:-1] + values[1:]), values[-1])


def _behind(values: Array, every: int) -> Array:
    """Means over the `every` rows from each kept one on."""
    rows = len(values) // every
    return np.asarray(values[: rows * every].reshape(rows, every).mean(axis=1))


def _about(values: Array, every: int) -> Array:
    """Means about each kept row: of `every` rows, or of one more whose ends count half."""
    weights = np.ones(every if every % 2 else every + 1)
    if every % 2 == 0:
        weights[[0, -1]] = 0.5
    padded = np.pad(values, len(weights) // 2, mode="edge")
    rows = len(values) // every
    return np.convolve(padded, weights / weights.sum(), "valid")[: rows * every : every]


HARMONICS = 50  # of a converter's error
ABOUT = 7  # rows about an impact that are not judged
JUMP = 12.0  # standard deviations of a signal's steps, by which one of them stands out


def _jumps(record: Record) -> NDArray[np.bool_]:
    """Rows at which a signal steps at once: an impact, whose instant no record tells to better than
    a row. A step stands out from those around it, noise included.
    """
    found = np.zeros(record.rows, dtype=bool)
    for values in record.signals.values():
        step = np.abs(np.diff(np.asarray(values, dtype=float), prepend=values[0]))
        scale = 1.4826 * float(np.median(step)) + 1e-300
        found |= (step > JUMP * scale) & (step > 4 * _about_max(step))
    return found


def _about_max(step: Array) -> Array:
    """Largest of the steps 2 to 6 rows away."""
    padded = np.pad(step, 6, mode="edge")
    windows = [padded[6 + d : 6 + d + len(step)] for d in (-6, -5, -4, -3, -2, 2, 3, 4, 5, 6)]
    return np.max(windows, axis=0)
