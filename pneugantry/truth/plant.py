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


class Surroundings(NamedTuple):
    """What acts on an axis from outside it."""

    f_c: float  # N, contact force along the axis
    f_n: float  # N, normal contact force
    other: float  # m/s^2, acceleration of the other axis
    time: float  # s


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
def axis_drive(
    a: Record, profile: np.ndarray, y: np.ndarray, o: int, around: Surroundings, term: np.ndarray
) -> float:
    """f_a - f_c - F_w plus what pushes from outside and from the other axis [N]."""
    drive = y[o + 2] - around.f_c - pull_force(a, profile, y[o])
    if a.coupling != 0.0:
        push = a.coupling * around.other
        if a.coupling_limit > 0.0:
            push /= 1.0 + abs(push) / a.coupling_limit
        drive += push
    if a.shake != 0.0:
        drive += a.shake * math.sin(2.0 * math.pi * a.shake_hz * around.time + a.shake_phase)
    if term[0] != 0.0:
        drive -= term_value(term, (y[o], y[o + 1], abs(y[o + 2]), around.f_n))
    return drive


@njit
def base_pull(a: Record, y: np.ndarray, o: int) -> float:
    """Acceleration [m/s^2] that spring and damper of an elastic base give it, before
    the axis acts.
    """
    omega = a.base_omega
    return -omega * omega * y[o + BASE] - 2.0 * a.base_zeta * omega * y[o + BASE + 1]


@njit
def base_stuck(a: Record, y: np.ndarray, o: int) -> float:
    """Acceleration [m/s^2] of a base that carries a stuck axis along."""
    drag = a.viscous * y[o + 1] * a.base_ratio / a.mass
    return (base_pull(a, y, o) + drag) / (1.0 + a.base_ratio)


@njit
def motion_rates(
    a: Record,
    profile: np.ndarray,
    y: np.ndarray,
    o: int,
    mode: int,
    around: Surroundings,
    rates: np.ndarray,
    term: np.ndarray,
) -> float:
    """Fill the rates of position, speed, bristles, work, rest and base of a free axis; returns its
    acceleration.
    """
    v = y[o + 1]
    level = coulomb_level(a, profile, y, o, around.f_n, around.time)
    drive = axis_drive(a, profile, y, o, around, term)
    if mode == SMOOTH:
        force = smooth_force(a, v, level, y[o + 6 : o + 10], rates[o + 6 : o + 10])
    else:
        force = vdfm_force(a, mode, drive, v, level, y[o + REST])
    rates[o] = v
    rates[o + 1] = (drive - force - speed_force(a, v, y[o + WORK])) / a.mass
    if a.base_ratio > 0.0:
        rates[o + BASE] = y[o + BASE + 1]
        if mode == STUCK:
            rates[o + BASE + 1] = base_stuck(a, y, o)
        else:
            rates[o + BASE + 1] = base_pull(a, y, o) - a.base_ratio * rates[o + 1]
            rates[o + 1] -= rates[o + BASE + 1]
    rates[o + WORK] = abs(force * v)
    rates[o + REST] = 0.0 if mode in (SLIDE_UP, SLIDE_DOWN) else 1.0
    return rates[o + 1]


@njit
def plant_rates(
    y: np.ndarray,
    time: float,
    demand: np.ndarray,
    clamped: np.ndarray,
    modes: np.ndarray,
    plant: Plant,
    rates: np.ndarray,
) -> None:
    """Write dy/dt with the modes frozen; `demand` [N] is the settled force of each valve."""
    rates[:] = 0.0
    d = press(y, plant)
    c = plant.contact[0]
    f = contact_load(c, modes[TOUCH], y[0], d, y[CREEP], plant.terms[CONTACT])
    a_x = 0.0
    for i in range(2):
        o, a, profile = i * WIDTH, plant.axis[i], plant.profile[i]
        valve_rates(a, profile, demand[i], y, o, rates, plant.terms[i])
        around = Surroundings(f.f_z if i == 1 else f.f_x, f.f_n, a_x, time)
        if clamped[i] or modes[3 + i] != 0:
            rates[o + REST] = 1.0
        else:
            term = plant.terms[FRICTION + i]
            a_x = motion_rates(a, profile, y, o, modes[i], around, rates, term)
    if c.creep_stiffness > 0.0:
        rates[CREEP] = -y[CREEP] / c.creep_time
        if modes[TOUCH] != APART:
            rates[CREEP] += c.creep_stiffness * d.rate


@njit
def axis_modes(
    a: Record,
    profile: np.ndarray,
    y: np.ndarray,
    o: int,
    around: Surroundings,
    clamped: bool,
    term: np.ndarray,
) -> tuple[int, int]:
    """(friction mode, stop mode) of one axis; stop -1 or +1 while the piston is held at 0 or at the
    end of stroke.
    """
    v = y[o + 1]
    level = coulomb_level(a, profile, y, o, around.f_n, around.time)
    drive = axis_drive(a, profile, y, o, around, term)
    if a.base_ratio > 0.0:
        drive -= a.mass * base_stuck(a, y, o)
    mode = friction_mode(a, drive, v, level, y[o + REST])
    side = -1 if y[o] <= 0.0 else (1 if y[o] >= a.stroke else 0)
    if clamped or side == 0 or v * side < 0.0:
        return mode, 0
    if mode == SMOOTH:
        force = smooth_force(a, 0.0, level, y[o + 6 : o + 10], np.empty(4))
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
    around = Surroundings(f.f_x, f.f_n, 0.0, time)
    a = plant.axis[0]
    modes[0], modes[3] = axis_modes(
        a, plant.profile[0], y, 0, around, clamped[0], plant.terms[FRICTION]
    )
    a_x = 0.0
    if plant.axis[1].coupling != 0.0 and not clamped[0] and modes[3] == 0:
        a_x = motion_rates(
            a, plant.profile[0], y, 0, modes[0], around, np.empty(STATES), plant.terms[FRICTION]
        )
    around = Surroundings(f.f_z, f.f_n, a_x, time)
    modes[1], modes[4] = axis_modes(
        plant.axis[1], plant.profile[1], y, WIDTH, around, clamped[1], plant.terms[FRICTION + 1]
    )


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
