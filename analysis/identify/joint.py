"""One fit of the whole plant to all logs of a campaign by command replay (output error, scipy's least_squares).

The residual of a right plant is the sensors' white noise, so least squares is maximum likelihood. Where a parameter is still off, the
replay of a log may part from the measurement at a missed break-away; what follows says nothing then. Each log counts only up to where
it parts; a better fit carries it further, and the stages end when all logs count as a whole, or no longer grow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.optimize import least_squares

from analysis.identify.parameters import Coordinates
from analysis.identify.replayed import ReplayedLog

__all__ = ["reach"]

Array = NDArray[np.float64]
WINDOW = 100  # samples over which a misfit is judged
PARTED = 6.0  # RMS of a window beyond which the replay has parted
LASTING = 5  # windows over which it must stay parted (median)
STAGES = 8


def reach(residual: Array) -> int:
    """Samples up to where a replay (samples, channels) parts from its log for good."""
    n = len(residual) // WINDOW
    if n < LASTING:
        return len(residual)
    square = np.mean(residual[: n * WINDOW].reshape(n, -1) ** 2, axis=1)
    lasting = median_filter(square, LASTING, origin=-(LASTING // 2), mode="nearest")
    bad = np.flatnonzero((square > PARTED**2) & (lasting > PARTED**2))
    return len(residual) if len(bad) == 0 else int(bad[0]) * WINDOW


def solve(logs: Sequence[ReplayedLog], coordinates: Coordinates, theta: Array, loose: bool) -> Array:
    """Least squares over the rows that count, with the prior."""
    prior = coordinates.prior
    start = coordinates.theta({})

    def residual(at: Array) -> Array:
        return np.concatenate([log.weighted(log.residual(at)) for log in logs] + [(at - start) / prior])

    def jacobian(at: Array) -> Array:
        return np.vstack([log.jacobian(at) for log in logs] + [np.diag(1 / prior)])

    low, high = 0.05 * start, 20.0 * start
    found = least_squares(
        residual, theta, jacobian, bounds=(np.minimum(low, high), np.maximum(low, high)), x_scale="jac",
        ftol=1e-3 if loose else 1e-7, xtol=1e-10, gtol=None, max_nfev=8 if loose else 15,
    )  # fmt: skip
    print(found.nfev, found.njev, found.message, found.cost)
    return np.asarray(found.x)
