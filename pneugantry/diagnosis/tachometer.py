"""A lagging tachometer: what it says of a speed, and what position and speed can be known to be
behind what it says.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from math import factorial

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import expm

from pyfmi_runner.log import PERIOD

__all__ = ["lag_of", "sensed_speed", "undone"]

Array = NDArray[np.float64]
CHANGE = 1.5e-3  # m/s by which a carriage's speed changes in a millisecond, RMS
SHORTEST = 1e-9  # s, a lag that is none
DOUBLINGS = 14  # 16 s, in samples
PADE = 5  # order in which a running mean's delay is taken
_PADE = np.array(
    [
        factorial(2 * PADE - k)
        * factorial(PADE)
        / (factorial(2 * PADE) * factorial(k) * factorial(PADE - k))
        for k in range(PADE + 1)
    ]
)


def lag_of(axis: str, sensors: Mapping[str, float]) -> tuple[float, int]:
    """Mean lag [s] of an axis' tachometer, 0 if it has none, and the number of its equal stages; 0
    stages: a running mean.
    """
    return sensors.get(f"sensors.tau_v_{axis}", 0.0), round(
        sensors.get(f"sensors.stages_v_{axis}", 1.0)
    )


def sensed_speed(true: Array, axis: str, sensors: Mapping[str, float]) -> Array:
    """What a lagging tachometer says of a true speed (N,)."""
    tau, stages = lag_of(axis, sensors)
    if tau <= 0:
        return true
    true = np.ascontiguousarray(true)
    if stages == 0:
        return _running_mean(true, 2 * tau / PERIOD)
    for _ in range(stages):
        true = _first_order(true, tau / stages / PERIOD)
    return true


@njit(cache=True)
def _first_order(speed: Array, lag: float) -> Array:
    """A lag of `lag` samples, settled at the first; exact for a speed that is straight between
    samples.
    """
    result = np.empty(len(speed))
    keep = np.exp(-1.0 / lag)
    now = 1.0 - lag * (1.0 - keep)
    result[0] = speed[0]
    for k in range(1, len(speed)):
        result[k] = keep * result[k - 1] + now * speed[k] + (1.0 - keep - now) * speed[k - 1]
    return result


@njit(cache=True)
def _running_mean(speed: Array, span: float) -> Array:
    """Mean over the last `span` samples (not a whole number), the first value before the first."""
    result = np.empty(len(speed))
    integral = np.zeros(len(speed))  # from the first sample
    for k in range(len(speed)):
        if k > 0:
            integral[k] = integral[k - 1] + 0.5 * (speed[k - 1] + speed[k])
        back = k - span
        if span < 1e-6:
            result[k] = speed[k]
        elif back <= 0:
            result[k] = (integral[k] - back * speed[0]) / span
        else:
            j = int(back)
            share = back - j
            result[k] = (
                integral[k]
                - integral[j]
                - share * (speed[j] + 0.5 * share * (speed[j + 1] - speed[j]))
            ) / span
    return result


def undone(
    position: Array,
    speed: Array,
    sigma_position: float,
    sigma_speed: float,
    tau: float,
    stages: int,
) -> tuple[Array, Array]:
    """True position [m] and speed [m/s], (N,) each, from measured ones with their RMS noise, the
    tachometer lagging by tau > 0.

    Fixed-interval (Rauch-Tung-Striebel) smoother, at its steady gains, of a carriage whose speed
    walks at random and of the lag's own states; at the start all speeds are the first that was
    read.
    """
    tau = max(tau, SHORTEST)
    step, gain, back = _gains(tau, stages, sigma_position, sigma_speed)
    measured = np.ascontiguousarray(np.column_stack([position, speed]), dtype=np.float64)
    rates = _motion(tau, stages)
    settled = np.array([1.0, *np.linalg.solve(rates[2:, 2:], -rates[2:, 1])])
    states = _smoothed(measured, step, gain, _read(stages), back, settled)
    return np.ascontiguousarray(states[:, 0]), np.ascontiguousarray(states[:, 1])


def _read(stages: int) -> Array:
    """What the tachometer reads of the states (position, speed, those of the lag)."""
    if stages > 0:
        return np.array([0.0, 0.0, *[0.0] * (stages - 1), 1.0])
    return np.array([0.0, 0.0, *(2 * _PADE[j + 1] if j % 2 == 0 else 0.0 for j in range(PADE))])


def _motion(tau: float, stages: int) -> Array:
    """Rates of the states by the states. A running mean over T = 2 tau is (1 - e^-p) / p with p = T
    d/dt; of the delay's Padé approximant, N(-p) / N(p), it leaves 2 odd(N)(p) / (p N(p)).
    """
    count = stages or PADE
    rates = np.zeros((2 + count, 2 + count))
    rates[0, 1] = 1.0
    if stages == 0:
        rates[2:, 2:] = np.diag(np.ones(PADE - 1), 1)
        rates[-1, 2:] = -_PADE[:-1] / _PADE[-1]
        rates[-1, 1] = 1.0 / _PADE[-1]
        rates[2:] /= 2 * tau
    else:
        for i in range(2, 2 + count):
            rates[i, i - 1], rates[i, i] = stages / tau, -stages / tau
    return rates


@lru_cache(maxsize=64)
def _gains(
    tau: float, stages: int, sigma_position: float, sigma_speed: float
) -> tuple[Array, Array, Array]:
    """Transition (n, n) over a sample, filter gain (n, 2) and smoother gain (n, n)."""
    rates = _motion(tau, stages)
    step = expm(rates * PERIOD)
    jump = CHANGE * _ramp_response(rates)  # the speed changes evenly over a sample
    read = np.zeros((2, len(step)))
    read[0, 0], read[1] = 1.0, _read(stages)
    noise = np.diag([sigma_position**2, sigma_speed**2])
    before = _settled_variance(step, np.outer(jump, jump), read.T @ np.linalg.inv(noise) @ read)
    gain = np.linalg.solve(read @ before @ read.T + noise, read @ before).T
    after = before - gain @ read @ before
    back = np.linalg.lstsq(before, step @ after, rcond=None)[
        0
    ].T  # a lag shorter than a sample has states that are all but one
    return np.ascontiguousarray(step), np.ascontiguousarray(gain), np.ascontiguousarray(back)


def _ramp_response(rates: Array) -> Array:
    """States (n,) after a sample over which the speed has risen evenly by 1."""
    n = len(rates)
    ramp = np.zeros((n + 1, n + 1))
    ramp[:n, :n], ramp[1, n] = rates, 1.0 / PERIOD
    return np.asarray(expm(ramp * PERIOD)[:n, n])


def _settled_variance(step: Array, added: Array, information: Array) -> Array:
    """Variance (n, n) of the predicted states once it has settled: the filter's Riccati equation
    from no variance at all, by doubling.

    Solvers that take it from its invariant subspace break down where a lag is far shorter than a
    sample.
    """
    transition, gathered, variance = step.T, information, added
    for _ in range(DOUBLINGS):
        mixed = np.linalg.solve(
            np.eye(len(step)) + gathered @ variance, np.column_stack([transition, gathered])
        )
        moved, held = mixed[:, : len(step)], mixed[:, len(step) :]
        further = variance + transition.T @ variance @ moved
        transition, gathered, variance = (
            transition @ moved,
            gathered + transition @ held @ transition.T,
            0.5 * (further + further.T),
        )
    return np.asarray(variance)


@njit(cache=True)
def _smoothed(
    measured: Array, step: Array, gain: Array, read: Array, back: Array, settled: Array
) -> Array:
    """States (N, n): a filter with constant gains forwards, a smoother backwards; `settled`: (n -
    1,) speeds per speed at the start.
    """
    count, n = len(measured), len(step)
    predicted, states = np.empty((count, n)), np.empty((count, n))
    predicted[0, 0] = measured[0, 0]
    predicted[0, 1:] = settled * measured[0, 1]
    for k in range(count):
        if k > 0:
            _times(step, states[k - 1], predicted[k])
        expected = 0.0
        for j in range(n):
            expected += read[j] * predicted[k, j]
        off_position, off_speed = measured[k, 0] - predicted[k, 0], measured[k, 1] - expected
        for j in range(n):
            states[k, j] = predicted[k, j] + gain[j, 0] * off_position + gain[j, 1] * off_speed
    later, change = np.empty(n), np.empty(n)
    for k in range(count - 2, -1, -1):
        for j in range(n):
            later[j] = states[k + 1, j] - predicted[k + 1, j]
        _times(back, later, change)
        for j in range(n):
            states[k, j] += change[j]
    return states


@njit(cache=True)
def _times(matrix: Array, vector: Array, result: Array) -> None:
    """Matrix times vector into `result`; for a few states a call of BLAS takes ten
    times as long.
    """
    for i in range(len(result)):
        total = 0.0
        for j in range(len(vector)):
            total += matrix[i, j] * vector[j]
        result[i] = total
