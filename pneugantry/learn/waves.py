"""Periods that stand out of what a fit leaves."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pneugantry.engine.fitter import Fit
from pneugantry.engine.plant import Array
from pneugantry.engine.simulation import Cell

__all__ = ["periods_of"]

MOST = 2  # periods that are tried
FINE = 8  # frequencies per resolution of the longest record
LEAST = 3.0  # periods in the longest record
AROUND = 15  # resolutions about a frequency whose median power it is held against
STANDS = 8.0  # times that median from which on it stands out


def periods_of(fit: Fit, cells: Sequence[Cell], period_of: Callable[[Cell], float]) -> list[float]:
    """Periods (s) of the strongest lines in the residuals of some cells: powers of all records are
    summed, each with a phase of its own. period_of: s between a cell's rows.
    """
    series: list[tuple[Array, float]] = []
    for cell in cells:
        r = fit.residuals[cell]
        if np.isfinite(r).all():
            series += [(c / (np.std(c) + 1e-300), period_of(cell)) for c in r.T]
    if not series:
        return []
    from scipy.ndimage import median_filter  # its import is dear, for who learns

    longest = max(len(r) * p for r, p in series)
    highest = min(0.4 / p for _, p in series)
    frequencies = np.arange(LEAST / longest, highest, 1 / (FINE * longest))
    power = np.zeros(len(frequencies))
    for r, p in series:
        size = FINE * max(len(r), round(longest / p))
        window = np.hanning(len(r))
        spectrum = np.abs(np.fft.rfft((r - r.mean()) * window, size)) ** 2 / len(r)
        power += np.interp(frequencies, np.fft.rfftfreq(size, p), spectrum)
    left = power / median_filter(power, AROUND * FINE, mode="nearest")
    found: list[float] = []
    for _ in range(MOST):
        k = int(np.argmax(left))
        if left[k] < STANDS:
            break
        found.append(float(1 / frequencies[k]))
        left[np.abs(frequencies - frequencies[k]) < 3 / longest] = 0.0
    return found
