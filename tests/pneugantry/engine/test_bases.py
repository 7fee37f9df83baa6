"""Two effects that do exactly what two others do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cont2discrete
from test_search import modelled

from pneugantry.engine.hypotheses.catalogue import Effect, Form, Parameter
from pneugantry.engine.plant import Data, Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found, run
from pneugantry.engine.task import Task
from pneugantry.engine.views.build import build_views

MODEL = """
model Circuit "A coil and a capacitor in series"
  parameter Real R = 2.0;
  parameter Real L = 0.01;
  parameter Real C = 1e-3;
  input Real u;
  output Real i(start = 0, fixed = true);
  output Real v(start = 0, fixed = true);
equation
  L*der(i) = u - R*i - v;
  C*der(v) = i;
end Circuit;
"""
PERIOD, ROWS, HELD = 2e-4, 3000, 150
SIGMA = {"i": 2e-3, "v": 5e-3}
OFF = {"R": 2.02, "L": 0.0099, "C": 1.01e-3}


def effect(name: str, parameter: str, block: str) -> Effect:
    own = Parameter(parameter, 1.0, 0.2, 0.1, 3.0, relative=not parameter.startswith("sensors"))
    return Effect(name, "", block, name, (Form("share", (own,)),))


CATALOGUE = {
    e.key: e
    for e in (
        effect("resistance", "R", "coil"),
        effect("turns", "L", "coil"),
        effect("capacity", "C", "capacitor"),
        effect("current_scale", "sensors.i.scale", "sensors"),
    )
}


def record(name: str, seed: int, more: float, less: float) -> Record:
    """Held random voltages; exact between rows, for the circuit is linear."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-5, 5, ROWS // HELD), HELD)
    r, coil, c = more * OFF["R"], OFF["L"], less * OFF["C"]
    rates = np.array([[-r / coil, -1 / coil], [1 / c, 0.0]])
    system = (rates, np.array([[1 / coil], [0.0]]), np.eye(2), np.zeros((2, 1)))
    step, push, *_ = cont2discrete(system, PERIOD)
    states = np.zeros((ROWS, 2))
    for k in range(1, ROWS):
        states[k] = step @ states[k - 1] + push[:, 0] * u[k - 1]
    signals = {
        n: states[:, j] + s * rng.standard_normal(ROWS) for j, (n, s) in enumerate(SIGMA.items())
    }
    return Record(name, PERIOD, {"u": u}, signals, {})


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Plant:
    return modelled(tmp_path_factory.mktemp("circuit"), MODEL, "Circuit", SIGMA, OFF)


def diagnosed(plant: Plant, cache: Path, more: float, less: float) -> Found:
    rules = Rules(band=1 / (5 * PERIOD), thinning=1)
    one, two, held = (record(n, i, more, less) for i, n in enumerate(("one", "two", "held")))
    views = build_views(plant, list(SIGMA), cache, PERIOD, rules)
    return run(Task(plant, views, Data((one, two), held), CATALOGUE, cache), rules)


def test_a_pair_that_does_the_same_is_told_as_well(plant: Plant, cache: Path) -> None:
    """A current that reads 0.8 of what it is, in a coil of 0.8 of the inductance, is what a
    resistance of 1.25 times and a capacity of 0.8 times its value are.
    """
    found = diagnosed(plant, cache, more=1.25, less=0.8).diagnosis
    pairs = [set(keys) for keys in found.answer_set[:2]]
    assert found.verdict == "ambiguous"
    assert {"resistance", "capacity"} in pairs
    assert {"current_scale", "turns"} in pairs


def test_a_pair_that_nothing_else_does_is_identified(plant: Plant, cache: Path) -> None:
    found = diagnosed(plant, cache, more=1.5, less=0.8).diagnosis
    assert found.verdict == "identified"
    assert set(found.answer_set[0]) == {"resistance", "capacity"}
