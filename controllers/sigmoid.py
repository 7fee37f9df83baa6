"""Logistic function and limits that give the same bits in Python and compiled, and never overflow."""

import math

from numba.extending import register_jitable

A_MAX = 500.0  # exp(500) = 1e217: beyond, the logistic is 0 or 1 to 200 digits


@register_jitable
def logistic(a: float) -> float:
    """1 / (1 + exp(-a)) (Eq. 5-1)."""
    return 1.0 / (1.0 + math.exp(-limited(a, A_MAX)))


@register_jitable
def limited(value: float, limit: float) -> float:
    """value within -limit..limit."""
    if value > limit:
        return limit
    if value < -limit:
        return -limit
    return value
