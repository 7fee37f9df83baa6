"""A mass that varies: what an equation's left-hand side lacks."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from test_learn import PERIOD, foreign, moved, rig

from pneugantry.cli import main
from pneugantry.engine.plant import Array
from pneugantry.learn.equations.points import Point
from pneugantry.learn.equations.sources import EquationText

LIGHTER = 0.04  # share of the mass, for each (m/s)^2


def accelerated(t: float, s: float, v: float, f: float) -> float:
    return (f - 4.1 * v) / (1.97 * (1 - LIGHTER * v * v))


def test_a_mass_that_falls_with_the_speed_is_learnt(tmp_path: Path) -> None:
    path, out = rig(tmp_path, lambda s, v: 0.0), tmp_path / "out"
    for k, log in enumerate(("swings", "steps", "other")):
        table = pd.read_csv(tmp_path / f"{log}.csv")
        noise = 0.003 * np.random.default_rng(k).standard_normal(len(table))
        speeds = moved(table["u"].to_numpy(), accelerated) + noise
        table.assign(v=np.round(speeds, 4)).to_csv(tmp_path / f"{log}.csv", index=False)
    told = tmp_path / "out.json"
    assert main(["diagnose", str(path), "--json", str(told), "--augmented", str(out)]) == 0
    learned = json.loads(told.read_text(encoding="utf-8"))["learned"]
    assert learned["accepted"], learned["why"]
    term = learned["term"]
    assert (term["regressor"], term["form"]) == ("v times m*der(v)", "square")
    assert term["formula"].endswith("*v^2)*(m*der(v))")
    assert term["units"] == {"regressor": "m/s", "term": "1"}
    (size,) = term["parameters"].values()
    assert size["ci95"][0] < LIGHTER < size["ci95"][1]
    assert size["value"] == pytest.approx(LIGHTER, rel=0.05)
    assert learned["gap"]["with"] < 1.2 * learned["gap"]["floor"] < learned["gap"]["without"]
    u = pd.read_csv(tmp_path / "other.csv")["u"].to_numpy()
    true: Array = moved(u, accelerated)
    assert np.abs(foreign(out / "AugmentedCart.fmu", u) - true).max() < 0.02 * np.ptp(true)
    assert len(u) * PERIOD > 5


@pytest.mark.parametrize(
    ("left", "right", "rate"),
    [
        ("m*der(v)", "u - C*v", "m*der(v)"),
        ("der(s)", "v", ""),  # says whose rate it is
        ("f", "K*der(s)", ""),
        ("tau *\n  der(x)", "u - x", "tau * der(x)"),
    ],
)
def test_what_is_inert_in_an_equation(left: str, right: str, rate: str) -> None:
    point = Point("axis", EquationText(("Axis",), 1, left, right, 0, 0, 0))
    assert point.rate == rate
    if rate:
        assert point.reads(rate)
        assert point.spelt(rate) == f"({rate})"
