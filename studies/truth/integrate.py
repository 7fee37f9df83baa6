"""Dormand-Prince 5(4) with error control over one command segment; every change of a discrete mode is located by bisection.

Within a step the modes are frozen, so the rates are smooth; a step whose end has other modes is cut back to where they change.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from studies.truth.friction import SMOOTH, bristle_rate
from studies.truth.plant import CREEP, MODES, STATES, WIDTH, plant_modes, plant_rates, settle

_A = np.zeros((7, 6))
_A[1, :1] = 1 / 5
_A[2, :2] = 3 / 40, 9 / 40
_A[3, :3] = 44 / 45, -56 / 15, 32 / 9
_A[4, :4] = 19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729
_A[5, :5] = 9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656
_A[6, :6] = 35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84
_C = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
_E = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])  # 5th minus 4th order

_SCALE = np.full(STATES, 1e-4)  # size of an error of 1 in each state, at tolerance 1
_SCALE[[0, WIDTH]] = 1e-6  # m
_SCALE[[1, WIDTH + 1]] = 1e-5  # m/s
_SCALE[[2, 3, WIDTH + 2, WIDTH + 3]] = 1e-3  # N
_SCALE[[4, WIDTH + 4]] = 0.1  # N/s
_SCALE[[6, 7, 8, 9, WIDTH + 6, WIDTH + 7, WIDTH + 8, WIDTH + 9]] = 1e-3  # N
_SCALE[CREEP] = 1e-3  # N
MAX_STEP = 1e-3  # s
BISECTIONS = 24  # 1 ms / 2^24 = 6e-11 s
MAX_EVENTS = 200  # per segment; past them the segment goes on without locating


@njit
def _stages(y, time, h, demand, clamped, modes, axis, contact, profile, edge, standoff, k, trial):
    """One step of size h from y: writes the end state to `trial`, the stage rates to `k` (k[0] must hold the rates at y)."""
    for stage in range(1, 7):
        for i in range(STATES):
            total = 0.0
            for j in range(stage):
                total += _A[stage, j] * k[j, i]
            trial[i] = y[i] + h * total
        plant_rates(trial, time + _C[stage] * h, demand, clamped, modes, axis, contact, profile, edge, standoff, k[stage])


@njit
def _error(h, k):
    """Largest local error over its scale."""
    worst = 0.0
    for i in range(STATES):
        error = 0.0
        for j in range(7):
            error += _E[j] * k[j, i]
        worst = max(worst, abs(h * error) / _SCALE[i])
    return worst


@njit
def _changed(one, other):
    for i in range(MODES):
        if one[i] != other[i]:
            return True
    return False


@njit
def _first_step(y, axis, modes, span):
    """Step that the bristles of a smooth friction law allow."""
    h = span
    for i in range(2):
        if modes[i] == SMOOTH:
            h = min(h, 1.5 / (bristle_rate(axis[i], y[i * WIDTH + 1]) + 1.0))
    return h


@njit
def advance(y, modes, time, span, demand, clamped, tolerance, max_step, axis, contact, profile, edge, standoff):
    """Advance state and modes in place by `span` seconds under constant valve demand; returns the number of located events."""
    k, trial, ahead = np.empty((7, STATES)), np.empty(STATES), np.empty(MODES, np.int64)
    end, events = time + span, 0
    plant_modes(y, time, clamped, axis, contact, profile, edge, standoff, ahead)
    modes[:] = ahead
    settle(y, axis, modes, clamped)
    h = min(max_step, _first_step(y, axis, modes, span))
    while end - time > 1e-12:
        h = min(h, max_step)
        if h > 0.999999 * (end - time):
            h = end - time
        plant_rates(y, time, demand, clamped, modes, axis, contact, profile, edge, standoff, k[0])
        _stages(y, time, h, demand, clamped, modes, axis, contact, profile, edge, standoff, k, trial)
        error = _error(h, k) / tolerance
        if error > 1.0 and h > 1e-7:
            h *= max(0.2, 0.9 * error**-0.2)
            continue
        grow = min(4.0, 0.9 * max(error, 1e-6) ** -0.2)
        plant_modes(trial, time + h, clamped, axis, contact, profile, edge, standoff, ahead)
        if _changed(ahead, modes) and events < MAX_EVENTS:
            events += 1
            low, high = 0.0, h
            for _ in range(BISECTIONS):
                if high - low < 1e-11:
                    break
                middle = 0.5 * (low + high)
                _stages(y, time, middle, demand, clamped, modes, axis, contact, profile, edge, standoff, k, trial)
                plant_modes(trial, time + middle, clamped, axis, contact, profile, edge, standoff, ahead)
                if _changed(ahead, modes):
                    high = middle
                else:
                    low = middle
            _stages(y, time, high, demand, clamped, modes, axis, contact, profile, edge, standoff, k, trial)
            plant_modes(trial, time + high, clamped, axis, contact, profile, edge, standoff, ahead)
            time += high
        else:
            time += h
            h *= grow
        y[:] = trial
        if _changed(ahead, modes):
            modes[:] = ahead
            settle(y, axis, modes, clamped)
    return events
