"""A first-order recursion, compiled once and kept: what a log's checks need of scipy.signal, whose
import takes longer than they do.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyfmi_runner.machine_code import kept

__all__ = ["first_order"]

Array = NDArray[np.float64]


@kept
def first_order(values: Array, gain: float, fade: float) -> Array:
    """y[k] = fade * y[k-1] + gain * values[k], y[-1] = 0; shape (n,)."""
    result = np.empty(len(values))
    y = 0.0
    for k in range(len(values)):
        y = fade * y + gain * values[k]
        result[k] = y
    return result
