"""The study of missing terms: its rigs hold what they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.missing_terms import KINDS, rig
from pneugantry.plants.described import described_task


def test_a_rig_differs_from_a_sound_one_by_its_term_alone(tmp_path: Path) -> None:
    speeds = {}
    for name in ("sound", "drag"):
        (tmp_path / name).mkdir()
        path, size = rig(tmp_path / name, KINDS[name], seed=3)
        speeds[name] = pd.read_csv(tmp_path / name / "slow.csv")["w"].to_numpy()
        _, task = described_task(path, cache=tmp_path / "parts")
        assert [r.name for r in task.data.fitted] == ["sines", "slow"]
    assert size < 0.0
    slower = np.abs(speeds["sound"]) - np.abs(speeds["drag"])
    fast = np.abs(speeds["sound"]) > 10.0
    assert np.mean(slower[fast]) > 0.5
    assert np.abs(slower[:5]).max() < 0.2  # at rest both are alike but for the noise
