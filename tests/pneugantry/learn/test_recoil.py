"""Something elastic that a machine stands on: learnt as the recoil of a speed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from test_learn import FINE, PERIOD, rig

from pneugantry.cli import main
from pneugantry.engine.plant import Array

MASS, DRAG = 1.97, 4.1
RATIO, W, ZETA = 0.25, 2 * np.pi * 1.2, 0.05  # of the cart's mass to its base's, rad/s, 1


def shaken(u: Array) -> Array:
    """Speeds along a base that a spring holds (midpoint rule): what pushes the cart pushes the base
    the other way.
    """

    def rate(y: Array, f: float) -> Array:
        pushed = (f - DRAG * y[0]) / MASS
        base = -(W**2) * y[1] - 2 * ZETA * W * y[2] - RATIO * pushed
        return np.array([pushed - base, y[2], base])

    y, speeds, step = np.zeros(3), [], PERIOD / FINE
    for f in u:
        speeds.append(y[0])
        for _ in range(FINE):
            y = y + step * rate(y + step / 2 * rate(y, f), f)
    return np.array(speeds)


def test_an_elastic_base_is_learnt(tmp_path: Path) -> None:
    path = rig(tmp_path, lambda s, v: 0.0)
    for k, log in enumerate(("swings", "steps", "other")):
        table = pd.read_csv(tmp_path / f"{log}.csv")
        noise = 0.003 * np.random.default_rng(k).standard_normal(len(table))
        speeds = shaken(table["u"].to_numpy()) + noise
        table.assign(v=np.round(speeds, 4)).to_csv(tmp_path / f"{log}.csv", index=False)
    told = tmp_path / "out.json"
    assert main(["diagnose", str(path), "--json", str(told)]) == 0
    learned = json.loads(told.read_text(encoding="utf-8"))["learned"]
    assert learned["accepted"], learned["why"]
    assert learned["causes"] == []
    term = learned["term"]
    assert (term["regressor"], term["form"]) == ("v", "recoil")
    size, period, damping = (p["value"] for p in term["parameters"].values())
    lighter = np.sqrt(1 + RATIO)  # the base swings with the cart on it
    assert size == pytest.approx(MASS * RATIO / (1 + RATIO), rel=0.02)
    assert period == pytest.approx(2 * np.pi * lighter / W, rel=0.005)
    assert damping == pytest.approx(ZETA / lighter, rel=0.1)
    assert learned["gap"]["with"] < 1.15 * learned["gap"]["floor"] < learned["gap"]["without"]
