"""Generate a campaign of seven logs on one rig, and write it as a campaign folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pneugantry.truth.parameters import CHANNELS, COMMAND_ROUNDING, ROUNDING, Rig
from pneugantry.truth.run import Outcome, draws, run
from pneugantry.truth.setups import Setup, campaign_setups

Campaign = dict[str, pd.DataFrame]


def log_frame(outcome: Outcome) -> pd.DataFrame:
    """The table that the rig's computer stores: time [s], commands [V] and readings, rounded to
    about sigma / 5.
    """
    rows = len(outcome.commands)
    columns = {"time": np.arange(rows) / 1000.0}
    for name, values in zip(("u_x", "u_z"), outcome.commands.T, strict=True):
        columns[name] = _rounded(values, COMMAND_ROUNDING)
    for name, values, grid in zip(CHANNELS, outcome.readings.T, ROUNDING, strict=True):
        columns[name] = _rounded(values, grid)
    return pd.DataFrame(columns)


def _rounded(values: np.ndarray, grid: float) -> np.ndarray:
    return (np.round(values / grid) * grid).astype(np.float32)


def generate(rig: Rig, seed: int, setups: dict[str, Setup] | None = None) -> Campaign:
    """Run every log with its own noise; all noise comes from `seed`."""
    setups = campaign_setups() if setups is None else setups
    seeds = np.random.SeedSequence(seed).spawn(len(setups))
    return {
        name: log_frame(run(rig, setup, draw=draws(setup.rows, child)))
        for (name, setup), child in zip(setups.items(), seeds, strict=True)
    }


def write(folder: Path, campaign: Campaign, setups: dict[str, Setup] | None = None) -> None:
    """Write the logs as Parquet and campaign.toml beside them; the folder is made."""
    setups = campaign_setups() if setups is None else setups
    folder.mkdir(parents=True, exist_ok=True)
    for name, frame in campaign.items():
        frame.to_parquet(folder / f"{name}.parquet")
    text = "# One measuring campaign: 1 kHz, SI units; columns as in docs/reference/logs.md.\n"
    (folder / "campaign.toml").write_text(
        text + "".join(_section(setups[name]) for name in campaign)
    )


def _section(setup: Setup) -> str:
    clamped = []
    for axis, until in zip("xz", setup.release, strict=True):
        if until > 0.0:
            clamped.append(f'"{axis}"' if np.isinf(until) else f'"{axis} until contour"')
    lines = [
        f"\n[log.{setup.name}]",
        f'loop = "{setup.loop}"',
        f"clamped = [{', '.join(clamped)}]",
        f"start = {{ x = {setup.start[0]}, z = {setup.start[1]} }}",
        f'workpiece = "{setup.workpiece}"',
    ]
    if setup.workpiece != "none":
        lines.append(f"standoff = {setup.standoff}")
    if setup.loop == "closed":
        phases = ", ".join(f"{name} = [{a}, {b}]" for name, (a, b) in setup.phases.items())
        u_x, u_z = setup.commands()[0]
        lines += [
            f"phases = {{ {phases} }}",
            f"approach_command = {{ u_x = {u_x}, u_z = {u_z} }}",
            f"f_nd = {setup.f_nd}",
            f"v_td = {setup.v_td}",
            'controller = "pi_force_velocity"',
            f"gains = {{ "
            f"{', '.join(f'{name} = {value}' for name, value in setup.gains.items())} }}",
        ]
    return "\n".join(lines) + "\n"
