"""Sensors of the rig, compiled: per channel lag, crosstalk, scale, offset, noise of Table 3.3,
converter and hold.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from pneugantry.truth.parameters import Record
from pneugantry.truth.random_term import term_value

PARTNER = np.array([1, 0, 3, 2, 5, 4, 7, 6])
# a force beside each channel: the actuator's, or for that one the contact's
FORCE_BESIDE = np.array([6, 7, 6, 7, 6, 7, 4, 5])
SENSORS = 5  # row of the first channel in the random terms
STAGES = 4  # most first-order stages of a lag
WINDOW = 256  # samples, longest running mean


class Memory(NamedTuple):
    """State of the eight channels: lag stages, their past values, samples left of a hold, the last
    readings, and where each play stands.
    """

    stages: np.ndarray
    history: np.ndarray
    hold: np.ndarray
    last: np.ndarray
    play: np.ndarray


class Luck(NamedTuple):
    """Random numbers: noise (n, 8) in the channels' units, chance (n, 10) uniform."""

    noise: np.ndarray
    chance: np.ndarray


class Chain(NamedTuple):
    """The eight channels: their records, the random terms of all places, the sample period [s] and
    what they remember.
    """

    sensor: np.ndarray
    terms: np.ndarray
    period: float
    m: Memory


@njit
def memory() -> Memory:
    """Fresh state."""
    return Memory(
        np.zeros((8, 2 * STAGES)),
        np.zeros((8, WINDOW)),
        np.zeros(8, np.int64),
        np.zeros(8),
        np.zeros(8),
    )


@njit
def _lagged(
    s: Record, value: float, stages: np.ndarray, history: np.ndarray, k: int, period: float
) -> float:
    """Channel behind its lag: equal first-order stages (exact for a ramp within a sample) or a
    running mean.
    """
    if s.lag_stages < 0.5:
        history[k % WINDOW] = value
        length = 2.0 * s.lag / period
        whole = min(int(length), WINDOW - 2)
        total = 0.5 * value
        for j in range(1, whole + 1):
            total += history[max(k - j, 0) % WINDOW]
        part = length - whole
        return (total + part * history[max(k - whole - 1, 0) % WINDOW]) / (whole + 0.5 + part)
    count = int(s.lag_stages)
    tau = s.lag / count
    fade = math.exp(-period / tau)
    share = 1.0 - tau / period * (1.0 - fade)
    for j in range(count):
        before = stages[2 * j + 1]
        stages[2 * j] = fade * stages[2 * j] + (1.0 - fade - share) * before + share * value
        stages[2 * j + 1] = value
        value = stages[2 * j]
    return value


@njit
def sense(chain: Chain, true: np.ndarray, luck: Luck, k: int, out: np.ndarray) -> None:
    """Write the eight readings of sample k."""
    sensor, terms, period, m = chain.sensor, chain.terms, chain.period, chain.m
    noise, chance = luck.noise[k], luck.chance[k]
    time = k * period
    lagged = np.empty(8)
    for i in range(8):
        lagged[i] = true[i]
        if sensor[i].lag > 0.0:
            if k == 0:
                m.stages[i, :] = true[i]
                m.history[i, :] = true[i]
            lagged[i] = _lagged(sensor[i], true[i], m.stages[i], m.history[i], k, period)
    for i in range(8):
        s = sensor[i]
        value = lagged[i] + s.cross * lagged[PARTNER[i]]
        value *= s.gain * (s.gain_negative if value < 0.0 else 1.0)
        if s.cubic != 0.0:
            value += s.cubic * s.cubic_at * (value / s.cubic_at) ** 3
        if s.play > 0.0:
            m.play[i] = min(max(m.play[i], value - s.play), value + s.play)
            value += s.play_share * (m.play[i] - value)
        if s.cyclic != 0.0:
            value += s.cyclic * math.sin(2.0 * math.pi * lagged[i] / s.cyclic_pitch)
        if terms[SENSORS + i, 0] != 0.0:
            value += term_value(
                terms[SENSORS + i], (lagged[i], lagged[PARTNER[i]], time, lagged[FORCE_BESIDE[i]])
            )
        if s.full > 0.0:
            value /= (1.0 + (value / s.full) ** 8) ** 0.125
        built = 1.0 - math.exp(-time / s.bias_time) if s.bias_time > 0.0 else 1.0
        value += s.bias * built + s.drift * time + s.noise * noise[i]
        if s.hum != 0.0:
            value += s.hum * math.sin(2.0 * math.pi * s.hum_hz * time)
        if s.step > 0.0:
            value = s.step * (
                math.floor(value / s.step)
                if s.step_floor > 0.0
                else math.floor(value / s.step + 0.5)
            )
        if s.dropout > 0.0:
            if m.hold[i] > 0:
                m.hold[i] -= 1
                value = m.last[i]
            elif chance[i] < s.dropout:
                m.hold[i] = int(s.hold)
        m.last[i] = value
        out[i] = value
