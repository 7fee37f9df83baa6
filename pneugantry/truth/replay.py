"""Command replay of a recorded campaign, and its gap to the readings in units of the sensors'
noise.
"""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pneugantry.truth.parameters import CHANNELS, SIGMA, Rig
from pneugantry.truth.run import run
from pneugantry.truth.setups import Setup


def read_campaign(folder: Path) -> dict[str, tuple[Setup, pd.DataFrame]]:
    """The logs of a campaign folder by name, with what campaign.toml says of each."""
    described = tomllib.loads((folder / "campaign.toml").read_text())["log"]
    out = {}
    for name, entry in described.items():
        frame = pd.read_parquet(folder / f"{name}.parquet")
        out[name] = (_setup(name, entry, len(frame)), frame)
    return out


def _setup(name: str, entry: dict, rows: int) -> Setup:
    phases = {key: tuple(span) for key, span in entry.get("phases", {}).items()}
    release = [0.0, 0.0]
    for item in entry["clamped"]:
        axis, _, phase = item.partition(" until ")
        release["xz".index(axis)] = phases[phase][0] if phase else np.inf
    setup = Setup(
        name,
        rows / 1000.0,
        (entry["start"]["x"], entry["start"]["z"]),
        ((), ()),
        (release[0], release[1]),
        entry["workpiece"],
        entry.get("standoff", 0.0),
        entry["loop"],
        phases,
    )
    if entry["loop"] == "closed":
        u = entry["approach_command"]
        programme = ((1.0, u["u_x"], u["u_x"]),), ((1.0, u["u_z"], u["u_z"]),)
        setup = replace(
            setup, programme=programme, f_nd=entry["f_nd"], v_td=entry["v_td"], gains=entry["gains"]
        )
    return setup


def residuals(rig: Rig, setup: Setup, frame: pd.DataFrame, **options: Any) -> np.ndarray:
    """(measured - simulated) / sigma, shape (rows, 8), with the recorded commands
    acting on `rig`.
    """
    outcome = run(rig, setup, commands=frame[["u_x", "u_z"]].to_numpy(float), **options)
    return (frame[list(CHANNELS)].to_numpy(float) - outcome.readings) / SIGMA
