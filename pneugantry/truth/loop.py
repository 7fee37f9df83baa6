"""The 1 kHz loop, compiled: sensors, command (recorded, programmed or from the controller), valve,
plant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from pneugantry.truth.controller import control
from pneugantry.truth.integrate import Accuracy, Solver, advance, solver_of
from pneugantry.truth.kept import kept
from pneugantry.truth.parameters import Record
from pneugantry.truth.plant import MODES, STATES, TOUCH, WIDTH, Acting, Plant, load
from pneugantry.truth.sensors import Chain, Luck, memory, sense
from pneugantry.truth.valve import PLAYS, spool_command, steady_force

PERIOD = 1e-3  # s, sample period by the rig's own clock
NEVER = 2**62


class Task(NamedTuple):
    """What a log prescribes."""

    start: np.ndarray  # x, z [m]
    release: np.ndarray  # sample at which each axis is let go
    commands: np.ndarray  # (n, 2) [V], acting before `contact_row`
    reference: np.ndarray  # (n, 2): f_nd [N], v_td [m/s]
    contact_row: int  # sample at which the controller takes over
    gains: np.ndarray


class State(NamedTuple):
    """The rig's own state: of the plant, its modes, and the plays of the valves."""

    y: np.ndarray
    modes: np.ndarray
    plays: np.ndarray


class Signals(NamedTuple):
    """Rows of a log as they come: readings (n, 8), commands as they act and as computed (n, 2)."""

    readings: np.ndarray
    u: np.ndarray
    kept: np.ndarray


class Switch(NamedTuple):
    """Command of a valve within a sample: `before` until `at` [s], then `after` [V]."""

    before: float
    after: float
    at: float


@njit
def delayed(a: Record, u: np.ndarray, k: int, period: float) -> Switch:
    """Pure transport delay of the commands u [V] up to sample k; before the first one the valve is
    shut.
    """
    samples = a.delay / period
    whole = int(samples)
    after = u[k - whole] if k >= whole else a.offset
    before = u[k - whole - 1] if k > whole else a.offset
    return Switch(before, after, (samples - whole) * period)


@njit
def actuate(
    state: State, k: int, period: float, u: np.ndarray, clamped: np.ndarray, solver: Solver
) -> int:
    """One sample of valves and plant: at most three segments of constant valve demand; returns the
    located events.
    """
    y, modes, plays, plant = state.y, state.modes, state.plays, solver.plant
    s_x = delayed(plant.axis[0], u[:, 0], k, period)
    s_z = delayed(plant.axis[1], u[:, 1], k, period)
    cuts = (0.0, min(s_x.at, s_z.at), max(s_x.at, s_z.at), period)
    demand, events = np.empty(2), 0
    for part in range(3):
        begin, span = cuts[part], cuts[part + 1] - cuts[part]
        if span < 1e-9:
            continue
        for i in range(2):
            s = s_z if i == 1 else s_x
            raw = s.after if begin >= s.at - 1e-9 else s.before
            demand[i] = steady_force(
                plant.axis[i], spool_command(plant.axis[i], raw, plays[i]), k * period
            )
        act = Acting(demand, clamped)
        events += advance(y, modes, k * period + begin, span, act, solver)
    return events


@njit
def command(
    timing: Record, task: Task, integral: np.ndarray, k: int, signals: Signals, chance: np.ndarray
) -> None:
    """Write the command pair that acts from sample k."""
    readings, u, kept = signals.readings, signals.u, signals.kept
    late = timing.sense_delay + timing.jitter * chance[8]
    stalled = timing.burst > 0.0 and (k % 1000) < timing.burst
    due = (k - task.contact_row) % max(int(timing.divider), 1) == 0
    if due and not stalled and not chance[9] < timing.miss:
        seen = readings[max(k - int(late + 0.5), 0)]
        kept[k, 0], kept[k, 1] = control(
            task.gains, integral, task.reference[k, 0], task.reference[k, 1], seen
        )
    else:
        kept[k] = kept[k - 1]
    source = k - int(timing.act_delay + 0.5)
    u[k] = kept[source] if source >= task.contact_row else u[task.contact_row - 1]


@njit
def read(y: np.ndarray, modes: np.ndarray, plant: Plant, true: np.ndarray) -> None:
    """Write the true values of the eight channels."""
    f = load(y, modes[TOUCH], plant)
    true[0], true[1], true[2], true[3] = y[0], y[WIDTH], y[1], y[WIDTH + 1]
    true[4], true[5], true[6], true[7] = f.f_x, f.f_z, y[2], y[WIDTH + 2]


@kept
def run_loop(
    task: Task, luck: Luck, sensor: np.ndarray, timing: np.ndarray, accuracy: Accuracy, plant: Plant
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Run one log; returns (true channels (n, 8), readings (n, 8), commands (n, 2), located
    events).
    """
    n = task.commands.shape[0]
    true = np.empty((n, 8))
    signals = Signals(np.empty((n, 8)), task.commands.copy(), task.commands.copy())
    state = State(np.zeros(STATES), np.zeros(MODES, np.int64), np.empty((2, PLAYS + 1)))
    state.y[0], state.y[WIDTH] = task.start[0], task.start[1]
    integral, clamped = np.zeros(4), np.empty(2, np.bool_)
    period = PERIOD * (1.0 + timing[0].clock)
    chain = Chain(sensor, plant.terms, period, memory())
    solver = solver_of(plant, accuracy)
    events = 0
    for i in range(2):
        state.plays[i, :] = signals.u[0, i]
    for k in range(n):
        for i in range(2):
            clamped[i] = k < task.release[i]
        read(state.y, state.modes, plant, true[k])
        sense(chain, true[k], luck, k, signals.readings[k])
        if k >= task.contact_row:
            command(timing[0], task, integral, k, signals, luck.chance[k])
        events += actuate(state, k, period, signals.u, clamped, solver)
    return true, signals.readings, signals.u, events
