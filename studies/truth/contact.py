"""Contact of the tool with the workpiece edge (Eq. 4-3, 4-4), compiled."""

from __future__ import annotations

import math

from numba import njit

from studies.truth.workpiece import edge_at

APART, PRESSED, PULLED = 0, 1, 2  # PULLED: deflected, but the force law would pull


@njit
def deflection(edge, standoff, x, z, v_x, v_z):
    """(deflection [m], its rate [m/s], cos theta, sin theta) of the tool against the edge."""
    height, slope = edge_at(edge, x)
    cosine = 1.0 / math.sqrt(1.0 + slope * slope)
    return (z - standoff - height) * cosine, (v_z - slope * v_x) * cosine, cosine, slope * cosine


@njit
def law_force(c, x, depth, rate, creep):
    """Normal force [N] of the touching tool before clipping; `creep` [N] is the force of the viscoelastic branch."""
    spring = c.stiffness * depth
    if c.soft_depth != 0.0:
        spring *= 1.0 - c.soft_depth * math.exp(-(((x - c.soft_at) / c.soft_width) ** 2))
    if c.harden_at > 0.0 and depth > 0.0:
        spring *= 1.0 + (depth / c.harden_at) ** c.harden_power
    if c.loss != 0.0:
        spring *= 1.0 + c.loss * math.tanh(rate / c.loss_rate)
    return spring + creep + (c.damping + c.impact_damping * max(depth, 0.0)) * rate


@njit
def contact_mode(c, x, depth, rate, creep):
    """Discrete mode of the contact."""
    if depth <= 0.0:
        return APART
    return PRESSED if law_force(c, x, depth, rate, creep) > 0.0 else PULLED


@njit
def contact_force(c, mode, x, depth, rate, creep, v_x, v_z, cosine, sine):
    """(f_n, f_x, f_z) [N] of the robot on the workpiece; the drag follows v_t: f_t = mu f_n sgn v_t."""
    if mode != PRESSED:
        return 0.0, 0.0, 0.0
    f_n = law_force(c, x, depth, rate, creep)
    f_t = 0.0
    if c.drag != 0.0:
        v_t = v_x * cosine + v_z * sine
        mu = c.drag * (1.0 + c.drag_stribeck * math.exp(-((v_t / (10.0 * c.drag_speed)) ** 2)))
        f_t = mu * max(f_n, 0.0) * math.tanh(v_t / c.drag_speed)
    return f_n, -f_n * sine + f_t * cosine, f_n * cosine + f_t * sine
