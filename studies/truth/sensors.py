"""Sensors of the rig, compiled: per channel lag, crosstalk, scale, offset, hold and converter, after the noise of Table 3.3."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

PARTNER = np.array([1, 0, 3, 2, 5, 4, 7, 6])
STAGES = 4  # most first-order stages of a lag
WINDOW = 256  # samples, longest running mean


@njit
def _lagged(s, value, memory, history, k, period):
    """Channel behind its lag: equal first-order stages (exact for a ramp within a sample) or a running mean."""
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
        before = memory[2 * j + 1]
        memory[2 * j] = fade * memory[2 * j] + (1.0 - fade - share) * before + share * value
        memory[2 * j + 1] = value
        value = memory[2 * j]
    return value


@njit
def sense(sensor, true, noise, chance, k, period, memory, history, hold, last, out):
    """Write the eight readings of sample k. `noise`: its noise in each channel's unit; `chance`: uniform draws for holds."""
    time = k * period
    lagged = np.empty(8)
    for i in range(8):
        lagged[i] = true[i]
        if sensor[i].lag > 0.0:
            if k == 0:
                memory[i, :] = true[i]
                history[i, :] = true[i]
            lagged[i] = _lagged(sensor[i], true[i], memory[i], history[i], k, period)
    for i in range(8):
        s = sensor[i]
        value = lagged[i] + s.cross * lagged[PARTNER[i]]
        value *= s.gain * (s.gain_negative if value < 0.0 else 1.0)
        if s.cubic != 0.0:
            value += s.cubic * s.cubic_at * (value / s.cubic_at) ** 3
        if s.full > 0.0:
            value /= (1.0 + (value / s.full) ** 8) ** 0.125
        built = 1.0 - math.exp(-time / s.bias_time) if s.bias_time > 0.0 else 1.0
        value += s.bias * built + s.drift * time + s.noise * noise[i]
        if s.step > 0.0:
            value = s.step * (math.floor(value / s.step) if s.step_floor > 0.0 else math.floor(value / s.step + 0.5))
        if s.dropout > 0.0:
            if hold[i] > 0:
                hold[i] -= 1
                value = last[i]
            elif chance[i] < s.dropout:
                hold[i] = int(s.hold)
        last[i] = value
        out[i] = value
