"""Valve and chamber (Eq. 4-5), compiled: from the command to the actuator force."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pneugantry.truth.friction import along_stroke
from pneugantry.truth.parameters import LAG, Record
from pneugantry.truth.random_term import term_value

OPEN = 5.0  # N, settled force above which a random term acts in full
PLAYS = 8  # most plays in parallel


@njit
def spool_command(a: Record, u: float, plays: np.ndarray) -> float:
    """Rate-independent part between command and spool [V]; `plays`: play operators and, last, a
    stuck spool.
    """
    if a.play > 0.0:
        count = int(a.play_elements)
        total = 0.0
        for j in range(count):
            half = 0.5 * a.play * (2.0 * (j + 1.0) / (count + 1.0) if count > 1 else 1.0)
            plays[j] = min(max(plays[j], u - half), u + half)
            total += plays[j]
        u = total / count
    if a.spool_stick > 0.0:
        if abs(u - plays[PLAYS]) > a.spool_stick:
            plays[PLAYS] = u
        u = plays[PLAYS]
    if a.dead_band > 0.0:
        over = u - a.dead_centre
        if abs(over) < 0.5 * a.dead_band:
            u = a.dead_centre
        else:
            u -= math.copysign(0.5 * a.dead_band, over)
    return u


@njit
def steady_force(a: Record, u: float, time: float) -> float:
    """Size of the force [N] that the chamber settles to at full supply."""
    over = u - a.offset
    if a.curvature != 0.0 and over > 0.0:
        over *= max(1.0 - a.curvature * over, 0.1)
    if a.drift != 0.0:
        over -= a.drift * (1.0 - math.exp(-time / a.drift_time))
    if a.bidirectional == 0.0:
        if a.knee > 0.0:
            over = (
                0.5 * (over + math.sqrt(over * over + a.knee * a.knee))
                if over > -10.0 * a.knee
                else 0.0
            )
        over = max(over, 0.0)
    force = min(max(a.gain * over, -a.limit if a.bidirectional != 0.0 else 0.0), a.limit)
    if a.cycle != 0.0:
        force *= 1.0 - a.cycle * compressor(a, time)
    return force


@njit
def compressor(a: Record, time: float) -> float:
    """How far the reservoir is drained, 0 full to 1 where the compressor starts: a saw tooth."""
    place = (time / a.cycle_time + a.cycle_phase) % 1.0
    drains = 1.0 - a.cycle_fill
    return place / drains if place < drains else (1.0 - place) / a.cycle_fill


@njit
def valve_rates(
    a: Record,
    profile: np.ndarray,
    demand: float,
    s: np.ndarray,
    rates: np.ndarray,
    term: np.ndarray,
) -> None:
    """Rates of [f_a, stage, stage rate, supply loss] at 2..5 of one axis' states s; `demand` [N] is
    `steady_force`, unsigned; `term`: what no law says.
    """
    f_a, stage, stage_rate, loss = s[2], s[3], s[4], s[5]
    target = a.sign * demand * (1.0 - loss)
    if term[0] != 0.0:
        share = demand / (demand + OPEN)  # a shut valve gives no force
        target += share * term_value(term, (demand, abs(f_a), s[0], s[1]))
    if a.spool_omega > 0.0:
        rates[3] = stage_rate
        rates[4] = (
            a.spool_omega**2 * (target - stage) - 2.0 * a.spool_zeta * a.spool_omega * stage_rate
        )
        target = stage
    elif a.second_lag > 0.0:
        rates[3] = (target - stage) / a.second_lag
        target = stage
    lag = a.lag * along_stroke(profile, LAG, s[0], a.stroke)
    if a.lag_pressure != 0.0:
        lag *= max(1.0 + a.lag_pressure * abs(f_a) / 100.0, 0.1)
    if a.lag_rise != a.lag_fall:
        rising = (target - f_a) * a.sign
        if a.lag_blend > 0.0:
            share = 0.5 + 0.5 * math.tanh(rising / a.lag_blend)
        else:
            share = 1.0 if rising > 0.0 else 0.0
        lag *= a.lag_rise * share + a.lag_fall * (1.0 - share)
    else:
        lag *= a.lag_rise
    rate = (target - f_a) / lag
    if a.leak > 0.0:
        rate -= math.copysign(a.leak * max(abs(f_a) - a.leak_from, 0.0) / lag, f_a)
    if a.slew > 0.0:
        rate = min(max(rate, -a.slew), a.slew)
    rates[2] = rate
    if a.sag != 0.0 or a.sag_flow != 0.0:
        wanted = a.sag * (abs(f_a) / a.limit) ** a.sag_exponent
        pace = a.sag_time if wanted > loss else a.recover_time
        filling = max(rate * a.sign, 0.0) / a.limit
        rates[5] = (wanted - loss) / pace + a.sag_flow * filling
