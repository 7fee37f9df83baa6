"""The grid on which readings lie, where a sensor's converter or encoder is coarser than its noise.

Its error is no white noise: of a signal at rest it lasts. Where a log is stored with fewer digits,
every reading of one cell is moved alike, until it is put back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pneugantry.engine.plant import Array, Record, Signal

__all__ = ["Grid", "converted", "converter_step", "grid_of", "step_and_grid"]

# step in units of the noise from which on it counts; logs themselves are rounded to about 0.2
COARSE = 0.45
ENOUGH = 40  # readings in a stretch of the grid that make an unused cell telling
BESIDE = 0.2  # share of a step by which a log's own rounding may move a reading off its grid
CLOSER = 0.8  # of a step: no two cells are as near, but by the log's own rounding
NEXT = 1.5  # times the least distance of two cells: neighbours
MANY = 2 / 3  # of readings that do not rest, share of cells in which a signal dwells
PARTS = 200  # of gaps, after each of which the step is told anew
SAME = 1e-6  # of the noise, by which readings of one cell may differ (sums of binary fractions)


@dataclass(frozen=True)
class Grid:
    """Cells of a converter [unit of the signal]."""

    first: float
    step: float
    open: float = 0.0  # by which the step may differ: the log's rounding at the farthest cells

    def nearest(self, values: Array) -> Array:
        """Readings (N,) put back on the grid."""
        return np.asarray(self.first + self.step * np.round((values - self.first) / self.step))


def converter_step(values: Array, sigma: float) -> float:
    """Step [unit of the signal] of the grid that readings (N,) lie on, 0 if it is finer than
    COARSE * sigma.

    Where the signal dwells, noise of RMS sigma reaches every cell of a fine grid; cells that stay
    empty between used ones show that the converter's own step is wider. The step is the median
    distance of used cells (`_far_apart` where these are few). A signal that mostly rests in one
    wide cell has few others with as many readings; there all cells must be as far apart. Of one
    that passes them all, each must lie on one line with the others.
    """
    same = SAME * sigma
    used, counts = np.unique(np.round(values / same) * same, return_counts=True)
    if len(used) < 3:
        return 0.0
    dwell = used[counts >= max(ENOUGH, 0.002 * counts.max())]
    resting = len(dwell) < 3
    if resting:
        dwell = used[counts >= ENOUGH]
        if len(dwell) < 3:
            return _passed(used, sigma)
    gaps = np.diff(dwell)
    near = gaps[gaps < 6 * sigma]
    step = float(np.median(near)) if len(near) else _far_apart(used, counts, dwell)
    if resting and np.diff(used).min() < CLOSER * step:
        return 0.0
    return step if step > COARSE * sigma else 0.0


def _far_apart(used: Array, counts: NDArray[np.int_], dwell: Array) -> float:
    """The step of cells (N,), of which those are far apart in which a signal dwells: their least
    distance, or that of any two where many readings but those at rest lie between: a force that
    mostly rests dwells in few. (Of means of neighbours a fifth lies between.)
    """
    step = float(np.diff(dwell).min())
    cells = (used - dwell[0]) / step
    on = np.abs(cells - np.round(cells)) < BESIDE
    rest = counts.max()
    between = counts[on].sum() - rest < MANY * (counts.sum() - rest)
    return float(np.diff(used).min()) if between else step


def _passed(used: Array, sigma: float) -> float:
    """As `converter_step`, of cells (N,) that hold few readings each."""
    gaps = np.diff(used)
    step = float(np.median(gaps[gaps < NEXT * gaps.min()]))
    coarse = len(gaps) >= ENOUGH and step > COARSE * sigma
    return step if coarse and grid_of(used, step) is not None else 0.0


def grid_of(values: Array, step: float) -> Grid | None:
    """Line through the cells that readings lie on, about a step apart, with one at zero where they
    allow for it; None where some lie beside it, or are no numbers.
    """
    cells = np.unique(values)
    gaps = np.diff(cells)
    number = np.append(0.0, np.cumsum(np.round(gaps / _sure(gaps, step))))
    if not np.isfinite(number).all() or number[-1] == 0:
        return None
    finer, first = map(float, np.polyfit(number, cells, 1))
    beside = float(np.abs(cells - first - finer * number).max())
    if beside >= BESIDE * step:
        return None
    nought = number - round(-first / finer)
    if abs(finer * (number[0] - nought[0]) + first) <= beside:
        finer = float(nought @ cells / (nought @ nought))
        beside = float(np.abs(cells - finer * nought).max())
        number, first = nought, finer * float(nought[0])
    return Grid(first, finer, beside / float(np.abs(number).max()))


def _sure(gaps: Array, step: float) -> float:
    """A step so sure that it counts the cells of long gaps: short ones, whose count a rough step
    tells, make it surer for longer ones. A log's rounding may be a tenth of it.
    """
    ordered = np.sort(gaps)
    length, cells = 0.0, 0.0
    for part in np.array_split(ordered, max(1, min(len(ordered), PARTS))):
        cells += float(np.round(part / step).sum())
        length += float(part.sum())
        step = length / cells if cells > 0 else step
    return step


def step_and_grid(values: Array, sigma: float) -> tuple[float, Grid | None]:
    """Step of a coarse converter, 0 if it is none, and its grid where all readings (N,) lie on
    one.
    """
    step = converter_step(values, sigma) if len(values) else 0.0
    grid = grid_of(values, step) if step else None
    return (step if grid is None else grid.step), grid


def converted(
    signals: Sequence[Signal], records: Sequence[Record]
) -> tuple[list[Signal], list[Record]]:
    """Signals with the steps of their converters, as all records together show them, and the
    records with the readings that these gave.

    A noise that is quoted smaller than what the converter leaves, step/sqrt(12), is that of the
    sensor before it.
    """
    found: list[Signal] = []
    records = list(records)
    for signal in signals:
        read = [r.signals[signal.name] for r in records if signal.name in r.signals]
        step, grid = step_and_grid(np.concatenate(read) if read else np.zeros(0), signal.sigma)
        left = step / math.sqrt(12)
        sigma = signal.sigma if signal.sigma >= left else math.hypot(signal.sigma, left)
        found.append(replace(signal, sigma=sigma, step=step))
        if grid is not None:
            records = [_put_back(r, signal.name, grid) for r in records]
    return found, records


def _put_back(record: Record, signal: str, grid: Grid) -> Record:
    if signal not in record.signals:
        return record
    own = {signal: grid.nearest(record.signals[signal])}
    return replace(record, signals={**record.signals, **own})
