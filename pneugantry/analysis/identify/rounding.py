"""What a log's rounding of its commands hides: programmed ramps are drawn again, and the rest is
replayed with other roundings.

The plant is driven by commands that the log holds to 0.1 mV. Over a contouring log that error adds
up to more than the intervals that the sensors' noise alone would allow, so it is counted like a
noise.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["other_rounding", "programmed", "quantum"]

Array = NDArray[np.float64]
GRIDS = (1e-2, 1e-3, 1e-4, 1e-5)  # V, roundings that are looked for
NICE = 1e-3  # V, levels between which a programme ramps
SLACK = 3e-7  # V, of single precision
LONGEST_SHARE = 200  # samples per leg of a programme on average, at least


def quantum(command: Array) -> float:
    """Rounding step [V] of a command; 0 where it is not rounded."""
    for grid in GRIDS:
        if np.abs(command / grid - np.round(command / grid)).max() * grid < SLACK:
            return grid
    return 0.0


def programmed(command: Array) -> Array:
    """The command with its rounded ramps made straight, where straight legs between levels of whole
    mV explain it; else as it is.
    """
    step = quantum(command)
    if step == 0.0:
        return command
    result = np.round(command / step) * step  # free of single precision
    knots = _knots(command, 1.2 * step)
    if len(knots) * LONGEST_SHARE > len(command):
        return np.asarray(result)
    for a, b in pairwise(knots):
        ends = [np.round(result[i] / NICE) * NICE for i in (a, b)]
        leg = ends[0] + (ends[1] - ends[0]) * np.arange(b - a) / (b - a)
        if np.abs(leg - result[a:b]).max() <= 0.5 * step + SLACK:
            result[a:b] = leg
    return np.asarray(result)


def _knots(command: Array, tolerance: float) -> list[int]:
    """Ends of straight legs (Douglas and Peucker), first and last sample included."""
    knots, open_legs = {0, len(command) - 1}, [(0, len(command) - 1)]
    while open_legs:
        a, b = open_legs.pop()
        chord = command[a] + (command[b] - command[a]) * np.arange(b - a + 1) / max(b - a, 1)
        off = np.abs(command[a : b + 1] - chord)
        k = int(np.argmax(off))
        if off[k] > tolerance:
            knots.add(a + k)
            open_legs += [(a, a + k), (a + k, b)]
            if len(knots) * LONGEST_SHARE > 2 * len(command) + 2000:
                break  # no programme
    return sorted(knots)


def other_rounding(commands: Array, rng: np.random.Generator) -> Array:
    """Commands (samples, 2) with another draw of their rounding error, where they change from
    sample to sample; levels stay.
    """
    result = commands.copy()
    for column in range(commands.shape[1]):
        command = commands[:, column]
        moves = np.concatenate([[False], np.diff(command) != 0])
        moves[:-1] |= moves[1:]
        if np.count_nonzero(moves) * LONGEST_SHARE > len(
            command
        ):  # not just the steps of a programme
            result[:, column] += np.where(moves, quantum(command), 0.0) * rng.uniform(
                -0.5, 0.5, len(command)
            )
    return result
