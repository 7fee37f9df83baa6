"""Hybrid learning of an ANFIS (Jang 1993, §4.2.4): least squares for the consequents forward,
gradient for the premises backward.
"""

from typing import NamedTuple

import numpy as np

from controllers.anfis import CLIP, AnfisModel

RIDGE = 1e-6  # keeps rules that no sample reaches at rest
GROW, SHRINK = 1.1, 0.9  # of the gradient's step, after an epoch that improved or worsened


class Training(NamedTuple):
    model: AnfisModel
    rmse: list[float]  # after each epoch, in the target's unit


def anfis_train(
    inputs: np.ndarray,
    target: np.ndarray,
    memberships: int = 3,
    epochs: int = 10,
    step: float = 0.02,
) -> Training:
    """Fits y (N,) to inputs (N, n). Raises ValueError for other shapes, epochs < 1 and an input
    that never changes.
    """
    if inputs.ndim != 2 or target.shape != inputs.shape[:1]:
        raise ValueError(
            f"inputs must be (N, n) and target (N,), got {inputs.shape} and {target.shape}"
        )
    if epochs < 1:
        raise ValueError(f"epochs must be >= 1, got {epochs}")
    low, high = inputs.min(axis=0), inputs.max(axis=0)
    if not (high > low).all():
        raise ValueError(f"every input must change, input {int(np.argmin(high > low))} does not")
    n = inputs.shape[1]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    x = np.clip((inputs - middle) / half, -CLIP, CLIP)
    centre = np.tile(np.linspace(-1.0, 1.0, memberships), (n, 1))
    width = np.full((n, memberships), 1.0 / max(memberships - 1, 1))
    rmse: list[float] = []
    best = None
    for _ in range(epochs):
        weights = _weights(x, centre, width)
        consequent = _least_squares(x, weights, target)
        rules = x @ consequent[:, :-1].T + consequent[:, -1]
        error = (weights * rules).sum(axis=1) - target
        rmse.append(float(np.sqrt(np.mean(error**2))))
        if best is None or rmse[-1] <= min(rmse):
            best = AnfisModel(centre.copy(), width.copy(), consequent, middle, half)
        step *= GROW if len(rmse) < 2 or rmse[-1] < rmse[-2] else SHRINK
        to_centre, to_width = _gradient(x, centre, width, weights, rules, error)
        norm = float(np.sqrt((to_centre**2).sum() + (to_width**2).sum())) + 1e-30
        centre = centre - step * to_centre / norm
        width = np.maximum(width - step * to_width / norm, 0.05)
    assert best is not None
    return Training(best, rmse)


def _rule_memberships(n: int, m: int) -> np.ndarray:
    """Membership of each input in each rule, (m^n, n)."""
    return np.stack(np.unravel_index(np.arange(m**n), (m,) * n), axis=1)


def _weights(x: np.ndarray, centre: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Normalised firing strengths (N, rules)."""
    grade = np.exp(-0.5 * ((x[:, :, None] - centre) / width) ** 2)
    weights = grade[:, 0]
    for i in range(1, x.shape[1]):
        weights = (weights[:, :, None] * grade[:, i][:, None, :]).reshape(len(x), -1)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _least_squares(x: np.ndarray, weights: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Consequents (rules, n + 1) by ridge regression."""
    one = np.column_stack([x, np.ones(len(x))])
    a = (weights[:, :, None] * one[:, None, :]).reshape(len(x), -1)
    normal = a.T @ a
    normal[np.diag_indices_from(normal)] += RIDGE * len(x)
    return np.asarray(np.linalg.solve(normal, a.T @ target).reshape(weights.shape[1], -1))


def _gradient(
    x: np.ndarray,
    centre: np.ndarray,
    width: np.ndarray,
    weights: np.ndarray,
    rules: np.ndarray,
    error: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Of half the mean squared error by the centres and widths."""
    n, m = centre.shape
    pull = (
        weights * (rules - (weights * rules).sum(axis=1, keepdims=True)) * error[:, None] / len(x)
    )  # d/d ln w_r
    belongs = _rule_memberships(n, m)
    to_centre, to_width = np.zeros_like(centre), np.zeros_like(width)
    for i in range(n):
        for k in range(m):
            share = pull[:, belongs[:, i] == k].sum(axis=1)
            a = (x[:, i] - centre[i, k]) / width[i, k]
            to_centre[i, k] = float((share * a / width[i, k]).sum())
            to_width[i, k] = float((share * a * a / width[i, k]).sum())
    return to_centre, to_width
