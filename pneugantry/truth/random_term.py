"""A term that nobody thought of: a smooth random function of two random signals of a block.

g(p, q) = amplitude * (sum_j w_j cos(a_j p + b_j q + phi_j) - what the nominal laws could absorb),
a draw from a Gaussian process with a squared-exponential kernel (random Fourier features: Rahimi,
Recht 2007). p, q: signals scaled to -1..1. A level, a slope in p and in q and a sign of p and of q
are taken out: they would be an offset, a gain, viscous or Coulomb friction, which have names.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pneugantry.truth.parameters import FEATURES, TERM_LENGTH

WAVES = 12  # first entry of the weights in a row
TURN = 8.0  # slope of the smooth sign that is taken out
REACH = 1.2  # signals are held at this many half-ranges


@njit
def _waves(row: np.ndarray, p: float, q: float) -> float:
    total = 0.0
    for j in range(FEATURES):
        k = WAVES + 4 * j
        total += row[k] * math.cos(row[k + 1] * p + row[k + 2] * q + row[k + 3])
    return total


@njit
def term_value(row: np.ndarray, signals: tuple[float, float, float, float]) -> float:
    """Value of the term [unit of its amplitude] at the four signals of its block."""
    p = min(max((signals[int(row[1])] - row[2]) / row[3], -REACH), REACH)
    q = min(max((signals[int(row[4])] - row[5]) / row[6], -REACH), REACH)
    absorbed = row[7] + row[8] * p + row[9] * q
    absorbed += row[10] * math.tanh(TURN * p) + row[11] * math.tanh(TURN * q)
    return row[0] * (_waves(row, p, q) - absorbed)


def random_row(
    rng: np.random.Generator, amplitude: float, ranges: np.ndarray, alone: bool
) -> np.ndarray:
    """A row of `Rig.terms` of RMS `amplitude` over the square of p and q. ranges: middle and half
    range of each of the four signals, shape (4, 2); alone: a function of p only.
    """
    row = np.zeros(TERM_LENGTH)
    p, q = rng.choice(len(ranges), size=2, replace=False)
    row[1:7] = p, *ranges[p], q, *ranges[q]
    length = rng.uniform(0.35, 0.8, 2)  # half-ranges over which the function changes
    waves = row[WAVES:].reshape(FEATURES, 4)
    waves[:, 0] = rng.standard_normal(FEATURES)
    waves[:, 1:3] = rng.standard_normal((FEATURES, 2)) / length
    waves[:, 3] = rng.uniform(0.0, 2 * np.pi, FEATURES)
    if alone:
        waves[:, 2] = 0.0
    side = np.linspace(-1.0, 1.0, 41)
    grid = np.array([(a, b) for a in side for b in side])
    values = np.cos(grid @ waves[:, 1:3].T + waves[:, 3]) @ waves[:, 0]
    columns = np.column_stack([np.ones(len(grid)), grid, np.tanh(TURN * grid)])
    row[7:12] = np.linalg.lstsq(columns, values, rcond=None)[0]
    left = np.sqrt(np.mean((values - columns @ row[7:12]) ** 2))
    waves[:, 0] /= left
    row[7:12] /= left
    row[0] = amplitude
    return row
