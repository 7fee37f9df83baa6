"""How residuals reply to whatever is added to an equation: a matrix, from a few simulated pulses.

A pulse's reply fades within the view's memory, so one simulation holds several pulses; between two
pulses the reply is that of both, by distance. Any series of an addend is then a product of
matrices: regressors, curves and waves cost no more simulations. Where a reply lasts less than a
block of rows, it is told row by row: an impact may be as short.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from pneugantry.engine.plant import Array, Record
from pneugantry.engine.views.simulation import Cell
from pneugantry.learn.equations.points import OpenedView

__all__ = ["Kernels", "Pulses", "Reply", "blocks_of", "both_ways", "means", "reply_of"]

Answer = Callable[[Sequence[Array]], Array]  # series of an addend -> replies (n, rows, signals)
MOST = 600  # blocks of a record
PLACES = (0.12, 0.4, 0.7)  # of a record, where single pulses tell how long replies last
TRAIN = 24  # pulses that tell where something answers
HEARD = 0.2  # share of the largest answer from which on a place is one that answers
FADED = 0.02  # share of a reply's largest value below which it is over
ENDED = 0.95  # share of what is left of the record that a reply lasts, if it is cut off
SHORT = 2  # blocks that a reply lasts, up to which it may be told row by row
PEAK = 2.0  # noise levels to which a pulse is brought


class Reply(Protocol):
    """Changes of a cell's residual per addend of each block of rows."""

    @property
    def matrix(self) -> Array:
        """(rows of the residual, signals, blocks)"""
        ...

    @property
    def block(self) -> int:
        """Rows of the record."""
        ...

    @property
    def fine(self) -> bool:
        """Whether it is told row by row."""
        ...

    def told(self, series: Array) -> Array:
        """Changes (rows of the residual, signals, n) with series (rows, n) of an addend."""
        ...

    def at(self, series: Array) -> Array:
        """Series (rows, n) over its blocks, or over the residual's rows where it is fine."""
        ...

    def felt(self) -> Array:
        """Noise levels (rows of the residual, signals) by which an addend of 1 there changes a
        residual; of a fine one.
        """
        ...


def blocks_of(view: OpenedView, record: Record) -> int:
    """Rows of a block: whole rows of the residual."""
    rows = record.rows // view.decimation
    return view.decimation * max(1, -(-rows // MOST))


def means(shapes: Array, block: int) -> Array:
    """Means over blocks of rows; rows beyond the last whole block are left out."""
    count = len(shapes) // block
    return np.asarray(shapes[: count * block].reshape(count, block, -1).mean(axis=1))


def both_ways(answer: Answer) -> Answer:
    """What an addend and its opposite do alike but for the sign, the smaller of both: the slope of
    an answer, without the events that one of the two meets and the other does not.
    """

    def told(series: Sequence[Array]) -> Array:
        made = answer([*series, *(-s for s in series)])
        up, down = made[: len(series)], -made[len(series) :]
        smaller = np.sign(up) * np.minimum(np.abs(up), np.abs(down))  # nan, where one is
        return np.where(up * down <= 0, 0.0, smaller)

    return told


@dataclass(frozen=True, eq=False)
class Pulses:
    """How a cell is probed."""

    cell: Cell
    rows: int  # of the record
    height: int  # rows of the residual
    block: int
    step: int  # rows of the residual in a block
    sigma: Array  # (signals,) noise levels
    most: int  # simulations

    @property
    def blocks(self) -> int:
        return self.rows // self.block

    def series(self, at: Sequence[int], size: float) -> Array:
        found = np.zeros(self.rows)
        for k in at:
            found[k * self.block : (k + 1) * self.block] = size
        return found


@dataclass(frozen=True, eq=False)
class Kernels:
    """A reply as it was simulated, a hundredth of its matrix: what follows a pulse in some of the
    blocks, (rows of the residual, signals) each.
    """

    pulses: Pulses
    of_block: Mapping[int, Array]
    band: Array | None = None  # (rows after, rows of the residual, signals): what an addend changes
    # so many rows later; None: more than a block later, too

    @property
    def fine(self) -> bool:
        """See `Reply`."""
        return self.band is not None

    def told(self, series: Array) -> Array:
        """See `Reply`."""
        own = self.at(series)
        if self.band is None:
            return np.asarray(self.matrix @ own)
        rows = self.pulses.height
        found = np.zeros((rows, self.band.shape[2], own.shape[1]))
        for k, later in enumerate(self.band):
            found[k:] += later[k:, :, None] * own[: rows - k, None, :]
        return found

    def at(self, series: Array) -> Array:
        """See `Reply`."""
        if self.band is None:
            return means(series, self.block)
        return means(series, self.pulses.block // self.pulses.step)[: self.pulses.height]

    def felt(self) -> Array:
        """See `Reply`."""
        if self.band is None:
            raise ValueError("not fine")
        height, found = self.pulses.height, np.zeros(self.band.shape[1:])
        for k, later in enumerate(self.band):
            found[: height - k] += (later[k:] / self.pulses.sigma) ** 2
        return np.sqrt(found)

    @property
    def matrix(self) -> Array:
        """See `Reply`; made anew each time."""
        return _between(self.pulses, self.of_block)

    @property
    def block(self) -> int:
        """See `Reply`."""
        return self.pulses.block


def reply_of(pulses: Pulses, answer: Answer, size: float) -> Kernels | None:
    """The reply of a cell; None where nothing answers or simulations fail. size: of a first pulse,
    in the addend's unit.
    """
    places = _places(pulses, answer, size)
    singles: dict[int, Array] = {}
    size = _sized(pulses, answer, places, size)
    if size == 0.0:
        return None
    for k, made in zip(places, answer([pulses.series([k], size) for k in places]), strict=True):
        singles[k] = _after(pulses, made / size, k)
    if not all(np.isfinite(s).all() for s in singles.values()):
        return None
    memory = max(_memory(pulses, s) for s in singles.values())
    apart = min(memory, pulses.blocks)
    band = _band(pulses, answer, size) if apart <= SHORT else None
    kernels = {k: s[: apart * pulses.step] for k, s in singles.items()}
    stride = -(-apart // pulses.most)
    trains = [range(first, pulses.blocks, apart) for first in range(0, apart, stride)]
    told = answer([pulses.series(at, size) for at in trains]) / size
    if not np.isfinite(told).all():
        return None
    for at, made in zip(trains, told, strict=True):
        for k in at:
            kernels[k] = _after(pulses, made, k)[: apart * pulses.step]
    return Kernels(pulses, kernels, band)


def _band(pulses: Pulses, answer: Answer, size: float) -> Array | None:
    """A reply row by row, where it lasts less than a block; None: it does not, or simulations would
    be too many.
    """
    width = pulses.step
    if not 1 < width <= pulses.most:
        return None
    fine = replace(pulses, block=pulses.block // width, step=1)
    told = answer([fine.series(range(k, fine.blocks, width), size) for k in range(width)]) / size
    band = np.zeros((width, *told.shape[1:]))
    for later in range(width):
        rows = np.arange(later, fine.height)
        band[later, rows] = told[(rows - later) % width, rows]
    heard = np.abs(band).max(axis=(1, 2))
    rows = np.flatnonzero(heard > FADED * heard.max())  # none where nothing answers, or it fails
    return band[: rows[-1] + 1] if len(rows) and rows[-1] < width - 1 else None


def _places(pulses: Pulses, answer: Answer, size: float) -> list[int]:
    """Blocks where single pulses tell most, by a train of pulses: a carriage that sticks or is
    clamped answers to none.
    """
    train = sorted({int(s * (pulses.blocks - 1)) for s in np.linspace(0.0, 0.97, TRAIN)})
    told = answer([pulses.series(train, size)])[0] / pulses.sigma
    peaks = np.array([np.abs(part).max() for part in _between_starts(pulses, told, train)])
    if not np.isfinite(told).all() or not peaks.any():
        return sorted({int(s * (pulses.blocks - 1)) for s in PLACES})
    heard = np.flatnonzero(peaks > HEARD * peaks.max())
    return sorted({train[heard[int(s * (len(heard) - 1))]] for s in PLACES})


def _between_starts(pulses: Pulses, told: Array, train: Sequence[int]) -> list[Array]:
    """Replies from each pulse of a train to the next one."""
    return np.split(told, [k * pulses.step for k in train])[1:]


def _sized(pulses: Pulses, answer: Answer, places: Sequence[int], size: float) -> float:
    """Size of a pulse that changes the residual by `PEAK` noise levels; 0: nothing answers."""
    for _ in range(3):
        told = answer([pulses.series([places[len(places) // 2]], size)])[0] / pulses.sigma
        peak = float(np.abs(told).max()) if np.isfinite(told).all() else 0.0
        if peak == 0.0:
            return 0.0
        if 0.3 * PEAK < peak < 3 * PEAK:
            break
        size *= PEAK / peak
    return size


def _after(pulses: Pulses, made: Array, k: int) -> Array:
    return made[k * pulses.step :]


def _memory(pulses: Pulses, kernel: Array) -> int:
    """Blocks until a reply is over; where the record ends before, all of them."""
    over = np.abs(kernel) > FADED * np.abs(kernel).max(axis=0)
    last = int(np.flatnonzero(over.any(axis=1))[-1]) if over.any() else 0
    return pulses.blocks if last > ENDED * len(kernel) else 1 + last // pulses.step


def _between(pulses: Pulses, kernels: Mapping[int, Array]) -> Array:
    """The matrix: of each block, by distance from the pulses on both sides."""
    at = np.array(sorted(kernels))
    rows, signals = pulses.height, next(iter(kernels.values())).shape[1]
    matrix = np.zeros((rows, signals, pulses.blocks))
    for b in range(pulses.blocks):
        upper = int(np.searchsorted(at, b))
        low, high = at[max(upper - 1, 0)], at[min(upper, len(at) - 1)]
        share = 0.0 if high == low else float(np.clip((b - low) / (high - low), 0.0, 1.0))
        start, one, two = b * pulses.step, kernels[low], kernels[high]
        length = min(rows - start, max(len(one), len(two)))
        both = min(len(one), len(two), length)
        own = np.zeros((length, signals))
        own[:both] = (1 - share) * one[:both] + share * two[:both]
        longer = one if len(one) > len(two) else two
        own[both:] = longer[both:length]
        matrix[start : start + length, :, b] = own
    return matrix
