"""Run one log on one rig: by its own programme and controller, or by replay of recorded commands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from studies.truth.controller import gain_array
from studies.truth.loop import NEVER, run_loop
from studies.truth.parameters import SIGMA, Rig
from studies.truth.setup import Setup
from studies.truth.workpiece import edge_table

FAR = 1e3  # m, stand-off of a workpiece that is not there
TOLERANCE = 1.0  # times the error scales of `integrate`


@dataclass(frozen=True)
class Draws:
    """Random numbers of one log: noise (rows, 8) in the channels' units, chance (rows, 10) uniform."""

    noise: np.ndarray
    chance: np.ndarray


@dataclass(frozen=True)
class Outcome:
    """true, readings: (rows, 8) in the order of CHANNELS; commands: (rows, 2) [V]; events: located mode changes."""

    true: np.ndarray
    readings: np.ndarray
    commands: np.ndarray
    events: int


def draws(rows: int, seed: int | None) -> Draws:
    """Noise and chance of a log; without a seed no noise, and chances that never strike."""
    if seed is None:
        return Draws(np.zeros((rows, 8)), np.full((rows, 10), 0.999999))
    rng = np.random.default_rng(seed)
    return Draws(rng.standard_normal((rows, 8)) * SIGMA, rng.random((rows, 10)))


def run(
    rig: Rig, setup: Setup, *, draw: Draws | None = None, commands: np.ndarray | None = None, edge: np.ndarray | None = None,
    tolerance: float = TOLERANCE, max_step: float = 1e-3,
) -> Outcome:  # fmt: skip
    """Simulate a log. `commands` (rows, 2) [V]: replay these, whatever the loop was. `edge`: ready table of the workpiece, else made."""
    replay = commands is not None
    u = np.ascontiguousarray(commands, dtype=float) if replay else setup.commands()
    draw = draws(setup.rows, None) if draw is None else draw
    if edge is None:
        edge = edge_table(setup.workpiece, rig)
    standoff = FAR if setup.workpiece == "none" else setup.standoff
    result = run_loop(
        np.array(setup.start), setup.release_rows(), u, setup.references(), NEVER if replay else setup.contact_row,
        gain_array(setup.gains), draw.noise, draw.chance, tolerance, max_step, rig.axis, rig.contact, rig.sensor, rig.timing,
        rig.profile, edge, standoff,
    )  # fmt: skip
    return Outcome(*result)
