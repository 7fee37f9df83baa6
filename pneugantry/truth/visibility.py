"""How far an effect shows: change of the readings, in sigma, against the same rig without it, same
commands.
"""

from __future__ import annotations

import numpy as np

from pneugantry.truth.controller import control, gain_array
from pneugantry.truth.parameters import SIGMA, Rig
from pneugantry.truth.run import Outcome, run
from pneugantry.truth.sensors import Luck
from pneugantry.truth.setups import Setup


def replay_change(outcome: Outcome, without: Rig, setup: Setup, draw: Luck) -> np.ndarray:
    """RMS over time of the change of each channel, in sigma, shape (8,)."""
    plain = run(without, setup, commands=outcome.commands, draw=draw)
    return np.sqrt(np.mean(((outcome.readings - plain.readings) / SIGMA) ** 2, axis=0))


def command_change(outcome: Outcome, setup: Setup) -> float:
    """RMS of the commands against a punctual controller fed with the same readings, in units of the
    commands' noise.
    """
    if setup.loop != "closed":
        return 0.0
    gains, integral, reference = gain_array(setup.gains), np.zeros(4), setup.references()
    noise_x = np.hypot(gains[0, 0] * SIGMA[2], gains[1, 0] * SIGMA[4])
    noise_z = np.hypot(gains[2, 0] * SIGMA[5], gains[3, 0] * SIGMA[3])
    change = np.empty((setup.rows - setup.contact_row, 2))
    for row, k in enumerate(range(setup.contact_row, setup.rows)):
        due = control(gains, integral, reference[k, 0], reference[k, 1], outcome.readings[k])
        change[row] = outcome.commands[k] - np.array(due)
    return float(np.sqrt(np.mean((change / np.array([noise_x, noise_z])) ** 2)))


def visibility(
    outcomes: dict[str, Outcome],
    without: Rig,
    setups: dict[str, Setup],
    drawn: dict[str, Luck],
    timing: bool,
    kept: list[int],
) -> dict[str, float]:
    """Per log the visibility on its best channel of `kept`; `timing`: also how the commands give
    the effect away.
    """
    out = {}
    for name, outcome in outcomes.items():
        out[name] = float(replay_change(outcome, without, setups[name], drawn[name])[kept].max())
        if timing:
            out[name] = max(out[name], command_change(outcome, setups[name]))
    return out
