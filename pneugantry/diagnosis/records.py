"""What readings show by themselves of faults that no plant has: channels that are noisier than
their sensors or hold their readings, and a sample clock that is not the one assumed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pneugantry.diagnosis.signals import Table
from pneugantry.engine.catalogue import Effect
from pyfmi_runner.log import PERIOD, SIGMA

__all__ = ["clock_excess", "holds", "noise_ratio", "oddity"]

Array = NDArray[np.float64]
NOISY = 1.3  # times the sensor's own noise
HELD = 8  # equal readings in a row
# times that this must happen: with logs rounded to a fifth of the noise it does once in some
# campaigns
OFTEN = 5
CLOCK = 0.005  # share by which the positions' way may differ from the integral of the speeds
DIFFERENCES = 4  # of a channel, which leave its noise and next to nothing of a plant's signal


def oddity(table: Table) -> Effect | None:
    """The plainest fault of this kind, as an effect outside the catalogue; None where the readings
    are what they should be.
    """
    fine = [channel for channel in SIGMA if channel not in table.quanta]
    noisy = [
        channel
        for channel in fine
        if noise_ratio(table.columns[channel], SIGMA[channel], table.spans) > NOISY
    ]
    if noisy:
        return _outside(
            "excess_noise", "sensors", f"more noise on {', '.join(noisy)} than the sensor has"
        )
    holding = [channel for channel in fine if holds(table.columns[channel], table.spans) >= OFTEN]
    if holding:
        return _outside(
            "dropout", "sensors", f"readings of {', '.join(holding)} that are held for some samples"
        )
    clocks = [
        clock_excess(table, axis)
        for axis in "xz"
        if axis not in table.quanta and f"v_{axis}" not in table.quanta
    ]
    if len(clocks) == 2 and min(map(abs, clocks)) > CLOCK and abs(clocks[0] - clocks[1]) < CLOCK:
        return _outside(
            "clock",
            "timing",
            f"samples that are not 1 ms but {1 + float(np.mean(clocks)):.3f} ms apart",
        )
    return None


def _outside(name: str, block: str, summary: str) -> Effect:
    return Effect(name, "", block, summary, (), outside=True)


def noise_ratio(values: Array, sigma: float, spans: NDArray[np.int64]) -> float:
    """RMS of a channel's (N,) white noise over `sigma`: from the median of high differences, which
    jumps do not touch.
    """
    differences = np.concatenate(
        [np.diff(values[first:last], DIFFERENCES) for first, last in spans]
    )
    gain = math.sqrt(
        math.comb(2 * DIFFERENCES, DIFFERENCES)
    )  # sum of the squared binomial coefficients
    return float(1.4826 * np.median(np.abs(differences)) / (gain * sigma))


def holds(values: Array, spans: NDArray[np.int64]) -> int:
    """How often at least HELD readings in a row are equal."""
    count = 0
    for first, last in spans:
        changes = np.flatnonzero(np.diff(values[first:last]) != 0)
        count += int(np.sum(np.diff(np.concatenate([[-1], changes, [last - first - 1]])) >= HELD))
    return count


def clock_excess(table: Table, axis: str) -> float:
    """Relative excess of the sample period over 1 ms by an axis' position (regressed on the
    integral of its speed, and on the speed itself, which takes up a tachometer's lag); 0 where the
    axis hardly moves.
    """
    position, integral, speed = [], [], []
    for first, last in table.spans:
        s, v = table.columns[axis][first:last], table.columns[f"v_{axis}"][first:last]
        way = np.concatenate([[0.0], np.cumsum(0.5 * PERIOD * (v[:-1] + v[1:]))])
        if np.ptp(way) < 0.02 or table.clamped[axis][first:last].all():
            continue
        position.append(s - s.mean())
        integral.append(way - way.mean())
        speed.append(v - v.mean())
    if not position:
        return 0.0
    columns = np.column_stack([np.concatenate(integral), np.concatenate(speed)])
    slope = np.linalg.lstsq(columns, np.concatenate(position), rcond=None)[0]
    return float(slope[0] - 1.0)
