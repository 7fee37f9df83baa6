"""Adaptive neuro-fuzzy inference system (Jang 1993; §4.2.4, Fig. 4.19): Gaussian memberships on a
grid, first-order Sugeno rules.

w_r = prod_i exp(-((x_i - c_i,m(r,i)) / s_i,m(r,i))^2 / 2), y = sum_r w_r (a_r . x + b_r) / sum_r
w_r, with every combination of one membership per input a rule (3 memberships of 5 inputs: 243
rules). Inputs are scaled to -1..1 over the training data and clipped to -1.5..1.5: a Sugeno rule
extrapolates without bound.

The output is written here, in plain loops, because it must compile into the control loop and give
Python's bits; training is `anfis_training`. No library fits: those on PyPI (anfis, scikit-anfis,
anfis-pytorch) are unmaintained or bring PyTorch, and none yields a function that numba can compile.
"""

import math
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

CLIP = 1.5  # of a scaled input
TINY = 1e-300


class AnfisModel(NamedTuple):
    """Premises and consequents; m memberships of n inputs make m^n rules, the last input turning
    fastest.
    """

    centre: np.ndarray  # (n, m), scaled
    width: np.ndarray  # (n, m), scaled, > 0
    consequent: np.ndarray  # (m^n, n + 1): a_r and b_r, for scaled inputs
    middle: np.ndarray  # (n,) of the training data, in the inputs' units
    half: np.ndarray  # (n,) half range of the training data


@register_jitable
def anfis_scale(model: AnfisModel, inputs: np.ndarray, scaled: np.ndarray) -> None:
    """Inputs in their units to -1..1."""
    for i in range(inputs.shape[0]):
        value = (inputs[i] - model.middle[i]) / model.half[i]
        scaled[i] = min(max(value, -CLIP), CLIP)


@register_jitable
def anfis_output(
    model: AnfisModel, inputs: np.ndarray, scaled: np.ndarray, grade: np.ndarray
) -> float:
    """y for inputs (n,); scaled (n,) and grade (n, m) are work space."""
    n, m = model.centre.shape
    anfis_scale(model, inputs, scaled)
    for i in range(n):
        for k in range(m):
            a = (scaled[i] - model.centre[i, k]) / model.width[i, k]
            grade[i, k] = math.exp(-0.5 * a * a)
    total, weighted = 0.0, 0.0
    for r in range(model.consequent.shape[0]):
        weight, rest = 1.0, r
        for i in range(n - 1, -1, -1):
            weight *= grade[i, rest % m]
            rest //= m
        y = model.consequent[r, n]
        for i in range(n):
            y += model.consequent[r, i] * scaled[i]
        total += weight
        weighted += weight * y
    return weighted / (total + TINY)
