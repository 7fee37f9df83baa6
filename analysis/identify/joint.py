"""One fit of the whole plant to all logs of a campaign by command replay (output error, scipy's least_squares).

The residual of a right plant is the sensors' white noise, so least squares is maximum likelihood. Where a parameter is still off, the
replay of a log may part from the measurement at a missed break-away, and what follows says nothing. Each log counts only up to where it
parts; a better fit carries it further, and the stages end when all logs count as a whole, or no longer grow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.optimize import least_squares

from analysis.identify.interval import Estimate
from analysis.identify.parameters import Coordinates
from analysis.identify.replayed import Plants, ReplayedLog
from analysis.identify.rounding import other_rounding

__all__ = ["JointFit", "Progress", "fit_logs", "reach"]

Array = NDArray[np.float64]
Progress = Callable[[str], None]
WINDOW = 100  # samples over which a misfit is judged
PARTED = 6.0  # RMS of a window beyond which the replay has parted
LASTING = 5  # windows over which it must stay parted (median)
STAGES = 6
LOOSE, TIGHT = 1e-3, 1e-6  # relative fall of the sum of squares at which a stage ends
FINE = 3e-8  # relative step of theta at which it ends: a hundredth of the best-known parameter's standard deviation
HOPELESS = 3.0  # RMS beyond which a stage ends after a few steps: another plant than the model
ROUNDINGS = 20  # replays with other roundings of the commands
TOLD = 0.25  # relative standard deviation beyond which a parameter is not told
BORROWED = 0.5  # share of a parameter's variance from which on it rests on the plant sheet's cable force
FITS = 1.1  # gap of a log below which the plant replays it
LAGS = 200  # of blocks, over which the residual's correlation is summed


@dataclass(frozen=True, eq=False)
class JointFit:
    """Parameters by name with their covariance; `sources`: what each rests on, "logs", "sheet" or "none"."""

    coordinates: Coordinates
    theta: Array
    covariance: Array  # of theta
    sources: dict[str, str]
    gaps: dict[str, float]  # by log, RMS of the residual that counts, in sensor noise
    rows: dict[str, tuple[int, int]]  # by log, samples that count and that there are
    rounding_share: float  # of the variance, at most, that comes from the rounded commands

    @property
    def values(self) -> dict[str, float]:
        return self.coordinates.values(self.theta)

    @property
    def fits(self) -> bool:
        """The plant replays every log nearly to the noise."""
        return all(gap < FITS for gap in self.gaps.values())

    @property
    def gap(self) -> float:
        """RMS over all logs."""
        weights = np.array([n for n, _ in self.rows.values()], dtype=float)
        return float(np.sqrt(np.average(np.array(list(self.gaps.values())) ** 2, weights=weights)))

    def estimates(self) -> dict[str, Estimate]:
        """Every parameter with its interval, those that the logs do not tell included."""
        sigma = np.sqrt(np.diag(self.coordinates.covariance(self.covariance)))
        values = self.values
        return {name: Estimate(values[name], float(s)) for name, s in zip(self.coordinates.names, sigma, strict=True)}

    def sums(self) -> dict[str, Estimate]:
        """F_s and F_d together with the cable force, as the logs show them, for axes whose cable force the logs do not tell."""
        found = {}
        for i, u in enumerate(self.coordinates.unknowns):
            label = self.coordinates.label(i)
            cable = self.sources.get(f"axis_{u.axis}.F_w")
            if label != u.name and cable == "sheet":
                scale = self.coordinates.scale[i]
                found[label] = Estimate(float(scale * self.theta[i]), float(scale * math.sqrt(self.covariance[i, i])))
        return found


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
    logs: Sequence[ReplayedLog], plants: Plants, coordinates: Coordinates, start: Mapping[str, float], progress: Progress
) -> JointFit:
    """The fit from parameters `start`: first the logs of open loops, then all of them. Raises RunError where the FMU fails."""
    first = theta = np.clip(coordinates.theta(start), *_bounds(coordinates))
    still = [log for log in logs if log.run.setup.loop == "open"]
    if still and len(still) < len(logs):
        progress("open-loop logs")
        theta, _ = _stages(still, plants, coordinates, theta, LOOSE)
    progress("all logs")
    theta, whole = _stages(logs, plants, coordinates, theta, TIGHT)
    if not whole:  # another plant than the model: the best that it can do over everything
        for log in logs:
            log.rows = len(log.measured)
        theta = _solve(logs, plants, coordinates, first, LOOSE)
    progress("intervals")
    return _judged(logs, plants, coordinates, theta)


def _bounds(coordinates: Coordinates) -> tuple[Array, Array]:
    start = coordinates.theta({})
    ends = np.column_stack([0.05 * start, 20.0 * start])
    return ends.min(axis=1), ends.max(axis=1)


def _stages(logs: Sequence[ReplayedLog], plants: Plants, coordinates: Coordinates, theta: Array, end: float) -> tuple[Array, bool]:
    """(theta, whether every log counts as a whole)."""
    before = -1
    for _ in range(STAGES):
        for log, residual in zip(logs, plants.each(lambda log: log.residual(theta), logs), strict=True):  # noqa: B023, done before the next
            log.rows = len(residual) if log.steady else reach(residual)
        rows = sum(log.rows for log in logs)
        whole = all(log.whole for log in logs)
        if rows <= before and not whole:
            break
        theta = _solve(logs, plants, coordinates, theta, LOOSE)
        if whole:
            return (_solve(logs, plants, coordinates, theta, end, central=True) if end < LOOSE else theta), True
        before = rows
    return theta, False


def _solve(logs: Sequence[ReplayedLog], plants: Plants, coordinates: Coordinates, theta: Array, end: float, central: bool = False) -> Array:
    """Least squares over the samples that count, with the prior; cut short where the plant does not fit anyway."""
    prior, centre = coordinates.prior, coordinates.theta({})

    def residual(at: Array) -> Array:
        return np.concatenate([*plants.each(lambda log: log.vector(log.residual(at)), logs), (at - centre) / prior])

    def jacobian(at: Array) -> Array:
        return np.vstack([*plants.each(lambda log: log.jacobian(at, central), logs), np.diag(1 / prior)])

    first = residual(theta)
    fits = float(first @ first) < HOPELESS**2 * len(first)
    most = 8 if central or not fits else 25
    found = least_squares(residual, theta, jacobian, bounds=_bounds(coordinates), x_scale="jac", ftol=end, xtol=FINE, gtol=None, max_nfev=most)
    return np.asarray(found.x)


def _judged(logs: Sequence[ReplayedLog], plants: Plants, coordinates: Coordinates, theta: Array) -> JointFit:
    """Covariance H^-1 M H^-1: H the curvature; M what noise, its correlation where the plant does not fit, and rounding move."""
    n = len(theta)
    prior = np.diag(coordinates.prior**-2)
    curvature, meat, rounding = prior.copy(), prior.copy(), np.zeros((n, n))
    gaps, rows = {}, {}
    for log, (h, m, b, gap) in zip(logs, plants.each(lambda log: _log_terms(log, theta), logs), strict=True):
        curvature += h
        meat += m
        rounding += b
        gaps[log.name], rows[log.name] = gap, (log.rows, len(log.measured))
    scale = np.sqrt(np.diag(curvature))
    inverse = np.linalg.inv(curvature / np.outer(scale, scale)) / np.outer(scale, scale)
    covariance = inverse @ (meat + rounding) @ inverse
    total = np.diag(coordinates.covariance(covariance))
    borrowed = np.diag(coordinates.covariance(inverse @ prior @ inverse)) / total
    sources = {}
    for i, name in enumerate(coordinates.names):
        relative = math.sqrt(total[i]) / abs(coordinates.nominal[i])
        sources[name] = "none" if relative > TOLD else "sheet" if borrowed[i] > BORROWED else "logs"
    share = float(np.max(np.diag(inverse @ rounding @ inverse) / np.diag(covariance)))
    return JointFit(coordinates, theta, covariance, sources, gaps, rows, share)


def _log_terms(log: ReplayedLog, theta: Array) -> tuple[Array, Array, Array, float]:
    """(J'J, what noise moves, what rounding moves, gap) of one log at theta."""
    jacobian, residual = log.jacobian(theta, central=True), log.vector(log.residual(theta))
    channels = len(log.columns)
    curvature = jacobian.T @ jacobian
    meat = np.zeros_like(curvature)
    for c in range(channels):
        part, rest = jacobian[c::channels], residual[c::channels]
        meat += part.T @ part * max(1.0, _long_run_variance(rest))
    moved = np.zeros_like(curvature)
    if log.rounded:
        rng = np.random.default_rng(0)
        base = log.simulate(theta)
        for _ in range(ROUNDINGS):
            push = jacobian.T @ log.vector(log.simulate(theta, other_rounding(log.commands, rng)) - base)
            moved += np.outer(push, push) / ROUNDINGS
    counting = residual[residual != 0.0]
    return curvature, meat, moved, float(np.sqrt(np.mean(counting**2))) if len(counting) else math.nan


def _long_run_variance(values: Array) -> float:
    """Variance times the number of samples that say the same; 1 for the sensors' white noise."""
    n = len(values)
    if n == 0:
        return 1.0
    power = float(values @ values) / n
    if n < 4 * LAGS or power == 0.0:
        return power
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(values, size)
    correlation = np.fft.irfft(spectrum * np.conj(spectrum), size)[1:LAGS] / (n * power)
    small = np.flatnonzero(correlation < 4 / math.sqrt(n))
    end = int(small[0]) if len(small) else len(correlation)
    return power * (1.0 + 2.0 * float(correlation[:end].sum()))
