"""The gantry as a hybrid system, compiled: rates with frozen modes, the modes of a state, the jumps
between them.

Equation per axis (Eq. 4-1): m a = f_a - f_c - F_w - F - C v. State vector, two axes of 12 and one
of the contact: s, v, f_a, stage, stage rate, supply loss, four bristles, work of friction, rest;
then the creep force of the contact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from pneugantry.truth.contact import APART, Deflection, Load, contact_load, contact_mode, deflection
from pneugantry.truth.friction import (
    SLIDE_DOWN,
    SLIDE_UP,
    SMOOTH,
    coulomb_level,
    friction_mode,
    pull_force,
    smooth_force,
    vdfm_force,
)
from pneugantry.truth.parameters import Record
from pneugantry.truth.valve import valve_rates

WIDTH = 12  # states of an axis
STATES = 2 * WIDTH + 1
CREEP = 2 * WIDTH
WORK, REST = 10, 11
MODES = 5  # friction x, friction z, contact, stop x, stop z
TOUCH = 2


class Plant(NamedTuple):
    """What the compiled plant reads: the records of `Rig`, the table of the edge and its stand-off
    [m].
    """

    axis: np.ndarray
    contact: np.ndarray
    profile: np.ndarray
    edge: np.ndarray
    standoff: float


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
    return contact_load(plant.contact[0], mode, y[0], press(y, plant), y[CREEP])


@njit
def axis_drive(
    a: Record, profile: np.ndarray, y: np.ndarray, o: int, around: Surroundings
) -> float:
    """f_a - f_c - F_w plus the push of the other axis [N]."""
    drive = y[o + 2] - around.f_c - pull_force(a, profile, y[o])
    if a.coupling != 0.0:
        push = a.coupling * around.other
        if a.coupling_limit > 0.0:
            push /= 1.0 + abs(push) / a.coupling_limit
        drive += push
    return drive


@njit
def motion_rates(
    a: Record,
    profile: np.ndarray,
    y: np.ndarray,
    o: int,
    mode: int,
    around: Surroundings,
    rates: np.ndarray,
) -> float:
    """Fill the rates of position, speed, bristles, work and rest of a free axis; returns its
    acceleration.
    """
    v = y[o + 1]
    level = coulomb_level(a, profile, y[o], around.f_n, y[o + WORK], around.time)
    drive = axis_drive(a, profile, y, o, around)
    if mode == SMOOTH:
        force = smooth_force(a, v, level, y[o + 6 : o + 10], rates[o + 6 : o + 10])
    else:
        force = vdfm_force(a, mode, drive, v, level, y[o + REST])
    rates[o] = v
    rates[o + 1] = (drive - force - a.viscous * v - a.cubic * v * v * v) / a.mass
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
    f = contact_load(c, modes[TOUCH], y[0], d, y[CREEP])
    a_x = 0.0
    for i in range(2):
        o, a, profile = i * WIDTH, plant.axis[i], plant.profile[i]
        valve_rates(a, profile, demand[i], y[o], y, o, rates)
        around = Surroundings(f.f_z if i == 1 else f.f_x, f.f_n, a_x, time)
        if clamped[i] or modes[3 + i] != 0:
            rates[o + REST] = 1.0
        else:
            a_x = motion_rates(a, profile, y, o, modes[i], around, rates)
    if c.creep_stiffness > 0.0:
        rates[CREEP] = -y[CREEP] / c.creep_time
        if modes[TOUCH] != APART:
            rates[CREEP] += c.creep_stiffness * d.rate


@njit
def axis_modes(
    a: Record, profile: np.ndarray, y: np.ndarray, o: int, around: Surroundings, clamped: bool
) -> tuple[int, int]:
    """(friction mode, stop mode) of one axis; stop -1 or +1 while the piston is held at 0 or at the
    end of stroke.
    """
    v = y[o + 1]
    level = coulomb_level(a, profile, y[o], around.f_n, y[o + WORK], around.time)
    drive = axis_drive(a, profile, y, o, around)
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
    modes[TOUCH] = contact_mode(plant.contact[0], y[0], d, y[CREEP])
    f = contact_load(plant.contact[0], modes[TOUCH], y[0], d, y[CREEP])
    around = Surroundings(f.f_x, f.f_n, 0.0, time)
    a = plant.axis[0]
    modes[0], modes[3] = axis_modes(a, plant.profile[0], y, 0, around, clamped[0])
    a_x = 0.0
    if plant.axis[1].coupling != 0.0 and not clamped[0] and modes[3] == 0:
        a_x = motion_rates(a, plant.profile[0], y, 0, modes[0], around, np.empty(STATES))
    around = Surroundings(f.f_z, f.f_n, a_x, time)
    modes[1], modes[4] = axis_modes(plant.axis[1], plant.profile[1], y, WIDTH, around, clamped[1])


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
