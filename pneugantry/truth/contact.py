"""Contact of the tool with the workpiece edge (Eq. 4-3, 4-4), compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from pneugantry.truth.parameters import Record
from pneugantry.truth.random_term import term_value
from pneugantry.truth.workpiece import edge_at

TOUCHED = 1e-3  # m, deflection above which a random term acts in full
APART, PRESSED, PULLED = 0, 1, 2  # PULLED: deflected, but the force law would pull


class Deflection(NamedTuple):
    """How far the tool is pressed against the edge."""

    depth: float  # m, > 0 touches
    rate: float  # m/s
    cosine: float  # of the edge's slope angle theta
    sine: float
    v_t: float  # m/s, speed along the edge


class Load(NamedTuple):
    """Contact force of the robot on the workpiece [N]."""

    f_n: float
    f_x: float
    f_z: float


@njit
def deflection(
    edge: np.ndarray, standoff: float, x: float, z: float, v_x: float, v_z: float
) -> Deflection:
    """Deflection of a tool at (x, z) with speed (v_x, v_z)."""
    height, slope = edge_at(edge, x)
    cosine = 1.0 / math.sqrt(1.0 + slope * slope)
    sine = slope * cosine
    return Deflection(
        (z - standoff - height) * cosine,
        (v_z - slope * v_x) * cosine,
        cosine,
        sine,
        v_x * cosine + v_z * sine,
    )


@njit
def law_force(c: Record, x: float, d: Deflection, creep: float, term: np.ndarray) -> float:
    """Normal force [N] of the touching tool before clipping; `creep` [N] is the force of the
    viscoelastic branch.
    """
    spring = c.stiffness * d.depth
    if c.soft_depth != 0.0:
        spring *= 1.0 - c.soft_depth * math.exp(-(((x - c.soft_at) / c.soft_width) ** 2))
    if c.gradient != 0.0:
        spring *= max(1.0 + c.gradient * (x - c.gradient_mid), 0.1)
    if c.harden_at > 0.0 and d.depth > 0.0:
        spring *= 1.0 + (d.depth / c.harden_at) ** c.harden_power
    if c.loss != 0.0:
        spring *= 1.0 + c.loss * math.tanh(d.rate / c.loss_rate)
    if term[0] != 0.0 and d.depth > 0.0:
        share = d.depth / (d.depth + TOUCHED)  # no force at the first touch
        spring += share * term_value(term, (d.depth, d.rate, x, d.v_t))
    damping = c.damping + c.impact_damping * max(d.depth, 0.0) + c.rate_square * abs(d.rate)
    return spring + creep + damping * d.rate


@njit
def contact_mode(c: Record, x: float, d: Deflection, creep: float, term: np.ndarray) -> int:
    """Discrete mode of the contact."""
    if d.depth <= 0.0:
        return APART
    return PRESSED if law_force(c, x, d, creep, term) > 0.0 else PULLED


@njit
def contact_load(
    c: Record, mode: int, x: float, d: Deflection, creep: float, term: np.ndarray
) -> Load:
    """Contact force with the mode frozen; the drag follows the speed along the edge: f_t = mu f_n
    sgn v_t.
    """
    if mode != PRESSED:
        return Load(0.0, 0.0, 0.0)
    f_n = law_force(c, x, d, creep, term)
    f_t = 0.0
    if c.drag != 0.0:
        mu = c.drag * (1.0 + c.drag_stribeck * math.exp(-((d.v_t / (10.0 * c.drag_speed)) ** 2)))
        f_t = mu * max(f_n, 0.0) * math.tanh(d.v_t / c.drag_speed)
    return Load(f_n, -f_n * d.sine + f_t * d.cosine, f_n * d.cosine + f_t * d.sine)
