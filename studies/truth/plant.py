"""The gantry as a hybrid system, compiled: rates with frozen modes, the modes of a state, and the exact hits of the end stops.

Equation per axis (Eq. 4-1): m a = f_a - f_c - F_w - F - C v. State vector, two axes of 12 and one of the contact:
s, v, f_a, stage, stage rate, supply loss, four bristles, work of friction, rest; then the creep force of the contact.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from studies.truth.contact import APART, contact_force, contact_mode, deflection
from studies.truth.friction import (
    SLIDE_DOWN,
    SLIDE_UP,
    SMOOTH,
    coulomb_level,
    friction_mode,
    pull_force,
    smooth_force,
    vdfm_force,
)
from studies.truth.valve import valve_rates

WIDTH = 12  # states of an axis
STATES = 2 * WIDTH + 1
CREEP = 2 * WIDTH
WORK, REST = 10, 11
MODES = 5  # friction x, friction z, contact, stop x, stop z
TOUCH = 2


@njit
def loads(y, axis, contact, edge, standoff, modes):
    """(f_n, f_x, f_z, depth, rate) with the contact mode frozen."""
    c = contact[0]
    depth, rate, cosine, sine = deflection(edge, standoff, y[0], y[WIDTH], y[1], y[WIDTH + 1])
    f_n, f_x, f_z = contact_force(c, modes[TOUCH], y[0], depth, rate, y[CREEP], y[1], y[WIDTH + 1], cosine, sine)
    return f_n, f_x, f_z, depth, rate


@njit
def axis_drive(a, profile, y, o, f_c, other):
    """f_a - f_c - F_w plus what the other axis' acceleration `other` [m/s^2] brings [N]."""
    drive = y[o + 2] - f_c - pull_force(a, profile, y[o])
    if a.coupling != 0.0:
        push = a.coupling * other
        if a.coupling_limit > 0.0:
            push /= 1.0 + abs(push) / a.coupling_limit
        drive += push
    return drive


@njit
def axis_rates(a, profile, demand, y, o, mode, held, f_c, f_n, other, time, rates):
    """Fill the rates of one axis; returns its acceleration. `held`: clamped or pressed against an end stop."""
    v = y[o + 1]
    level = coulomb_level(a, profile, y[o], f_n, y[o + WORK], time)
    drive = axis_drive(a, profile, y, o, f_c, other)
    if mode == SMOOTH:
        force = smooth_force(a, v, level, y[o + 6 : o + 10], rates[o + 6 : o + 10])
    else:
        force = vdfm_force(a, mode, drive, v, level, y[o + REST])
    valve_rates(a, profile, demand, y[o], y, o, rates)
    if held:
        rates[o] = rates[o + 1] = 0.0
        return 0.0
    acceleration = (drive - force - a.viscous * v - a.cubic * v * v * v) / a.mass
    rates[o] = v
    rates[o + 1] = acceleration
    rates[o + WORK] = abs(force * v)
    rates[o + REST] = 0.0 if mode == SLIDE_UP or mode == SLIDE_DOWN else 1.0
    return acceleration


@njit
def plant_rates(y, time, demand, clamped, modes, axis, contact, profile, edge, standoff, rates):
    """dy/dt with the modes frozen; `demand` [N] is the settled force of each valve."""
    rates[:] = 0.0
    f_n, f_x, f_z, _, rate = loads(y, axis, contact, edge, standoff, modes)
    held_x, held_z = clamped[0] or modes[3] != 0, clamped[1] or modes[4] != 0
    a_x = axis_rates(axis[0], profile[0], demand[0], y, 0, modes[0], held_x, f_x, f_n, 0.0, time, rates)
    axis_rates(axis[1], profile[1], demand[1], y, WIDTH, modes[1], held_z, f_z, f_n, a_x, time, rates)
    c = contact[0]
    if c.creep_stiffness > 0.0:
        rates[CREEP] = -y[CREEP] / c.creep_time
        if modes[TOUCH] != APART:
            rates[CREEP] += c.creep_stiffness * rate


@njit
def axis_modes(a, profile, y, o, f_c, f_n, other, time, clamped):
    """(friction mode, stop mode) of one axis: stop -1 or +1 while the piston is held at 0 or at the end of stroke."""
    v = y[o + 1]
    level = coulomb_level(a, profile, y[o], f_n, y[o + WORK], time)
    drive = axis_drive(a, profile, y, o, f_c, other)
    mode = friction_mode(a, drive, v, level, y[o + REST])
    if clamped:
        return mode, 0
    side = -1 if y[o] <= 0.0 else (1 if y[o] >= a.stroke else 0)
    if side == 0 or v * side < 0.0:
        return mode, 0
    force = smooth_force(a, 0.0, level, y[o + 6 : o + 10], np.empty(4)) if mode == SMOOTH else vdfm_force(a, mode, drive, 0.0, level, 0.0)
    held = v * side > 0.0 or (drive - force) * side >= 0.0
    return mode, side if held else 0


@njit
def plant_modes(y, time, clamped, axis, contact, profile, edge, standoff, modes):
    """Write the discrete modes of state y."""
    depth, rate, cosine, sine = deflection(edge, standoff, y[0], y[WIDTH], y[1], y[WIDTH + 1])
    c = contact[0]
    modes[TOUCH] = contact_mode(c, y[0], depth, rate, y[CREEP])
    f_n, f_x, f_z = contact_force(c, modes[TOUCH], y[0], depth, rate, y[CREEP], y[1], y[WIDTH + 1], cosine, sine)
    modes[0], modes[3] = axis_modes(axis[0], profile[0], y, 0, f_x, f_n, 0.0, time, clamped[0])
    a_x = 0.0
    if axis[1].coupling != 0.0 and not clamped[0] and modes[3] == 0:
        a_x = axis_rates(
            axis[0], profile[0], 0.0, y, 0, modes[0], False, f_x, f_n, 0.0, time, np.empty(STATES)
        )
    modes[1], modes[4] = axis_modes(axis[1], profile[1], y, WIDTH, f_z, f_n, a_x, time, clamped[1])


@njit
def settle(y, axis, modes, clamped):
    """Jumps of the state on entering new modes: an inelastic end stop, and the rest that ends when sliding starts."""
    for i in range(2):
        o = i * WIDTH
        if modes[3 + i] != 0:
            y[o + 1] = 0.0
            y[o] = 0.0 if modes[3 + i] < 0 else axis[i].stroke
        if clamped[i]:
            y[o + 1] = 0.0
        if modes[i] == SLIDE_UP or modes[i] == SLIDE_DOWN:
            y[o + REST] = 0.0
