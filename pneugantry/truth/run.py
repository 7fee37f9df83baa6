"""Run one log on one rig: by its own programme and controller, or by replay of recorded
commands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pneugantry.truth.controller import gain_array
from pneugantry.truth.integrate import Accuracy
from pneugantry.truth.loop import NEVER, Task, run_loop
from pneugantry.truth.parameters import SIGMA, Rig
from pneugantry.truth.plant import Plant
from pneugantry.truth.sensors import Luck
from pneugantry.truth.setups import Setup
from pneugantry.truth.workpiece import edge_table

FAR = 1e3  # m, stand-off of a workpiece that is not there
PAUSE = 0.137  # s, unit of the time between logs
USUAL = Accuracy(tolerance=1.0, max_step=1e-3)


@dataclass(frozen=True)
class Outcome:
    """true, readings: (rows, 8) in the order of CHANNELS; commands: (rows, 2) [V]; events: located
    mode changes.
    """

    true: np.ndarray
    readings: np.ndarray
    commands: np.ndarray
    events: int


def draws(rows: int, seed: int | np.random.SeedSequence | None) -> Luck:
    """Noise and chance of a log; without a seed no noise, and chances that never strike."""
    if seed is None:
        return Luck(np.zeros((rows, 8)), np.full((rows, 10), 0.999999))
    rng = np.random.default_rng(seed)
    return Luck(rng.standard_normal((rows, 8)) * SIGMA, rng.random((rows, 10)))


def run(
    rig: Rig,
    setup: Setup,
    *,
    draw: Luck | None = None,
    commands: np.ndarray | None = None,
    edge: np.ndarray | None = None,
    accuracy: Accuracy = USUAL,
) -> Outcome:
    """Simulate a log. `commands` (rows, 2) [V]: replay these, whatever the loop was. `edge`: ready
    table of the workpiece, else made from the setup.
    """
    replay = commands is not None
    u = np.ascontiguousarray(commands, dtype=float) if replay else setup.commands()
    draw = draws(setup.rows, None) if draw is None else draw
    if edge is None:
        edge = edge_table(setup.workpiece, rig)
    standoff = FAR if setup.workpiece == "none" else setup.standoff
    row = NEVER if replay else setup.contact_row
    task = Task(
        np.array(setup.start),
        setup.release_rows(),
        u,
        setup.references(),
        row,
        gain_array(setup.gains),
    )
    axis = _phased(rig.axis, setup.name)
    plant = Plant(axis, rig.contact, rig.profile, edge, standoff, rig.terms)
    return Outcome(*run_loop(task, draw, rig.sensor, rig.timing, accuracy, plant))


def _phased(axis: np.ndarray, name: str) -> np.ndarray:
    """The axes with what runs on between the logs (compressor, vibration) where it stands when the
    log of this name starts.
    """
    since = PAUSE * sum(map(ord, name))  # s, any number that differs between logs
    out = axis.copy()
    out["shake_phase"] += 2.0 * np.pi * axis["shake_hz"] * since
    out["cycle_phase"] += since / axis["cycle_time"]
    return out
