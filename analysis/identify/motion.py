"""The thesis' tests of a moving axis: m (Eq. 4-2), C (Eq. C-3), F_d and F_s (Eq. C-1, C-2), from measured forces and speeds alone.

While a piston slides, v(t) - v(0) = (1/m) * integral of (f_a - f_c) - (C/m) * (s - s(0)) - ((F_d sgn v + F_w)/m) * t: a straight
regression of the measured speed on signals that are integrals, hence good as free of noise, with its own v(0) for each slide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from analysis.identify.interval import Estimate, quantile
from pyfmi_runner.campaign import Campaign
from pyfmi_runner.log import PERIOD, SIGMA, STROKE_X, STROKE_Z, Log
from pyfmi_runner.smoothing import smooth_axis

__all__ = ["Breakaway", "Motion", "Signals", "Sliding", "breakaways", "free_signals", "sliding", "stops"]

Array = NDArray[np.float64]
THRESHOLD = 0.01  # m/s, "motion begins" (C.1), and half-width of the stick band (Eq. 3-18)
HALF = 8  # samples either side over which the speed is averaged
SHORTEST = 60  # samples of a slide that counts
LONGEST = 400  # samples before it that are looked at
REST = 100  # samples of rest before a break-away
TOUCH = 0.8  # N, above which something is touched
NEAR = {"x": 3e-3, "z": 1e-3}  # m from an end stop: not counted
STROKE = {"x": STROKE_X, "z": STROKE_Z}


@dataclass(frozen=True, eq=False)
class Signals:
    """One stretch of a log over which an axis was free."""

    log: str
    axis: str
    time: Array  # s
    position: Array  # m, smoothed
    speed: Array  # m/s, as measured
    calm: Array  # m/s, averaged over HALF samples either side
    drive: Array  # N, f_a - f_c
    actuator: Array  # N, f_a
    landing: NDArray[np.bool_]  # about a touch-down, where the contact force jumps between two samples


def free_signals(campaign: Campaign, axis: str) -> list[Signals]:
    """Every stretch over which the axis is not clamped."""
    found = []
    kernel = np.ones(2 * HALF + 1) / (2 * HALF + 1)
    for run in campaign:
        log = run.log
        free = ~run.setup.clamp_signal(axis, log.time)
        position = smooth_axis(log[axis], log[f"v_{axis}"], SIGMA[axis], SIGMA[f"v_{axis}"]).position
        calm = np.convolve(np.pad(log[f"v_{axis}"], HALF, mode="edge"), kernel, mode="valid")
        for a, b in _stretches(free):
            rows = slice(a, b)
            drive = log[f"f_a{axis}"] - log[f"f_{axis}"]
            found.append(
                Signals(
                    log.name, axis, log.time[rows], position[rows], log[f"v_{axis}"][rows], calm[rows], drive[rows],
                    log[f"f_a{axis}"][rows], near_landings(log)[rows],
                )  # fmt: skip
            )
    return found


def landings(log: Log) -> NDArray[np.intp]:
    """First samples of each contact."""
    force = np.hypot(log["f_x"], log["f_z"])
    loose = np.convolve(force < TOUCH, np.ones(10), mode="full")[: len(force)] >= 9
    return np.flatnonzero(loose[:-1] & (force[1:] >= TOUCH)) + 1


def near_landings(log: Log, reach: int = 3) -> NDArray[np.bool_]:
    """Samples within `reach` of a touch-down."""
    near = np.zeros(len(log), dtype=np.bool_)
    for row in landings(log):
        near[max(0, row - reach) : row + reach + 1] = True
    return near


def _stretches(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


@dataclass(frozen=True)
class Motion:
    """Parameters of one axis from its slides. Both levels only where it slid both ways; else F_d is given for the nominal F_w."""

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
    """Stretches beyond the stick band and off the end stops, cut clear of both by the averaging's length."""
    found = []
    for s in stretches:
        clear = (s.position > NEAR[s.axis]) & (s.position < STROKE[s.axis] - NEAR[s.axis]) & ~s.landing
        noise = 4 * SIGMA[f"v_{s.axis}"] / math.sqrt(2 * HALF + 1)
        for way in (1.0, -1.0):
            for a, b in _stretches(clear & (way * s.calm > THRESHOLD + noise)):
                a, b = a + HALF, b - HALF
                if b - a >= SHORTEST:
                    found.append(Sliding(s, a, b, way))
    return found


def sliding(stretches: Sequence[Signals], cable: float) -> Motion | None:
    """m, C, F_d (and F_w where the axis slid both ways). cable: F_w [N] where it cannot be told. None without enough slides."""
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


def _regress(design: Array, speed: Array, found: Sequence[Sliding], cable: float, both: bool, noise: float) -> Motion | None:
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
        variance = (covariance[i, i] - 2 * value * covariance[0, i] + value**2 * covariance[0, 0]) / p[0] ** 2
        return Estimate(float(value), math.sqrt(max(float(variance), 0.0)), reach)

    m = Estimate(float(1 / p[0]), math.sqrt(float(covariance[0, 0])) / p[0] ** 2, reach)
    return Motion(m, ratio(1), ratio(2), ratio(3) if both else None, len(found), both)


@dataclass(frozen=True)
class Breakaway:
    """One start of motion: the force over the cable's at which v passes 0.01 m/s (C.1), and at which the piston let go."""

    log: str
    time: float  # s, v passes 0.01 m/s
    way: float  # +1 or -1
    by_rule: float  # N, as in Eq. C-1
    corrected: float  # N, less what the force gained while the mass came up to 0.01 m/s


def breakaways(stretches: Sequence[Signals], m: float, C: float, cable: float) -> list[Breakaway]:
    """Every start from rest. m [kg], C [N s/m], cable: F_w [N]."""
    found = []
    for s in stretches:
        net = _calmed(s.drive) - cable
        resting = np.abs(s.calm) < 0.4 * THRESHOLD
        beyond = np.abs(s.calm) > THRESHOLD
        for k in np.flatnonzero(beyond[1:] & ~beyond[:-1]) + 1:
            way = math.copysign(1.0, s.calm[k])
            first = max(0, k - LONGEST)
            if _was_at_rest(resting[first:k]) and way * net[k] > 0:
                rows = slice(first, k + 1)
                level = _onset(way * net[rows], way * s.speed[rows], m, C)
                found.append(Breakaway(s.log, float(s.time[k]), way, float(way * net[k]), level))
    return found


def _was_at_rest(still: NDArray[np.bool_]) -> bool:
    """REST samples of rest somewhere before, and nothing but starting since."""
    runs = _stretches(still)
    return bool(runs) and runs[-1][1] - runs[-1][0] >= REST


def _calmed(values: Array) -> Array:
    kernel = np.ones(2 * HALF + 1) / (2 * HALF + 1)
    return np.asarray(np.convolve(np.pad(values, HALF, mode="edge"), kernel, mode="valid"))


def _onset(net: Array, speed: Array, m: float, C: float) -> float:
    """The break-away level with which m v' = net - level - C v, from where net passes it, comes closest to the measured speed."""
    fade = 1.0 - C / m * PERIOD

    def misfit(level: float) -> float:
        held = np.flatnonzero(net < level)
        onset = int(held[-1]) + 1 if len(held) else 0
        excess = net[onset:] - level
        push = np.concatenate([[0.0], 0.5 * (excess[1:] + excess[:-1])]) if len(excess) else excess
        ahead = lfilter([PERIOD / m], [1.0, -fade], push)
        return float(np.sum(speed[:onset] ** 2) + np.sum((speed[onset:] - ahead) ** 2))

    return float(minimize_scalar(misfit, bounds=(0.6 * net[-1], net[-1]), method="bounded", options={"xatol": 1e-3}).x)


def stops(stretches: Sequence[Signals], direction: float, cable: float) -> list[float]:
    """F_d by Eq. C-2: the force over the cable's at which a piston that slid freely falls below 0.01 m/s."""
    found = []
    for s in stretches:
        for part in slides([s]):
            end = min(part.b + 3 * HALF, len(s.calm) - 1)
            if part.way * s.calm[end] > THRESHOLD or part.way != direction:
                continue
            k = part.b - HALF + int(np.argmax(part.way * s.calm[part.b - HALF : end + 1] < THRESHOLD))
            if not 3 * NEAR[s.axis] < s.position[k] < STROKE[s.axis] - 3 * NEAR[s.axis]:
                continue  # an end stop held it
            found.append(float(part.way * (_calmed(s.drive)[k] - cable)))
    return found
