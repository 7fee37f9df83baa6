"""The joint fit's result: parameters with intervals that count sensor noise, rounded commands, and
what the plant does not explain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pneugantry.analysis.identify.chord import Found
from pneugantry.analysis.identify.interval import Estimate
from pneugantry.analysis.identify.parameters import Coordinates
from pneugantry.analysis.identify.replayed import Plants, ReplayedLog, gram
from pneugantry.analysis.identify.rounding import other_rounding

__all__ = ["JointFit", "judged_fit"]

Array = NDArray[np.float64]
ROUNDINGS = 20  # replays with other roundings of the commands
TOLD = 0.25  # relative standard deviation beyond which a parameter is not told
BORROWED = (
    0.5  # share of a parameter's variance from which on it rests on the plant sheet's cable force
)
FITS = 1.1  # gap of a log below which the plant replays it
LAGS = 200  # of blocks, over which the residual's correlation is summed


@dataclass(frozen=True, eq=False)
class JointFit:
    """Parameters by name with their covariance; `sources`: what each rests on.

    "logs": the fit; "sheet": the fit and the plant sheet's cable force; "blocks": a block's own
    test, where the plant does not replay the logs; "none": nothing.
    """

    coordinates: Coordinates
    theta: Array
    covariance: Array  # of theta
    sources: dict[str, str]
    gaps: dict[str, float]  # by log, RMS of the residual that counts, in sensor noise
    rows: dict[str, tuple[int, int]]  # by log, samples that count and that there are

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
        return {
            name: Estimate(values[name], float(s))
            for name, s in zip(self.coordinates.names, sigma, strict=True)
        }

    def sums(self) -> dict[str, Estimate]:
        """F_s and F_d together with the cable force, as the logs show them, for axes whose cable
        force the logs do not tell.
        """
        found = {}
        for i, u in enumerate(self.coordinates.unknowns):
            label = self.coordinates.label(i)
            cable = self.sources.get(f"axis_{u.axis}.F_w")
            if label != u.name and cable == "sheet":
                scale = self.coordinates.scale[i]
                found[label] = Estimate(
                    float(scale * self.theta[i]), float(scale * math.sqrt(self.covariance[i, i]))
                )
        return found


def judged_fit(
    logs: Sequence[ReplayedLog], plants: Plants, coordinates: Coordinates, found: Found
) -> JointFit:
    """Covariance H^-1 M H^-1: H the curvature; M what noise, its correlation where the plant does
    not fit, and rounding move.
    """
    theta, n = found.theta, len(found.theta)
    prior = np.diag(coordinates.prior**-2)
    curvature, meat, rounding = prior.copy(), prior.copy(), np.zeros((n, n))
    gaps, rows = {}, {}
    for log, (h, m, b, gap) in zip(
        logs, plants.each(lambda log: _log_terms(log, found), logs), strict=True
    ):
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
    return JointFit(coordinates, theta, covariance, sources, gaps, rows)


def _log_terms(log: ReplayedLog, found: Found) -> tuple[Array, Array, Array, float]:
    """(J'J, what noise moves, what rounding moves, gap) of one log."""
    theta = found.theta
    jacobian, residual = log.jacobian(found.at, central=True), log.vector(log.residual(theta))
    channels = len(log.columns)
    curvature = gram(jacobian)
    meat = np.zeros_like(curvature)
    for c in range(channels):
        part, rest = jacobian[c::channels], residual[c::channels]
        meat += gram(part) * max(1.0, _long_run_variance(rest))
    moved = np.zeros_like(curvature)
    if log.rounded:
        rng = np.random.default_rng(0)
        base = log.replay(theta)
        for _ in range(ROUNDINGS):
            push = jacobian.T @ log.vector(
                log.simulate(theta, other_rounding(log.commands, rng)) - base
            )
            moved += np.outer(push, push) / ROUNDINGS
    counting = residual[residual != 0.0]
    return (
        curvature,
        meat,
        moved,
        float(np.sqrt(np.mean(counting**2))) if len(counting) else math.nan,
    )


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
