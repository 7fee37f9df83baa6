"""The gantry as a hybrid system, compiled: rates with frozen modes, the modes of a state, the jumps
between them.

Equation per axis (Eq. 4-1): m a = f_a - f_c - F_w - F - C v. State vector, two axes of 14 and one
of the contact: s, v, f_a, stage, stage rate, supply loss, four bristles, work of friction, rest,
place and speed of the base; then the creep force of the contact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from pneugantry.truth.contact import APART, Deflection, Load, contact_load, contact_mode, deflection
from pneugantry.truth.friction import (
    SLIDE_DOWN,
    SLIDE_UP,
    SMOOTH,
    STUCK,
    WORK,
    coulomb_level,
    friction_mode,
    pull_force,
    smooth_force,
    speed_force,
    vdfm_force,
)
from pneugantry.truth.parameters import Record
from pneugantry.truth.random_term import term_value
from pneugantry.truth.valve import valve_rates

WIDTH = 14  # states of an axis
STATES = 2 * WIDTH + 1
CREEP = 2 * WIDTH
REST, BASE = 11, 12
MODES = 5  # friction x, friction z, contact, stop x, stop z
TOUCH = 2
FRICTION, CONTACT = 2, 4  # rows of `Plant.terms`; the valves come first


class Plant(NamedTuple):
    """What the compiled plant reads: the records of `Rig`, the table of the edge, its stand-off
    [m] and the random terms.
    """

    axis: np.ndarray
    contact: np.ndarray
    profile: np.ndarray
    edge: np.ndarray
    standoff: float
    terms: np.ndarray


class Acting(NamedTuple):
    """Constant over a segment: settled force of each valve [N], and which axes are clamped."""

    demand: np.ndarray
    clamped: np.ndarray


class Surroundings(NamedTuple):
    """What acts on an axis from outside its own laws."""

    f_c: float  # N, contact force along the axis
    f_n: float  # N, normal contact force
    other: float  # m/s^2, acceleration of the other axis
    time: float  # s
    term: np.ndarray  # random term of its friction


@njit
def press(y: np.ndarray, plant: Plant) -> Deflection:
    """Deflection of the tool at state y."""
    return deflection(plant.edge, plant.standoff, y[0], y[WIDTH], y[1], y[WIDTH + 1])


@njit
def load(y: np.ndarray, mode: int, plant: Plant) -> Load:
    """Contact force at state y with the contact mode frozen."""
    return contact_load(
        plant.contact[0], mode, y[0], press(y, plant), y[CREEP], plant.terms[CONTACT]
    )


@njit
def axis_drive(a: Record, profile: np.ndarray, s: np.ndarray, around: Surroundings) -> float:
    """f_a - f_c - F_w plus what pushes from outside and from the other axis [N]; s: the states of
    the axis alone.
    """
    drive = s[2] - around.f_c - pull_force(a, profile, s[0])
    if a.coupling != 0.0:
        push = a.coupling * around.other
        if a.coupling_limit > 0.0:
            push /= 1.0 + abs(push) / a.coupling_limit
        drive += push
    if a.shake != 0.0:
        drive += a.shake * math.sin(2.0 * math.pi * a.shake_hz * around.time + a.shake_phase)
    if around.term[0] != 0.0:
        drive -= term_value(around.term, (s[0], s[1], abs(s[2]), around.f_n))
    return drive


@njit
def base_pull(a: Record, s: np.ndarray) -> float:
    """Acceleration [m/s^2] that spring and damper of an elastic base give it, before
    the axis acts.
    """
    omega = a.base_omega
    return -omega * omega * s[BASE] - 2.0 * a.base_zeta * omega * s[BASE + 1]


@njit
def base_stuck(a: Record, s: np.ndarray) -> float:
    """Acceleration [m/s^2] of a base that carries a stuck axis along."""
    drag = a.viscous * s[1] * a.base_ratio / a.mass
    return (base_pull(a, s) + drag) / (1.0 + a.base_ratio)


@njit
def motion_rates(
    a: Record,
    profile: np.ndarray,
    s: np.ndarray,
    mode: int,
    around: Surroundings,
    rates: np.ndarray,
) -> float:
    """Fill the rates of position, speed, bristles, work, rest and base of a free axis; returns its
    acceleration. s, rates: of this axis alone.
    """
    v = s[1]
    level = coulomb_level(a, profile, s, around.f_n, around.time)
    drive = axis_drive(a, profile, s, around)
    if mode == SMOOTH:
        force = smooth_force(a, v, level, s[6:10], rates[6:10])
    else:
        force = vdfm_force(a, mode, drive, v, level, s[REST])
    rates[0] = v
    rates[1] = (drive - force - speed_force(a, v, s[WORK])) / a.mass
    if a.base_ratio > 0.0:
        rates[BASE] = s[BASE + 1]
        if mode == STUCK:
            rates[BASE + 1] = base_stuck(a, s)
        else:
            rates[BASE + 1] = base_pull(a, s) - a.base_ratio * rates[1]
            rates[1] -= rates[BASE + 1]
    rates[WORK] = abs(force * v)
    rates[REST] = 0.0 if mode in (SLIDE_UP, SLIDE_DOWN) else 1.0
    return rates[1]


@njit
def plant_rates(
    y: np.ndarray, time: float, act: Acting, modes: np.ndarray, plant: Plant, rates: np.ndarray
) -> None:
    """Write dy/dt with the modes frozen."""
    rates[:] = 0.0
    d = press(y, plant)
    c = plant.contact[0]
    f = contact_load(c, modes[TOUCH], y[0], d, y[CREEP], plant.terms[CONTACT])
    a_x = 0.0
    for i in range(2):
        a, profile = plant.axis[i], plant.profile[i]
        s, r = y[i * WIDTH : (i + 1) * WIDTH], rates[i * WIDTH : (i + 1) * WIDTH]
        valve_rates(a, profile, act.demand[i], s, r, plant.terms[i])
        term = plant.terms[FRICTION + i]
        around = Surroundings(f.f_z if i == 1 else f.f_x, f.f_n, a_x, time, term)
        if act.clamped[i] or modes[3 + i] != 0:
            r[REST] = 1.0
        else:
            a_x = motion_rates(a, profile, s, modes[i], around, r)
    if c.creep_stiffness > 0.0:
        rates[CREEP] = -y[CREEP] / c.creep_time
        if modes[TOUCH] != APART:
            rates[CREEP] += c.creep_stiffness * d.rate


@njit
def axis_modes(
    a: Record, profile: np.ndarray, s: np.ndarray, around: Surroundings, clamped: bool
) -> tuple[int, int]:
    """(friction mode, stop mode) of one axis; stop -1 or +1 while the piston is held at 0 or at the
    end of stroke. s: the states of this axis alone.
    """
    v = s[1]
    level = coulomb_level(a, profile, s, around.f_n, around.time)
    drive = axis_drive(a, profile, s, around)
    if a.base_ratio > 0.0:
        drive -= a.mass * base_stuck(a, s)
    mode = friction_mode(a, drive, v, level, s[REST])
    side = -1 if s[0] <= 0.0 else (1 if s[0] >= a.stroke else 0)
    if clamped or side == 0 or v * side < 0.0:
        return mode, 0
    if mode == SMOOTH:
        force = smooth_force(a, 0.0, level, s[6:10], np.empty(4))
    else:
        force = vdfm_force(a, mode, drive, 0.0, level, 0.0)
    return mode, side if v * side > 0.0 or (drive - force) * side >= 0.0 else 0


@njit
def plant_modes(
    y: np.ndarray, time: float, clamped: np.ndarray, plant: Plant, modes: np.ndarray
) -> None:
    """Write the discrete modes of state y."""
    d = press(y, plant)
    term = plant.terms[CONTACT]
    modes[TOUCH] = contact_mode(plant.contact[0], y[0], d, y[CREEP], term)
    f = contact_load(plant.contact[0], modes[TOUCH], y[0], d, y[CREEP], term)
    around = Surroundings(f.f_x, f.f_n, 0.0, time, plant.terms[FRICTION])
    x, z = plant.axis[0], plant.axis[1]
    s_x, s_z = y[:WIDTH], y[WIDTH : 2 * WIDTH]
    modes[0], modes[3] = axis_modes(x, plant.profile[0], s_x, around, clamped[0])
    a_x = 0.0
    if z.coupling != 0.0 and not clamped[0] and modes[3] == 0:
        a_x = motion_rates(x, plant.profile[0], s_x, modes[0], around, np.empty(WIDTH))
    around = Surroundings(f.f_z, f.f_n, a_x, time, plant.terms[FRICTION + 1])
    modes[1], modes[4] = axis_modes(z, plant.profile[1], s_z, around, clamped[1])


@njit
def settle(y: np.ndarray, axis: np.ndarray, modes: np.ndarray, clamped: np.ndarray) -> None:
    """Jumps of the state on entering new modes: an inelastic end stop, and the rest that ends when
    sliding starts.
    """
    for i in range(2):
        o = i * WIDTH
        if modes[3 + i] != 0:
            y[o + 1] = 0.0
            y[o] = 0.0 if modes[3 + i] < 0 else axis[i].stroke
        if clamped[i]:
            y[o + 1] = 0.0
        if modes[i] in (SLIDE_UP, SLIDE_DOWN):
            y[o + REST] = 0.0
