"""Dormand-Prince 5(4) with error control over one command segment; each change of a discrete mode
is located.

Within a step the modes are frozen, so the rates are smooth; a step whose end has other modes is cut
back by bisection to where they change.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from pneugantry.truth.friction import SMOOTH, bristle_rate
from pneugantry.truth.plant import (
    BASE,
    CREEP,
    MODES,
    STATES,
    WIDTH,
    Acting,
    Plant,
    plant_modes,
    plant_rates,
    settle,
)

_A = np.zeros((7, 6))
_A[1, :1] = 1 / 5
_A[2, :2] = 3 / 40, 9 / 40
_A[3, :3] = 44 / 45, -56 / 15, 32 / 9
_A[4, :4] = 19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729
_A[5, :5] = 9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656
_A[6, :6] = 35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84
_C = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
_E = np.array(
    [71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40]
)  # 5th minus 4th order

_SCALE = np.full(STATES, 1e-4)  # size of an error of 1 in each state, at tolerance 1
_SCALE[[0, WIDTH]] = 1e-6  # m
_SCALE[[1, WIDTH + 1]] = 1e-5  # m/s
_SCALE[[2, 3, WIDTH + 2, WIDTH + 3]] = 1e-3  # N
_SCALE[[4, WIDTH + 4]] = 0.1  # N/s
_SCALE[[6, 7, 8, 9, WIDTH + 6, WIDTH + 7, WIDTH + 8, WIDTH + 9]] = 1e-3  # N
_SCALE[[BASE, WIDTH + BASE]] = 1e-6  # m
_SCALE[[BASE + 1, WIDTH + BASE + 1]] = 1e-5  # m/s
_SCALE[CREEP] = 1e-3  # N
MAX_STEP = 1e-3  # s
BISECTIONS = 24  # 1 ms / 2^24 = 6e-11 s
MAX_EVENTS = 200  # per segment; past them the segment goes on without locating


class Accuracy(NamedTuple):
    """tolerance: local error allowed, in units of `_SCALE`; max_step [s]."""

    tolerance: float
    max_step: float


class Scratch(NamedTuple):
    """Stage rates (7, STATES), end state and end modes of the step under trial."""

    k: np.ndarray
    trial: np.ndarray
    ahead: np.ndarray


class Solver(NamedTuple):
    """What is integrated, how accurately, and the working arrays."""

    plant: Plant
    accuracy: Accuracy
    w: Scratch


@njit
def solver_of(plant: Plant, accuracy: Accuracy) -> Solver:
    """A solver with working arrays of its own."""
    w = Scratch(np.empty((7, STATES)), np.empty(STATES), np.empty(MODES, np.int64))
    return Solver(plant, accuracy, w)


@njit
def _step(
    y: np.ndarray, time: float, h: float, modes: np.ndarray, act: Acting, solver: Solver
) -> bool:
    """One step of size h from y (w.k[0]: rates at y) to w.trial; true when its end has other modes,
    w.ahead.
    """
    w = solver.w
    for stage in range(1, 7):
        for i in range(STATES):
            total = 0.0
            for j in range(stage):
                total += _A[stage, j] * w.k[j, i]
            w.trial[i] = y[i] + h * total
        plant_rates(w.trial, time + _C[stage] * h, act, modes, solver.plant, w.k[stage])
    plant_modes(w.trial, time + h, act.clamped, solver.plant, w.ahead)
    changed = False
    for i in range(MODES):
        changed = changed or w.ahead[i] != modes[i]
    return changed


@njit
def _error(h: float, k: np.ndarray) -> float:
    """Largest local error over its scale."""
    worst = 0.0
    for i in range(STATES):
        error = 0.0
        for j in range(7):
            error += _E[j] * k[j, i]
        worst = max(worst, abs(h * error) / _SCALE[i])
    return worst


@njit
def _first_step(y: np.ndarray, axis: np.ndarray, modes: np.ndarray, span: float) -> float:
    """Step that the bristles of a smooth friction law allow."""
    h = span
    for i in range(2):
        if modes[i] == SMOOTH:
            h = min(h, 1.5 / (bristle_rate(axis[i], y[i * WIDTH + 1]) + 1.0))
    return h


@njit
def _locate(
    y: np.ndarray, time: float, h: float, modes: np.ndarray, act: Acting, solver: Solver
) -> float:
    """Shortest step, by bisection, whose end has other modes; leaves that end in w."""
    low, high = 0.0, h
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if _step(y, time, middle, modes, act, solver):
            high = middle
        else:
            low = middle
    _step(y, time, high, modes, act, solver)
    return high


@njit
def advance(
    y: np.ndarray, modes: np.ndarray, time: float, span: float, act: Acting, solver: Solver
) -> int:
    """Advance state and modes in place by `span` seconds under constant valve demand; returns the
    located events.
    """
    plant, accuracy, w = solver.plant, solver.accuracy, solver.w
    end, events = time + span, 0
    plant_modes(y, time, act.clamped, plant, modes)
    settle(y, plant.axis, modes, act.clamped)
    h = _first_step(y, plant.axis, modes, span)
    while end - time > 1e-12:
        h = min(h, accuracy.max_step)
        if h > 0.999999 * (end - time):
            h = end - time
        plant_rates(y, time, act, modes, plant, w.k[0])
        changed = _step(y, time, h, modes, act, solver)
        error = _error(h, w.k) / accuracy.tolerance
        if error > 1.0 and h > 1e-7:
            h *= max(0.2, 0.9 * error**-0.2)
            continue
        taken = h
        if changed and events < MAX_EVENTS:
            events += 1
            taken = _locate(y, time, h, modes, act, solver)
        else:
            h *= min(4.0, 0.9 * max(error, 1e-6) ** -0.2)
        time += taken
        y[:] = w.trial
        if changed:
            modes[:] = w.ahead
            settle(y, plant.axis, modes, act.clamped)
    return events
