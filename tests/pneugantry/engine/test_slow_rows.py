"""Plants whose rows are seconds apart, and inputs that move between them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from modelica_fmu.errors import RunError
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.plant import Nuisance, Plant, Record, Signal
from pneugantry.engine.rules import Rules
from pneugantry.engine.signals.commands import acting
from pneugantry.engine.views.build import build_views
from pneugantry.engine.views.model_parts import longest_step
from pneugantry.engine.views.synthetic import Nominal

PERIOD, ROWS = 10.0, 400
MODEL = """
model Room "Heated, with a wall to the outside"
  parameter Real C = 5e5;
  parameter Real k = 120;
  input Real P;
  input Real outside;
  output Real T(start = 15, fixed = true);
equation
  C*der(T) = P - k*(T - outside);
end Room;
"""


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Plant:
    path = tmp_path_factory.mktemp("room") / "Room.mo"
    path.write_text(MODEL, encoding="utf-8")
    signals = (Signal("T", "T", 0.05),)
    nuisances = (Nuisance("k", 0.02, relative=True, scales=True),)
    return Plant("room", path, "Room", ("P", "outside"), signals, {}, nuisances, {})


@pytest.fixture(scope="module")
def day() -> Record:
    """The heater switches, the outside cools down all the time."""
    rows = np.arange(ROWS)
    inputs = {"P": np.where(rows // 50 % 2, 2000.0, 500.0), "outside": 10 - 0.02 * rows}
    return Record("day", PERIOD, inputs, {}, {}, straight=frozenset({"outside"}))


def temperature(record: Record) -> np.ndarray:
    """Exact: over a row the heater holds and the outside runs straight."""
    c, k, found = 5e5, 120.0, [15.0]
    decay, outside = np.exp(-k / c * PERIOD), record.inputs["outside"]
    for i in range(ROWS - 1):
        slope = (outside[i + 1] - outside[i]) / PERIOD
        at = [record.inputs["P"][i] / k + o - slope * c / k for o in outside[i : i + 2]]
        found.append(at[1] + (found[-1] - at[0]) * decay)
    return np.array(found)


def test_rows_of_seconds_are_simulated_and_an_input_runs_straight(
    room: Plant, day: Record, tmp_path: Path
) -> None:
    nominal = Nominal(room, ["T"], tmp_path)
    true = temperature(day)
    np.testing.assert_allclose(nominal.run(day)["T"], true, atol=1e-4)
    held = nominal.run(replace(day, straight=frozenset()))["T"]
    assert np.abs(held - true).max() > 2e-3
    (view,) = build_views(room, ["T"], tmp_path, PERIOD, Rules(band=1 / PERIOD))
    residual = view.residuals([(replace(day, signals={"T": true}), {})])[0]
    assert np.abs(residual).max() < 1e-3


def test_a_straight_input_acts_late_as_one_that_is_held(day: Record) -> None:
    """Along a line, a delay of three rows is the line three rows ago."""
    at, over = acting(day, "outside", (3 * PERIOD, 0.0))
    np.testing.assert_allclose(at[5:], day.inputs["outside"][2:-3], atol=1e-9)
    np.testing.assert_allclose(over[5:-4], day.inputs["outside"][2:-7] - 0.01, atol=1e-9)


def test_a_row_asks_for_few_of_the_solver_s_steps() -> None:
    assert longest_step(1e-3) == 1e-3
    assert longest_step(PERIOD) == PERIOD / 50


def test_a_model_that_stops_in_every_log_is_one_clear_line(
    room: Plant, day: Record, tmp_path: Path
) -> None:
    broken = replace(day, inputs={**day.inputs, "P": np.full(ROWS, np.nan)})
    record = replace(broken, signals={"T": np.full(ROWS, 15.0)})
    rules = Rules(band=1 / PERIOD)
    fitter = Fitter(room, build_views(room, ["T"], tmp_path, PERIOD, rules), [record], rules)
    with pytest.raises(RunError, match="stops over every log"):
        fitter.null()
    fitter.close()
