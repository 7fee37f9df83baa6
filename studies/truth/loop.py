"""The 1 kHz loop, compiled: sensors, command (recorded, programmed or from the controller), valve, plant."""

from __future__ import annotations

import numpy as np
from numba import njit

from studies.truth.controller import control
from studies.truth.integrate import advance
from studies.truth.plant import MODES, STATES, WIDTH, loads
from studies.truth.sensors import STAGES, WINDOW, sense
from studies.truth.valve import PLAYS, spool_command, steady_force

PERIOD = 1e-3  # s, sample period by the rig's own clock
LONGEST = 512  # samples, longest delay
NEVER = 2**62


@njit
def _delayed(a, axis_index, u_true, k, period):
    """(command before the switch, command after it, when it switches [s into the sample]) of a pure transport delay."""
    samples = a.delay / period
    whole = int(samples)
    part = (samples - whole) * period
    after = u_true[max(k - whole, 0), axis_index]
    before = u_true[max(k - whole - 1, 0), axis_index]
    if k - whole < 0:
        after = a.offset if a.delay > 0.0 else after
    if k - whole - 1 < 0:
        before = a.offset
    return before, after, part


@njit
def _valves(y, modes, k, period, u, plays, clamped, tolerance, max_step, axis, contact, profile, edge, standoff):
    """One sample of valve and plant: at most three segments of constant valve demand."""
    cuts = np.array([0.0, 0.0, 0.0, period])
    demand = np.empty(2)
    values = np.empty((2, 2))
    for i in range(2):
        values[i, 0], values[i, 1], cuts[1 + i] = _delayed(axis[i], i, u, k, period)
    first = min(cuts[1], cuts[2])
    second = max(cuts[1], cuts[2])
    switch = (cuts[1], cuts[2])
    cuts[1], cuts[2] = first, second
    events = 0
    for part in range(3):
        span = cuts[part + 1] - cuts[part]
        if span < 1e-9:
            continue
        for i in range(2):
            raw = values[i, 1] if cuts[part] >= switch[i] - 1e-9 else values[i, 0]
            demand[i] = steady_force(axis[i], spool_command(axis[i], raw, plays[i]), k * period)
        events += advance(
            y, modes, k * period + cuts[part], span, demand, clamped, tolerance, max_step, axis, contact, profile, edge, standoff
        )
    return events


@njit
def _controlled(timing, gains, integral, readings, u, k, k_contact, f_nd, v_td, chance, kept):
    """The command pair that acts from sample k; `kept` remembers computed commands, row k, and the last command."""
    t = timing[0]
    late = int(t.sense_delay + t.jitter * chance[8] + 0.5) if t.jitter > 0.0 else int(t.sense_delay + 0.5)
    stalled = t.burst > 0.0 and (k % 1000) < t.burst
    if (k - k_contact) % max(int(t.divider), 1) == 0 and not chance[9] < t.miss and not stalled:
        kept[k, 0], kept[k, 1] = control(gains, integral, f_nd, v_td, readings[max(k - late, 0)])
    else:
        kept[k] = kept[k - 1]
    source = k - int(t.act_delay + 0.5)
    u[k] = kept[source] if source >= k_contact else u[k_contact - 1]


@njit
def run_loop(
    start, release, commands, reference, k_contact, gains, noise, chance, tolerance, max_step, axis, contact, sensor, timing, profile, edge,
    standoff,
):  # fmt: skip
    """Run one log. start: s of x, z [m]; release[i]: sample at which axis i is let go; commands (n, 2) [V]: used before `k_contact`;
    reference (n, 2): f_nd [N], v_td [m/s]; noise (n, 8); chance (n, 10) uniform draws.
    Returns (true channels (n, 8), readings (n, 8), commands (n, 2), located events)."""
    n = commands.shape[0]
    true, readings, u, kept = np.empty((n, 8)), np.empty((n, 8)), commands.copy(), commands.copy()
    y, modes, clamped = np.zeros(STATES), np.zeros(MODES, np.int64), np.empty(2, np.bool_)
    y[0], y[WIDTH] = start[0], start[1]
    integral = np.zeros(4)
    plays = np.zeros((2, PLAYS + 1))
    memory, history = np.zeros((8, 2 * STAGES)), np.zeros((8, WINDOW))
    hold, last = np.zeros(8, np.int64), np.zeros(8)
    period = PERIOD * (1.0 + timing[0].clock)
    events = 0
    for i in range(2):
        plays[i, :] = commands[0, i] if n > 0 else 0.0
    for k in range(n):
        for i in range(2):
            clamped[i] = k < release[i]
        _, f_x, f_z, _, _ = loads(y, axis, contact, edge, standoff, modes)
        true[k, 0], true[k, 1], true[k, 2], true[k, 3] = y[0], y[WIDTH], y[1], y[WIDTH + 1]
        true[k, 4], true[k, 5], true[k, 6], true[k, 7] = f_x, f_z, y[2], y[WIDTH + 2]
        sense(sensor, true[k], noise[k], chance[k], k, period, memory, history, hold, last, readings[k])
        if k >= k_contact:
            _controlled(timing, gains, integral, readings, u, k, k_contact, reference[k, 0], reference[k, 1], chance[k], kept)
        events += _valves(
            y, modes, k, period, u, plays, clamped, tolerance, max_step, axis, contact, profile, edge, standoff
        )
    return true, readings, u, events


