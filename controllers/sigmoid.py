"""Logistic function and limits that give the same bits in Python and compiled, and
never overflow.
"""

import math

from numba.extending import register_jitable

# exp(-100) = 4e-44: small enough to be 0, large enough that products of it do not underflow
A_MAX = 100.0


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
