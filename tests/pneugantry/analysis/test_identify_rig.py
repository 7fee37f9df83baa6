"""A small open-loop campaign of a rig whose parameters are known: the FMU's own outputs with the
sensors' noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from pneugantry.analysis.identify.friction_tests import noisy_campaign
from pneugantry.analysis.identify.replayed import Plants
from pyfmi_runner.campaign import Campaign, LoggedRun, LogSetup
from pyfmi_runner.log import MEASURED, Log

OFF = {
    "valve_x.K": 181.0,
    "valve_x.u_0": 0.640,
    "valve_x.tau": 0.31,
    "axis_x.m": 7.5,
    "axis_x.C": 72.0,
    "axis_x.friction.F_s": 25.6,
    "axis_x.friction.F_d": 11.3,
    "valve_z.K": 102.0,
    "valve_z.tau": 0.146,
    "axis_z.m": 2.20,
    "axis_z.C": 41.0,
    "axis_z.F_w": 5.1,
    "axis_z.friction.F_s": 19.6,
    "axis_z.friction.F_d": 15.3,
    "contact.K_c": 9.7e3,
    "contact.C_c": 31.0,
}
LOGS = ("steps", "ramps", "pushes")
STEPS = LogSetup(clamped=("x", "z"), start_x=0.5, start_z=0.05)
RAMPS = LogSetup(start_x=0.95, start_z=0.0)
PUSHES = LogSetup(clamped=("x",), start_x=0.95, start_z=0.0, workpiece="straight", standoff=0.04)


def levels(values: list[float], seconds: float) -> np.ndarray:
    return np.repeat(values, round(1000 * seconds))


def ramps(low: float, high: float, seconds: float) -> np.ndarray:
    """A tooth up and down and a rest, as of an ideal programme."""
    n = round(1000 * seconds)
    up = low + (high - low) * np.arange(n) / n
    return np.concatenate(
        [up, high + (low - high) * np.arange(n // 5) / (n // 5), np.full(n // 2, low)]
    )


def commands() -> dict[str, tuple[LogSetup, np.ndarray, np.ndarray]]:
    teeth_x, teeth_z = np.tile(ramps(0.635, 0.935, 2.0), 2), np.tile(ramps(0.735, 1.135, 2.0), 2)
    pushes = levels([1.05, 0.8, 0.9, 1.0, 1.1, 1.2, 1.35, 1.5, 1.3, 1.1, 1.0, 0.9, 0.8], 0.8)
    return {
        "steps": (
            STEPS,
            levels([0.65, 0.9, 1.15, 1.35, 1.15, 0.9, 0.65], 1.2),
            levels([0.85, 1.1, 1.35, 1.6, 1.35, 1.1, 0.85], 1.2),
        ),
        "ramps": (RAMPS, teeth_x, teeth_z),
        "pushes": (PUSHES, np.zeros(len(pushes)), pushes),
    }


def rig_campaign(
    plants: Plants,
    values: Mapping[str, float],
    names: tuple[str, ...] = ("steps", "ramps", "pushes"),
    seed: int = 5,
) -> Campaign:
    """Logs of a rig: driven by ideal commands, which the logs hold to 0.1 mV."""
    logs, outputs = {}, {}
    for name in names:
        setup, u_x, u_z = commands()[name]
        time = np.arange(len(u_x)) * 1e-3
        outputs[name] = plants.drive(setup, np.column_stack([u_x, u_z]), time, dict(values))
        table = pd.DataFrame(
            {"time": time, "u_x": np.round(u_x, 4), "u_z": np.round(u_z, 4)}
            | dict.fromkeys(MEASURED, 0.0)
        )
        logs[name] = LoggedRun(setup, Log(table, name))
    return noisy_campaign(Campaign("rig", Path("rig"), logs), outputs, seed)


def test_programme_of_the_rig_is_not_what_its_logs_hold() -> None:
    ideal = commands()["ramps"][1]
    assert np.abs(np.round(ideal, 4) - ideal).max() > 4e-5
