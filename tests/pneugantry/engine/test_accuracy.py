"""The solver's error hides in the noise, and an answer is the same in every process."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from pneugantry.engine.plant import Plant, Record, Signal
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.accuracy import HIDDEN, LONGEST, TOLERANCE, TOLERANCES, accurate
from pneugantry.engine.views.build import build_views
from pneugantry.engine.views.view import View
from pneugantry.plants.described import described_task

ROOT = Path(__file__).resolve().parents[3]
DRIVE = ROOT / "examples" / "drive" / "plant.toml"
FIT = f"""
from dataclasses import replace
from pathlib import Path
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.plants.described import described_task

found, task = described_task(Path({str(DRIVE)!r}))
rules = replace(found.rules, followed=0)
print(Fitter(task.plant, task.views, task.data.fitted, rules).null().covariance.tobytes().hex())
"""


def error(view: View, record: Record, tolerance: float) -> float:
    """Of residuals against those of a far finer tolerance, in noise levels."""
    coarse, fine = view.residuals([(record, {TOLERANCE: t}) for t in (tolerance, 1e-10)])
    return float(np.sqrt(np.mean(((coarse - fine) / view.sigmas) ** 2, axis=0).max()))


def test_a_plant_whose_states_are_small_gets_a_finer_tolerance() -> None:
    _, task = described_task(DRIVE)
    chosen = task.plant.settings[TOLERANCE]
    pairs = [(v, r) for v in task.views for r in task.data.fitted if v.shows(r)]
    assert max(error(v, r, 1e-4) for v, r in pairs) > HIDDEN
    assert max(error(v, r, chosen) for v, r in pairs) < HIDDEN


SLOW = """
model Tank
  parameter Real area = 2;
  input Real inflow;
  output Real h(start = 1, fixed = true);
equation
  area*der(h) = inflow - 1e-3*h;
end Tank;
"""


def test_a_slow_plant_is_stepped_as_far_apart_as_its_rows(tmp_path: Path) -> None:
    (tmp_path / "Tank.mo").write_text(SLOW, encoding="utf-8")
    signals = (Signal("h", "h", 0.01),)
    model = tmp_path / "Tank.mo"
    plant = Plant("tank", model, "Tank", ("inflow",), signals, {}, (), {"": "tank"})
    rows = np.arange(400)
    level = 1.0 + 0.1 * np.sin(rows / 30)
    own = Record("fill", 60.0, {"inflow": 1e-3 + 1e-4 * np.cos(rows / 30)}, {"h": level}, {})
    views = build_views(plant, ["h"], tmp_path, own.period, Rules())
    told = accurate(plant, views, [own])
    assert told.in_views == {LONGEST: 60.0, TOLERANCE: TOLERANCES[0]}
    again = build_views(told, ["h"], tmp_path, own.period, Rules())
    (coarse,) = again[0].residuals([(own, {})])
    (fine,) = again[0].residuals([(own, {TOLERANCE: 1e-12, LONGEST: 0.5})])
    assert np.abs(coarse - fine).max() < HIDDEN * 0.01


def test_a_tolerance_that_is_set_stays() -> None:
    _, task = described_task(DRIVE)
    plant: Plant = replace(task.plant, settings={TOLERANCE: 1e-3})
    assert accurate(plant, task.views, task.data.fitted) is plant


def test_a_fit_is_the_same_to_the_last_bit_in_every_process() -> None:
    """Sets of strings are in another order in each."""
    ends = {
        subprocess.run(
            [sys.executable, "-c", FIT],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2", "3", "4")
    }
    assert len(ends) == 1
