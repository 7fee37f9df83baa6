"""Frequency response of a loop with its exact delay, its stability limit and its margins.

The loop is L(s) = G(s) exp(-s T) or, sampled, L(z); the feedback is negative. Frequencies in rad/s.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from typing import NamedTuple

import control
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

__all__ = ["Crossing", "Margins", "Response", "grid", "margins", "response", "stability_limit"]

Response = Callable[[NDArray[np.float64]], NDArray[np.complex128]]  # frequencies [rad/s] -> L
POINTS = 6000  # of a frequency grid
HIGHEST = 1e5  # rad/s, of a continuous loop's grid


class Crossing(NamedTuple):
    """Where a proportional gain brings the closed loop to the brink."""

    gain: float  # V/N where the loop is N/V
    frequency: float  # rad/s of the oscillation there


class Margins(NamedTuple):
    """Margins of a loop with its controller; None where there is no crossing."""

    gain_margin: float | None  # factor the gain may grow by
    phase_crossover: float | None  # rad/s
    phase_margin: float | None  # degrees
    crossover: float | None  # rad/s, highest frequency at which |L| = 1
    sensitivity_peak: float  # largest |1/(1 + L)|
    bandwidth: float | None  # rad/s, lowest frequency at which |1/(1 + L)| reaches 1/sqrt 2


def response(model: control.StateSpace, delay: float = 0.0) -> Response:
    """L of a one-input one-output state space, continuous or sampled, and a delay [s] that is exact
    (no Pade).
    """

    def at(frequencies: NDArray[np.float64]) -> NDArray[np.complex128]:
        s = 1j * np.asarray(frequencies, float)
        point = np.exp(s * model.dt) if model.dt else s
        n = model.nstates
        forced = np.linalg.solve(
            point[:, None, None] * np.eye(n) - model.A,
            np.broadcast_to(model.B.astype(complex), (len(s), n, 1)),
        )
        return np.asarray(((model.C @ forced)[:, 0, 0] + model.D[0, 0]) * np.exp(-s * delay))

    return at


def grid(period: float | None = None, lowest: float = 1e-2) -> NDArray[np.float64]:
    """Frequencies [rad/s], evenly spread in the logarithm up to half the sampling rate."""
    return np.geomspace(lowest, math.pi / period if period else HIGHEST, POINTS)


def _roots(
    values: NDArray[np.float64], at: Callable[[float], float], frequencies: NDArray[np.float64]
) -> list[float]:
    found = []
    for i in np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0):
        found.append(float(brentq(at, frequencies[i], frequencies[i + 1], xtol=1e-12, rtol=1e-14)))
    return found


def _one(loop: Response, w: float) -> complex:
    return complex(loop(np.array([w]))[0])


def _phase_crossings(
    loop: Response, frequencies: NDArray[np.float64], period: float | None
) -> list[tuple[float, float]]:
    """(frequency, |L|) wherever L is real and negative; half the sampling rate counts, L is real
    there.
    """
    at = loop(frequencies)
    roots = _roots(at.imag, lambda w: _one(loop, w).imag, frequencies)
    crossings = [(w, -value.real) for w in roots if (value := _one(loop, w)).real < 0]
    if period and (end := _one(loop, math.pi / period)).real < 0:
        crossings.append((math.pi / period, -end.real))
    return crossings


def stability_limit(loop: Response, period: float | None = None) -> Crossing | None:
    """Smallest proportional gain at which the closed loop is on the brink; None if it is stable for
    every gain.

    For a loop whose own poles are all stable; the crossings of L with the negative real axis,
    located to rounding.
    """
    crossings = _phase_crossings(loop, grid(period), period)
    if not crossings:
        return None
    frequency, size = max(crossings, key=lambda crossing: crossing[1])
    return Crossing(1.0 / size, frequency)


def margins(loop: Response, period: float | None = None) -> Margins:
    """Margins of a loop that includes its controller."""
    w = grid(period)
    at = loop(w)
    limit = stability_limit(loop, period)
    unity = _roots(np.log(np.abs(at)), lambda v: math.log(abs(_one(loop, v))), w)
    phases = [(math.degrees(cmath.phase(-_one(loop, v))), v) for v in unity]
    phase_margin = min(phases, key=lambda pair: abs(pair[0]))[0] if phases else None
    distance = np.abs(1 + at)
    reach = _roots(distance - math.sqrt(2.0), lambda v: abs(1 + _one(loop, v)) - math.sqrt(2.0), w)
    return Margins(
        limit.gain if limit else None,
        limit.frequency if limit else None,
        phase_margin,
        max(unity) if unity else None,
        float(1 / distance.min()),
        min(reach) if reach else None,
    )
