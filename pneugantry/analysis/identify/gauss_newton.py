"""Least squares of a few parameters over many samples by damped Gauss-Newton steps: only the normal
equations are kept, so nothing of the samples' size is factorised.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Minimum", "least_squares"]

Array = NDArray[np.float64]
DIFFERENCE = 1e-7  # of a parameter's scale
SMALL = 1e-9  # predicted fall of the sum of squares, relative, at which it ends
STEPS, DAMPINGS = 40, 12


@dataclass(frozen=True, eq=False)
class Minimum:
    """x (n,), residual there (m,), J'J (n, n)."""

    x: Array
    residual: Array
    information: Array


def least_squares(
    residual: Callable[[Array], Array], start: Array, scale: Array, bounds: tuple[Array, Array]
) -> Minimum:
    """x of the least sum of squares of residual(x). scale (n,): of x."""
    low, high = bounds
    x, rest = start, residual(start)
    information, slope = _linear(residual, x, rest, scale)
    for _ in range(STEPS):
        damping, square, moved = 0.0, float(rest @ rest), False
        for _ in range(DAMPINGS):
            step = _step(information, slope, scale, damping)
            there = np.clip(x + step, low, high)
            ahead = residual(there)
            if float(ahead @ ahead) < square:
                x, rest, moved = there, ahead, True
                break
            damping = max(1e-3, 10 * damping)
        fall = square - float(rest @ rest)
        if not moved:
            break
        information, slope = _linear(residual, x, rest, scale)
        if fall < SMALL * square:
            break
    return Minimum(x, rest, information)


def _linear(
    residual: Callable[[Array], Array], x: Array, rest: Array, scale: Array
) -> tuple[Array, Array]:
    """(J'J, J'r) at x."""
    steps = np.diag(DIFFERENCE * scale)
    jacobian = np.stack([(residual(x + s) - rest) / s[i] for i, s in enumerate(steps)])
    return jacobian @ jacobian.T, jacobian @ rest


def _step(information: Array, slope: Array, scale: Array, damping: float) -> Array:
    matrix = information * np.outer(scale, scale)
    size = np.maximum(np.diag(matrix), 1e-300)
    found = np.linalg.lstsq(matrix + damping * np.diag(size), -slope * scale, rcond=None)[0]
    return np.asarray(found * scale)
