"""Logs of another rate, or with uneven stamps, on an even grid: at 1 kHz, or at any other rate."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from modelica_fmu.errors import InputError
from pyfmi_runner.log import PERIOD

__all__ = ["even_stamps", "is_regular", "on_grid", "resampled"]

Array = NDArray[np.float64]
HELD = ("u_x", "u_z", "f_nd", "v_td", "phase")  # act until the next one
LABELS = ("phase",)  # numbers that stand for something, of which there is no mean
INSTANT = 1e-9  # s, within which a sample counts as at a row
UNEVEN = 0.5  # of a period: stamps within it count as the rows of a 1 kHz log
GAP_ROWS = 5.0  # typical steps, and
GAP = 0.02  # s, from which on rows are missing rather than late


def is_regular(time: Array) -> bool:
    """Whether rows are a millisecond apart, as a log's must be."""
    steps = np.diff(time)
    near = np.abs(steps / PERIOD - 1.0)
    return bool(near.max() <= UNEVEN and abs(float(steps.mean()) / PERIOD - 1.0) <= 0.01)


def even_stamps(rows: int, rate: float) -> Array:
    """Stamps [s] of a log without any, by its rate [Hz]."""
    return np.arange(rows, dtype=np.float64) / rate


def resampled(columns: Mapping[str, Array]) -> tuple[dict[str, Array], str]:
    """Columns at 1 kHz from `time` [s] on, and a sentence that says how.

    Commands and wanted values hold until the next one, a row in which one changes has its mean;
    sensors run on straight lines between samples, or are averaged over a millisecond where there
    are more. Raises InputError for stamps that do not increase and for gaps.
    """
    found, told, how = on_grid(columns, PERIOD, HELD, LABELS)
    return found, f"{told}, {how}"


def on_grid(
    columns: Mapping[str, Array],
    period: float,
    held: Collection[str],
    labels: Collection[str] = (),
) -> tuple[dict[str, Array], str, str]:
    """As `resampled`, with rows `period` s apart and the columns `held` that act until the next,
    of which `labels` are numbers that have no mean; what was done to these columns, and how that is
    done to any.
    """
    time = columns["time"]
    steps = np.diff(time)
    _check(time, steps)
    typical = float(np.median(steps))
    rows = int(np.floor((time[-1] - time[0]) / period + 1e-6)) + 1
    grid = time[0] + np.arange(rows) * period
    fine = typical < 0.75 * period
    result: dict[str, Array] = {"time": np.round(grid, 9)}
    for name, values in columns.items():
        if name == "time":
            continue
        if name in held:
            result[name] = _acting(time, values, grid, period, name in labels)
        else:
            straight = np.interp(grid, time, values)
            result[name] = _averaged(time, values, grid, period) if fine else straight
    span = "millisecond" if period == PERIOD else f"{1e3 * period:.4g} ms"
    rate = "1 kHz" if period == PERIOD else f"{1 / period:.4g} Hz"
    how = f"averaged over each {span}" if fine else "on straight lines between samples"
    uneven = float(np.max(np.abs(steps / typical - 1.0)))
    stamps = f", stamps uneven by up to {100 * uneven:.0f} %" if uneven > 0.05 else ""
    told = f"recorded at {1 / typical:.4g} Hz{stamps}: resampled to {rate}"
    return (
        result,
        told,
        f"commands held, one that changes within a row as its mean, sensors {how}; their noise is "
        "then smaller than 1 sigma, so that a gap below 1 is possible",
    )


def _check(time: Array, steps: Array) -> None:
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        raise InputError(
            f"row {row} (t = {time[row]:g} s) does not increase",
            field="time",
            hint="sort the rows, drop repeated ones",
        )
    longest = max(GAP_ROWS * float(np.median(steps)), GAP)
    if (steps > longest).any():
        row = int(np.argmax(steps > longest)) + 1
        raise InputError(
            f"row {row} (t = {time[row]:g} s) follows a gap of {1e3 * steps[row - 1]:.4g} ms",
            field="time",
            hint="cut the log there, or fill the missing rows",
        )


def _acting(time: Array, values: Array, grid: Array, period: float, label: bool) -> Array:
    """What acts until the next sample, over each row. Where it changes on the way its mean: taken
    as it is at the row, it would be late by half a row. A switch and a label have no mean.
    """

    def latest(at: Array) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 1)

    first = latest(grid + INSTANT)
    held = values[first]
    if label or np.isin(values, (0.0, 1.0)).all():
        return held
    summed = np.append(0.0, np.cumsum(values[:-1] * np.diff(time)))

    def integral(to: Array) -> Array:
        own = latest(to)
        return np.asarray(summed[own] + values[own] * (to - time[own]))

    means = (integral(grid + period) - integral(grid)) / period
    return np.where(latest(grid + period - INSTANT) > first, means, held)


def _averaged(time: Array, values: Array, grid: Array, period: float) -> Array:
    """Mean of the samples within half a period of each grid point."""
    cell = np.clip(np.rint((time - grid[0]) / period).astype(np.int64), 0, len(grid) - 1)
    count = np.bincount(cell, minlength=len(grid))
    total = np.bincount(cell, weights=values, minlength=len(grid))
    filled = count > 0
    means = total[filled] / count[filled]
    return np.asarray(np.interp(grid, grid[filled], means))
