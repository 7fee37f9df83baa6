"""One fit of the whole plant to all logs of a campaign by command replay (output error).

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

from pneugantry.analysis.identify.chord import Found, Goal, Prior, descend
from pneugantry.analysis.identify.joint_fit import JointFit, judged_fit
from pneugantry.analysis.identify.parameters import Coordinates
from pneugantry.analysis.identify.replayed import Plants, ReplayedLog, share_steps

__all__ = ["JointFit", "Progress", "fit_logs", "reach"]

Array = NDArray[np.float64]
Progress = Callable[[str], None]
WINDOW = 100  # samples over which a misfit is judged
PARTED = 6.0  # RMS of a window beyond which the replay has parted
LASTING = 5  # windows over which it must stay parted (median)
STAGES = 6
# a stage on the way ends where a thousandth of the sum of squares is left to fall
LOOSE = Goal(1e-3, 0.0, 12)
CLOSE = Goal(0.0, 1.0, 4)  # within a standard deviation, all logs counting as a whole
# the answer: a thirtieth of a standard deviation. Its intervals want derivatives from nearby: the
# columns are nearly dependent, and from a hundred standard deviations away some are twice as wide
TIGHT = Goal(0.0, 1e-3, 4, central=True, near=3.0)


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
    prior = _prior(coordinates)
    first = np.clip(coordinates.theta(start), prior.low, prior.high)
    found, whole = Found(first, first), True
    still = [log for log in logs if log.run.setup.loop == "open"]
    if still and len(still) < len(logs):
        progress("open-loop logs")
        found, whole = _stages(still, plants, prior, found)
        share_steps(logs)
    if whole:
        progress("all logs")
        found, whole = _stages(logs, plants, prior, Found(found.theta, found.theta))
    if whole:
        found = descend(logs, plants, Found(found.theta, found.theta), prior, CLOSE)
        found = descend(logs, plants, Found(found.theta, found.theta), prior, TIGHT)
        progress("intervals")
        return judged_fit(logs, plants, coordinates, found)
    progress("intervals")
    for log in logs:  # another plant than the model: its blocks by themselves say more
        log.rows = len(log.measured)
    fit = judged_fit(logs, plants, coordinates, Found(first, first))
    return replace(
        fit, sources={name: "blocks" if name in start else "none" for name in coordinates.names}
    )


def _prior(coordinates: Coordinates) -> Prior:
    centre = coordinates.theta({})
    ends = np.column_stack([0.05 * centre, 20.0 * centre])
    return Prior(centre, coordinates.prior, ends.min(axis=1), ends.max(axis=1))


def _residual_of(theta: Array, log: ReplayedLog) -> Array:
    return log.residual(theta)


def _count(logs: Sequence[ReplayedLog], plants: Plants, theta: Array) -> bool:
    """Sets how far each log counts at theta; whether all count as a whole."""
    residuals = plants.each(partial(_residual_of, theta), logs)
    for log, residual in zip(logs, residuals, strict=True):
        log.rows = len(residual) if log.steady else reach(residual)
    return all(log.whole for log in logs)


def _stages(
    logs: Sequence[ReplayedLog], plants: Plants, prior: Prior, found: Found
) -> tuple[Found, bool]:
    """(found, whether every log counts as a whole)."""
    before = -1
    for _ in range(STAGES):
        whole = _count(logs, plants, found.theta)
        rows = sum(log.rows for log in logs)
        if rows <= before and not whole:
            break
        found = descend(logs, plants, found, prior, LOOSE)
        if whole:
            return found, True
        before = rows
    return found, False
