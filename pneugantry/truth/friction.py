"""Friction of a piston, compiled: VDFM as a hybrid system (Eq. 3-18/3-19) and three smooth laws
with bristle states.

VDFM modes. STUCK: F cancels the drive, so m a = -C v; BREAK_UP/DOWN: inside the band with F =
+-F_s; SLIDE_UP/DOWN: outside it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pneugantry.truth.parameters import DAHL, FORCE, IWAN, LEVEL, LUGRE, NODES, VDFM, Record

WORK = 10  # place of the work of friction in the state of an axis
STUCK, BREAK_UP, BREAK_DOWN, SLIDE_UP, SLIDE_DOWN, SMOOTH = 0, 1, 2, 3, 4, 5
IWAN_SHARE = np.array([0.35, 0.30, 0.20, 0.15])  # shares of the limit force
IWAN_SOFT = np.array([0.4, 1.0, 2.5, 6.0])  # yield deflections relative to one another


@njit
def along_stroke(profile: np.ndarray, kind: int, position: float, stroke: float) -> float:
    """Linear interpolation in a stroke profile."""
    place = min(max(position / stroke, 0.0), 1.0) * (NODES - 1)
    k = min(int(place), NODES - 2)
    s = place - k
    return profile[kind, k] * (1.0 - s) + profile[kind, k + 1] * s


@njit
def coulomb_level(a: Record, profile: np.ndarray, s: np.ndarray, f_n: float, time: float) -> float:
    """Factor on F_s and F_d at the states s of the axis."""
    level = along_stroke(profile, LEVEL, s[0], a.stroke)
    if a.load != 0.0:
        level *= 1.0 + a.load * (abs(f_n) / 10.0) ** a.load_exponent
    if a.warm != 0.0:
        heat = s[WORK] / a.warm_work if a.warm_work > 0.0 else time / a.warm_time
        level *= 1.0 - a.warm * (1.0 - math.exp(-heat))
    if a.seal != 0.0:
        level *= 1.0 + a.seal * abs(s[2]) / 100.0
    return level


@njit
def pull_force(a: Record, profile: np.ndarray, position: float) -> float:
    """Cable and other forces towards -axis [N]."""
    return a.cable + along_stroke(profile, FORCE, position, a.stroke)


@njit
def sliding_force(a: Record, speed: float) -> float:
    """Coulomb force [N] at |v| outside the band, level 1."""
    if a.stribeck <= 0.0:
        return a.dynamic
    over = max(speed - a.band, 0.0) / a.stribeck
    fade = (
        math.exp(-(over**a.stribeck_shape)) if a.stribeck_shape > 0.0 else 1.0 / (1.0 + over * over)
    )
    return a.dynamic + (a.static - a.dynamic) * fade


@njit
def breakaway(a: Record, level: float, rest: float, sense: float) -> float:
    """F_s [N] against a drive of the given sign after `rest` seconds of standstill."""
    force = a.static * level * (1.0 + a.direction * sense)
    if a.dwell != 0.0:
        force *= 1.0 + a.dwell * math.log10(1.0 + rest / a.dwell_from)
    return force


@njit
def friction_mode(a: Record, drive: float, v: float, level: float, rest: float) -> int:
    """Discrete mode at drive f_a - f_c - F_w [N] and speed v [m/s]."""
    if a.law != VDFM:
        return SMOOTH
    if v > a.band:
        return SLIDE_UP
    if v < -a.band:
        return SLIDE_DOWN
    if drive > breakaway(a, level, rest, 1.0):
        return BREAK_UP
    if drive < -breakaway(a, level, rest, -1.0):
        return BREAK_DOWN
    return STUCK


@njit
def vdfm_force(a: Record, mode: int, drive: float, v: float, level: float, rest: float) -> float:
    """F [N] of the velocity-dependent law with its mode frozen."""
    if mode == SLIDE_UP:
        return sliding_force(a, v) * level * (1.0 + a.direction)
    if mode == SLIDE_DOWN:
        return -sliding_force(a, -v) * level * (1.0 - a.direction)
    if mode == BREAK_UP:
        return breakaway(a, level, rest, 1.0)
    if mode == BREAK_DOWN:
        return -breakaway(a, level, rest, -1.0)
    return drive


@njit
def smooth_force(a: Record, v: float, level: float, bristle: np.ndarray, rate: np.ndarray) -> float:
    """F [N] of a smooth law; writes the rates of the four bristle states (forces at unit level,
    N/s).
    """
    sense = 1.0 if v > 0.0 else (-1.0 if v < 0.0 else 0.0)
    level *= 1.0 + a.direction * sense
    limit = a.dynamic * a.limit_ratio
    if a.law != LUGRE and a.stribeck > 0.0:
        level *= sliding_force(a, abs(v) + a.band) / a.dynamic
    if a.law == DAHL:
        rest = max(1.0 - bristle[0] / limit * sense, 0.0)
        rate[0] = a.stiffness * v * rest**a.dahl_exponent
        return bristle[0] * level
    if a.law == LUGRE:
        steady = limit
        if a.stribeck > 0.0:
            steady += (a.static - a.dynamic) * a.limit_ratio * math.exp(-((v / a.stribeck) ** 2))
        rate[0] = a.stiffness * (v - abs(v) * bristle[0] / steady)
        return level * (bristle[0] + a.bristle_damping * rate[0] / a.stiffness)
    total = 0.0
    if a.law == IWAN:
        scale = 0.0
        for j in range(4):
            scale += IWAN_SHARE[j] / IWAN_SOFT[j]
        for j in range(4):
            yields = limit * IWAN_SHARE[j]
            spring = a.stiffness * IWAN_SHARE[j] / IWAN_SOFT[j] / scale
            share = bristle[j] / yields
            rate[j] = spring * (v - 0.5 * (abs(v) * share + v * abs(share)) * abs(share) ** 3)
            total += bristle[j]
    return total * level


@njit
def speed_force(a: Record, v: float, work: float) -> float:
    """Friction [N] that is a smooth function of speed alone, against v: viscous, square, cube."""
    viscous = a.viscous
    if a.thin != 0.0:
        viscous *= 1.0 - a.thin * (1.0 - math.exp(-work / a.thin_work))
    return viscous * v + a.quadratic * v * abs(v) + a.cubic * v * v * v


@njit
def bristle_rate(a: Record, v: float) -> float:
    """Fastest rate [1/s] of the smooth law's bristles at speed v."""
    return a.stiffness * abs(v) / max(a.dynamic * a.limit_ratio, 1e-9)
