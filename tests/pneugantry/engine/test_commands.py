"""Inputs that act later than a record says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from test_search import CATALOGUE, PERIOD, SIGMA, fitter_of, parts, plant, record

from pneugantry.engine.answer.confirm import replays
from pneugantry.engine.describe import input_effects
from pneugantry.engine.plant import Array, Data, Plant, Record, thinned
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import run
from pneugantry.engine.selection.trail import Trail
from pneugantry.engine.signals.commands import acting, drives_of, input_of, outside
from pneugantry.engine.task import Task
from pneugantry.engine.views.build import build_views

__all__ = ["parts", "plant"]

STEPS = np.repeat([0.0, 1.0, -0.5, 2.0, 2.0, 0.3], 7)


def run_of(values: Array) -> Record:
    return Record("run", 1e-3, {"u": values}, {"y": np.zeros(len(values))}, {})


def test_a_delay_of_whole_rows_moves_what_is_held() -> None:
    found = acting(run_of(STEPS), "u", (3e-3, 0.0))
    assert found == pytest.approx(np.r_[np.full(3, STEPS[0]), STEPS[:-3]])


def test_within_a_row_a_delayed_step_has_its_mean() -> None:
    found = np.asarray(acting(run_of(STEPS), "u", (0.25e-3, 0.0)))
    assert found[7] == pytest.approx(0.75)
    assert found[8] == pytest.approx(1.0)


def test_a_lag_is_that_of_a_hundred_times_finer_rows() -> None:
    lag, fine = 2.3e-3, 100
    held = np.repeat(STEPS, fine)
    keep = np.exp(-1e-3 / fine / lag)
    state = lfilter([1 - keep], [1, -keep], held)  # at the ends of the fine rows
    ends = np.append(0.0, state)
    means = (0.5 * (ends[:-1] + ends[1:])).reshape(-1, fine).mean(axis=1)
    assert acting(run_of(STEPS), "u", (0.0, lag)) == pytest.approx(means, abs=1e-5)


def test_thinned_rows_act_as_their_parts_do() -> None:
    late = (1.5e-3, 0.8e-3)
    fine = np.asarray(acting(run_of(STEPS), "u", late))
    at, over = acting(thinned(run_of(STEPS), 2), "u", late)
    assert over == pytest.approx(fine.reshape(-1, 2))
    assert at == pytest.approx(fine[::2])


def test_runs_that_are_driven_alike_share_what_drives_them() -> None:
    values: list[Mapping[str, float]] = [
        {"K": 1.0},
        {"inputs.u.delay": 2e-3},
        {"K": 2.0, "sensors.y.bias": 0.1},
    ]
    drives, which = drives_of(run_of(STEPS), {"part.u": "u"}, values)
    assert which == [0, 1, 0]
    assert [list(d.inputs) for d in drives] == [["part.u"]] * 2


def test_names() -> None:
    assert outside("inputs.motor.u.delay")
    assert outside("sensors.y.bias")
    assert not outside("motor.u")
    assert input_of("inputs.motor.u.delay") == "motor.u"


def late(name: str, seed: int, rows: int) -> Record:
    """A rig whose command acts some rows after it is recorded."""
    whole = record(name, seed)
    inputs = {"u": np.append(whole.inputs["u"][rows:], np.full(rows, whole.inputs["u"][-1]))}
    return replace(whole, inputs=inputs, skip=0.1)


def test_a_late_input_is_told(plant: Plant, parts: Path) -> None:
    rules, rows = Rules(), 6
    data = Data((late("one", 1, rows), late("two", 2, rows)), late("held", 3, rows))
    views = build_views(plant, list(SIGMA), parts, PERIOD, rules)
    catalogue = {**CATALOGUE, **input_effects(data.fitted)}
    found = run(Task(plant, views, data, catalogue, parts), rules).diagnosis
    assert found.verdict == "identified"
    (cause,) = found.causes[:1]
    assert cause.key == "input_delay(u)"
    size = cause.parameters["inputs.u.delay"]
    assert size.low < rows * PERIOD < size.high
    assert size.value == pytest.approx(rows * PERIOD, rel=0.03)
    assert found.gap is not None
    assert found.gap.augmented < 1.2 < 2 < found.gap.nominal


def test_what_every_plant_may_have_gives_way_to_what_the_catalogue_names(
    plant: Plant, parts: Path
) -> None:
    """A leak by a general name does the same as the leak, and not what drag does."""
    fitter = fitter_of(plant, parts, leak=0.1)
    null, leak, drag = fitter.null(), CATALOGUE["leak"], CATALOGUE["drag"]
    anything = replace(leak, name="anything", general=True)
    leaking, slowed, general = (
        fitter.explore(null.hypothesis.plus(e, e.forms[0]), null) for e in (leak, drag, anything)
    )
    trail = Trail(fitter, {e.key: e for e in (leak, drag, anything)}, [null])
    assert trail.named([slowed, general], null) == [slowed, general]
    assert trail.named([slowed, general, leaking], null) == [slowed, leaking]
    assert list(trail.offered) == ["leak", "drag"]
    fitter.close()


def test_an_input_that_stands_still_is_not_late() -> None:
    assert input_effects([run_of(np.full(9, 3.0))]) == {}
    assert list(input_effects([run_of(np.full(9, 3.0)), run_of(STEPS)])) == ["input_delay(u)"]


def test_a_replay_has_each_of_its_values_driven_by_its_own(plant: Plant, parts: Path) -> None:
    whole = record("one", 1)
    plain, delayed, again = replays(plant, whole, [{}, {"inputs.u.delay": 10 * PERIOD}, {}], parts)
    assert plain is not None
    assert delayed is not None
    assert again is not None
    assert np.array_equal(plain.simulated, again.simulated)
    # after what was held before the record has died away; a position keeps it
    moved = np.abs(delayed.simulated[4010:, :2] - plain.simulated[4000:-10, :2]).max(axis=0)
    assert moved == pytest.approx([0, 0], abs=1e-2)
    assert np.ptp(plain.simulated[4000:, :2], axis=0).min() > 0.5
