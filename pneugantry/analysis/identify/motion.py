"""m, C, F_d and F_w of a sliding axis from measured forces and speeds alone.

While a piston slides, v(t) - v(0) = (1/m) * integral of (f_a - f_c) - (C/m) * (s - s(0)) - ((F_d
sgn v + F_w)/m) * t: a straight regression of the measured speed on signals that are integrals,
hence good as free of noise, with its own v(0) for each slide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pneugantry.analysis.identify.interval import Estimate, quantile
from pneugantry.analysis.identify.signals import (
    HALF,
    NEAR,
    STROKE,
    THRESHOLD,
    Signals,
    stretches_of,
)
from pyfmi_runner.log import PERIOD, SIGMA

__all__ = ["Motion", "Sliding", "slides", "sliding"]

Array = NDArray[np.float64]
SHORTEST = 60  # samples of a slide that counts


@dataclass(frozen=True)
class Motion:
    """Parameters of one axis from its slides. Both levels only where it slid both ways; else F_d is
    given for the nominal F_w.
    """

    m: Estimate
    C: Estimate
    F_d: Estimate
    F_w: Estimate | None
    slides: int
    both_ways: bool


@dataclass(frozen=True)
class Sliding:
    """Rows a..b-1 of one free stretch, sliding one way: +1 or -1."""

    signals: Signals
    a: int
    b: int
    way: float


def slides(stretches: Sequence[Signals]) -> list[Sliding]:
    """Stretches beyond the stick band and off the end stops, cut clear of both by the averaging's
    length.
    """
    found = []
    for s in stretches:
        clear = (
            (s.position > NEAR[s.axis]) & (s.position < STROKE[s.axis] - NEAR[s.axis]) & ~s.landing
        )
        noise = 4 * SIGMA[f"v_{s.axis}"] / math.sqrt(2 * HALF + 1)
        for way in (1.0, -1.0):
            for a, b in stretches_of(clear & (way * s.calm > THRESHOLD + noise)):
                a, b = a + HALF, b - HALF
                if b - a >= SHORTEST:
                    found.append(Sliding(s, a, b, way))
    return found


def sliding(stretches: Sequence[Signals], cable: float) -> Motion | None:
    """m, C, F_d (and F_w where the axis slid both ways). cable: F_w [N] where it cannot be told.
    None without enough slides.
    """
    found = slides(stretches)
    if not found:
        return None
    axis = found[0].signals.axis
    both = {s.way for s in found} == {1.0, -1.0}
    rows = sum(s.b - s.a for s in found)
    design = np.zeros((rows, 4 + len(found)))
    speed = np.empty(rows)
    at = 0
    for k, s in enumerate(found):
        n, part = s.b - s.a, slice(s.a, s.b)
        here = slice(at, at + n)
        t = s.signals.time[part] - s.signals.time[s.a]
        drive = s.signals.drive[part]
        impulse = np.concatenate([[0.0], np.cumsum(0.5 * (drive[1:] + drive[:-1])) * PERIOD])
        design[here, 0] = impulse
        design[here, 1] = -(s.signals.position[part] - s.signals.position[s.a])
        design[here, 2] = -s.way * t
        design[here, 3] = -t
        design[here, 4 + k] = 1.0
        speed[here] = s.signals.speed[part]
        at += n
    return _regress(design, speed, found, cable, both, SIGMA[f"v_{axis}"])


def _regress(
    design: Array, speed: Array, found: Sequence[Sliding], cable: float, both: bool, noise: float
) -> Motion | None:
    if not both:  # F_w goes along with the impulse
        design = np.delete(design, 3, axis=1)
        # the cable's share of the impulse: -F_w t / m, with t = -way * column 2
        design[:, 0] += found[0].way * design[:, 2] * cable
    norms = np.sqrt(np.sum(design**2, axis=0))
    if (norms == 0).any():
        return None
    q, r = np.linalg.qr(design / norms)
    if np.min(np.abs(np.diag(r))) < 1e-9:
        return None
    p = np.linalg.solve(r, q.T @ speed) / norms
    rest = speed - design @ p
    freedom = len(speed) - len(p)
    scale = max(noise, math.sqrt(float(rest @ rest) / freedom))
    inverse = np.linalg.inv(r) / norms[:, None]
    covariance = scale**2 * inverse @ inverse.T
    reach = quantile(freedom)

    def ratio(i: int) -> Estimate:
        """p[i] / p[0] and its spread."""
        value = p[i] / p[0]
        variance = (
            covariance[i, i] - 2 * value * covariance[0, i] + value**2 * covariance[0, 0]
        ) / p[0] ** 2
        return Estimate(float(value), math.sqrt(max(float(variance), 0.0)), reach)

    m = Estimate(float(1 / p[0]), math.sqrt(float(covariance[0, 0])) / p[0] ** 2, reach)
    return Motion(m, ratio(1), ratio(2), ratio(3) if both else None, len(found), both)
