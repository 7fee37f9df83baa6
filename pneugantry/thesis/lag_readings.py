"""Conclusion 15 from the thesis' own readings: Tables 4.1-4.5, time to 65 % of a step.

The FMU cannot judge it: its tau(x) is read off these very tables. The readings can: two-way F tests
of tau by piston position and by filling against exhausting, each reading one observation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as f_distribution

from pneugantry.thesis.conclusions import SIGNIFICANT, Conclusion

__all__ = ["READINGS", "Effect", "factor_effect", "readings_conclusion"]

Array = NDArray[np.float64]
ALPHA = 0.05
# s, by axis: position [m] -> readings while filling, while exhausting
READINGS: dict[str, dict[float, tuple[tuple[float, ...], tuple[float, ...]]]] = {
    "x": {
        1.0: ((0.15, 0.12, 0.12), (0.20, 0.12, 0.15)),
        0.5: ((0.25, 0.25, 0.25), (0.25, 0.26, 0.25)),
        0.0: ((0.45, 0.60, 0.45), (0.45, 0.55, 0.45)),
    },
    "z": {
        0.1: ((0.20, 0.15, 0.12), (0.12, 0.14, 0.21)),
        0.0: ((0.16, 0.13, 0.12), (0.11, 0.15, 0.16)),
    },
}


class Effect(NamedTuple):
    """What a factor does to the readings."""

    p: float  # of the F test
    apart: float  # largest mean / smallest mean - 1


def factor_effect(axis: str, factor: str) -> Effect:
    """Factor "position" or "way", against the scatter within position and way."""
    table = np.array([list(ways) for ways in READINGS[axis].values()])  # position, way, reading
    means = table.mean(axis=(1, 2) if factor == "position" else (0, 2))
    per_level = table.size // len(means)
    within = table - table.mean(axis=2, keepdims=True)
    free = table.size - table.shape[0] * table.shape[1]
    noise = float((within**2).sum()) / free
    between = per_level * float(((means - table.mean()) ** 2).sum()) / (len(means) - 1)
    p = float(f_distribution.sf(between / noise, len(means) - 1, free))
    return Effect(p, float(means.max() / means.min() - 1.0))


def readings_conclusion() -> Conclusion:
    """Significant: p < 0.05 and 30 % apart, both."""
    effects = {
        (axis, factor): factor_effect(axis, factor)
        for axis in READINGS
        for factor in ("position", "way")
    }
    significant = {
        key: effect.p < ALPHA and effect.apart > SIGNIFICANT for key, effect in effects.items()
    }
    numbers = {}
    for (axis, factor), effect in effects.items():
        numbers[f"tau_{axis} by {factor}, p"] = effect.p
        numbers[f"tau_{axis} by {factor}, apart"] = effect.apart
    text = "tau_x depends on position, tau_z does not; neither on filling or exhausting"
    only = [key for key, found in significant.items() if found]
    return Conclusion(15, text, only == [("x", "position")], numbers)
