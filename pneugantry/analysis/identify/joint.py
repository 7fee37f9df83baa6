"""One fit of the whole plant to all logs of a campaign by command replay (output error, scipy's
least_squares).

The residual of a right plant is the sensors' white noise, so least squares is maximum likelihood.
Where a parameter is still off, the replay of a log may part from the measurement at a missed
break-away, and what follows says nothing. Each log counts only up to where it parts; a better fit
carries it further, and the stages end when all logs count as a whole, or no longer grow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.optimize import least_squares

from pneugantry.analysis.identify.joint_fit import JointFit, judged_fit
from pneugantry.analysis.identify.parameters import Coordinates
from pneugantry.analysis.identify.replayed import Plants, ReplayedLog

__all__ = ["JointFit", "Progress", "fit_logs", "reach"]

Array = NDArray[np.float64]
Progress = Callable[[str], None]
WINDOW = 100  # samples over which a misfit is judged
PARTED = 6.0  # RMS of a window beyond which the replay has parted
LASTING = 5  # windows over which it must stay parted (median)
STAGES = 6
LOOSE, TIGHT = 1e-3, 1e-6  # relative fall of the sum of squares at which a stage ends
# relative step of theta at which it ends: a hundredth of the best-known parameter's standard
# deviation
FINE = 3e-8
HOPELESS = 3.0  # RMS beyond which a stage ends after a few steps: another plant than the model


def reach(residual: Array) -> int:
    """Samples up to where a replay (samples, channels) parts from its log for good."""
    n = len(residual) // WINDOW
    if n < LASTING:
        return len(residual)
    square = np.mean(residual[: n * WINDOW].reshape(n, -1) ** 2, axis=1)
    lasting = median_filter(square, LASTING, origin=-(LASTING // 2), mode="nearest")
    bad = np.flatnonzero((square > PARTED**2) & (lasting > PARTED**2))
    return len(residual) if len(bad) == 0 else int(bad[0]) * WINDOW


def fit_logs(
    logs: Sequence[ReplayedLog],
    plants: Plants,
    coordinates: Coordinates,
    start: Mapping[str, float],
    progress: Progress,
) -> JointFit:
    """The fit from parameters `start`: first the logs of open loops, then all of them. Raises
    RunError where the FMU fails.
    """
    first = theta = np.clip(coordinates.theta(start), *_bounds(coordinates))
    whole = True
    still = [log for log in logs if log.run.setup.loop == "open"]
    if still and len(still) < len(logs):
        progress("open-loop logs")
        theta, whole = _stages(still, plants, coordinates, theta, LOOSE)
    if whole:
        progress("all logs")
        theta, whole = _stages(logs, plants, coordinates, theta, TIGHT)
    progress("intervals")
    if whole:
        return judged_fit(logs, plants, coordinates, theta)
    for log in (
        logs
    ):  # another plant than the model: what its blocks say by themselves is the best there is
        log.rows = len(log.measured)
    fit = judged_fit(logs, plants, coordinates, first)
    return replace(
        fit, sources={name: "blocks" if name in start else "none" for name in coordinates.names}
    )


def _bounds(coordinates: Coordinates) -> tuple[Array, Array]:
    start = coordinates.theta({})
    ends = np.column_stack([0.05 * start, 20.0 * start])
    return ends.min(axis=1), ends.max(axis=1)


def _residual_of(theta: Array, log: ReplayedLog) -> Array:
    return log.residual(theta)


def _stages(
    logs: Sequence[ReplayedLog], plants: Plants, coordinates: Coordinates, theta: Array, end: float
) -> tuple[Array, bool]:
    """(theta, whether every log counts as a whole)."""
    before = -1
    for _ in range(STAGES):
        residuals = plants.each(partial(_residual_of, theta), logs)
        for log, residual in zip(logs, residuals, strict=True):
            log.rows = len(residual) if log.steady else reach(residual)
        rows = sum(log.rows for log in logs)
        whole = all(log.whole for log in logs)
        if rows <= before and not whole:
            break
        theta = _solve(logs, plants, coordinates, theta, LOOSE)
        if whole:
            return (
                _solve(logs, plants, coordinates, theta, end, central=True)
                if end < LOOSE
                else theta
            ), True
        before = rows
    return theta, False


def _solve(
    logs: Sequence[ReplayedLog],
    plants: Plants,
    coordinates: Coordinates,
    theta: Array,
    end: float,
    central: bool = False,
) -> Array:
    """Least squares over the samples that count, with the prior; cut short where the plant does not
    fit anyway.
    """
    prior, centre = coordinates.prior, coordinates.theta({})

    def residual(at: Array) -> Array:
        return np.concatenate(
            [*plants.each(lambda log: log.vector(log.residual(at)), logs), (at - centre) / prior]
        )

    def jacobian(at: Array) -> Array:
        return np.vstack(
            [*plants.each(lambda log: log.jacobian(at, central), logs), np.diag(1 / prior)]
        )

    first = residual(theta)
    fits = float(first @ first) < HOPELESS**2 * len(first)
    most = 20 if fits else 8
    options = {
        "bounds": _bounds(coordinates),
        "x_scale": "jac",
        "ftol": end,
        "xtol": FINE,
        "gtol": None,
        "max_nfev": most,
    }
    found = least_squares(residual, theta, jacobian, **options)
    return np.asarray(found.x)
