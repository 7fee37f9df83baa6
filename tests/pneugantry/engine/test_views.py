"""Residual views as they come out of the structure of a plant."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lsim

import pneugantry.engine
from modelica_fmu.errors import InputError
from pneugantry.engine.plant import Plant, Record, Signal, thinned
from pneugantry.engine.rules import Rules
from pneugantry.engine.signals.sensors import sensed, true_signal
from pneugantry.engine.views.build import Measured, build_views
from pneugantry.engine.views.subsystem import SubsystemView
from pneugantry.engine.views.synthetic import Nominal
from pneugantry.plants.gantry.describe import plant_of
from pyfmi_runner.build import cache_folder

NAMES = (
    "gantry|valve|contact|workpiece|friction|clamp|stroke|payload|piston|tachometer|supply|"
    r"[xz]_0|f_a?[xz]|[vu]_[xz]|axis_[xz]"
)


def views(plant: Plant, cache: Path, names: list[str] | None = None) -> list[SubsystemView]:
    measured = names or [s.name for s in plant.signals]
    return build_views(plant, measured, cache, 2e-3, Rules(observer=0.008))


def test_the_gantry_s_views_come_out_of_its_structure() -> None:
    """Valves, carriages, contact and, position beside speed, kinematics; which effect touches
    which view follows.
    """
    found = {v.signals: v for v in views(plant_of(), cache_folder() / "parts")}
    assert set(found) == {("x",), ("z",), ("v_x",), ("v_z",), ("f_x", "f_z"), ("f_ax",), ("f_az",)}
    assert {b for v in found.values() for b in v.blocks} == {
        "sensors", "friction_x", "friction_z", "contact", "valve_x", "valve_z",
    }  # fmt: skip
    touched = {
        "valve_x.delay_time": {("f_ax",)},
        "axis_z.friction.F_s": {("v_z",)},
        # the carriages' friction may grow with the normal force, which no sensor tells
        "contact.K_c": {("f_x", "f_z"), ("v_x",), ("v_z",)},
        "sensors.f_az.scale": {("f_az",), ("v_z",)},
    }
    for parameter, expected in touched.items():
        assert {s for s, v in found.items() if v.depends_on(parameter)} == expected, parameter
    assert {s for s, v in found.items() if v.corrected} == {("v_x",), ("v_z",)}


def test_signals_share_no_view_where_a_record_lacks_one_of_them() -> None:
    plant = plant_of()
    measured = [s.name for s in plant.signals]
    fewer = [n for n in measured if n != "f_z"]
    parts, rules = cache_folder() / "parts", Rules()
    known = Measured(held=[measured, fewer])
    found = build_views(plant, measured, parts, 2e-3, rules, known)
    assert {("f_x",), ("f_z",)} < {v.signals for v in found}


def test_a_record_of_the_nominal_plant_leaves_nothing(
    cart: Plant, push: Record, cache: Path
) -> None:
    whole = Nominal(cart, ["f", "v"], cache).record(push)
    for view in views(cart, cache):
        residual = view.residuals([(whole, {})])[0]
        assert np.abs(residual).max() < 0.05 * min(s.sigma for s in cart.signals), view.name


def test_rows_at_a_start_that_does_not_count_are_judged_by_no_view(
    cart: Plant, push: Record, cache: Path
) -> None:
    """However wrong a reading is there; behind it each row is as it would be."""
    whole = replace(Nominal(cart, ["f", "v"], cache).record(push), skip=0.1)
    for view in views(cart, cache):
        wrong = {n: whole.signals[n].copy() for n in view.signals}
        for values in wrong.values():
            values[: whole.first] += 1e3
        spoilt = replace(whole, signals={**whole.signals, **wrong})
        moved = {} if view.name == "f" else {"M": 2.0}
        told, expected = view.residuals([(spoilt, moved), (replace(whole, skip=0.0), moved)])
        first = whole.first // view.decimation
        assert not told[:first].any(), view.name
        np.testing.assert_allclose(told[first:], expected[first:], atol=1e-9)


def test_only_the_view_that_reads_a_parameter_changes_with_it(
    cart: Plant, push: Record, cache: Path
) -> None:
    whole = Nominal(cart, ["f", "v"], cache).record(push)
    by_name = {v.name: v for v in views(cart, cache)}
    assert by_name["f"].depends_on("K")
    assert not by_name["v"].depends_on("K")
    base, moved = by_name["v"].residuals([(whole, {}), (whole, {"m": 1.2})])
    assert np.abs(moved - base).max() > 0.01  # m/s
    base, moved = by_name["v"].residuals([(whole, {}), (whole, {"K": 3.0})])
    np.testing.assert_array_equal(base, moved)


def test_a_signal_of_no_variable_is_one_clear_line(cart: Plant, cache: Path) -> None:
    wrong = replace(cart, signals=(Signal("force", "thrust", 0.1),))
    with pytest.raises(InputError, match=r"thrust: Toy\.Cart has no variable"):
        views(wrong, cache)


@pytest.mark.parametrize("error", ["scale", "bias", "drift", "curve", "from.other"])
def test_what_a_sensor_says_is_led_back_to_the_true_signal(error: str) -> None:
    time = 1e-3 * np.arange(3000)
    true, other = np.sin(5 * time), np.cos(3 * time)
    value = {"scale": 1.1}.get(error, 0.05)
    values = {f"sensors.own.{error}": value}
    record = Record("r", 1e-3, {}, {"own": true, "other": other}, {})
    said = true
    for _ in range(3):  # a curve is told in units of the readings' own spread
        record = replace(record, signals={"own": said, "other": other})
        said = sensed("own", true, record, values)
    assert np.abs(said - true).max() > 0.01
    back = true_signal("own", replace(record, signals={"own": said, "other": other}), values)
    np.testing.assert_allclose(back, true, atol=1e-4)


@pytest.mark.parametrize("period", [1e-3, 5e-3])
def test_a_lag_is_that_of_the_line_through_the_rows(period: float) -> None:
    """As scipy solves it, whatever the period: no fraction of a row comes on top."""
    true = np.random.default_rng(0).standard_normal(500).cumsum()
    record = Record("r", period, {}, {"own": true}, {})
    time = period * np.arange(len(true))
    _, expected, _ = lsim(([1.0], [0.02, 1.0]), true - true[0], time)
    said = sensed("own", true, record, {"sensors.own.lag": 0.02})
    np.testing.assert_allclose(said, true[0] + expected, atol=1e-9)


@pytest.mark.parametrize("window", [0.4e-3, 1e-3, 7.3e-3, 0.15])
def test_a_mean_is_that_of_the_line_through_the_rows(window: float) -> None:
    """As of rows a thousand times as fine."""
    true = np.random.default_rng(0).standard_normal(120).cumsum()
    record = Record("r", 1e-3, {}, {"own": true}, {})
    said = sensed("own", true, record, {"sensors.own.window": window})
    points = 1000 * int(np.ceil(window / 1e-3))
    fine = (np.arange(points) + 0.5) / points * window / 1e-3
    at = np.arange(len(true))
    expected = [np.interp(k - fine, at, true).mean() for k in at]
    np.testing.assert_allclose(said, expected, atol=1e-5)


def test_a_lag_of_next_to_nothing_changes_next_to_nothing() -> None:
    true = np.random.default_rng(0).standard_normal(500).cumsum()
    record = Record("r", 2e-3, {}, {"own": true}, {})
    said = sensed("own", true, record, {"sensors.own.lag": 1e-6})
    np.testing.assert_allclose(said, true, atol=5e-3)  # 1/2000 of a row, steps of 3


def test_thinning_keeps_a_ramp_and_leaves_rows_about_an_impact_out() -> None:
    rng = np.random.default_rng(0)
    ramp = np.arange(400.0)
    speed = 0.01 * rng.standard_normal(400)
    speed[200:] += 5.0
    found = thinned(Record("r", 1e-3, {"u": ramp}, {"s": ramp, "v": speed}, {}, skip=0.1), 2)
    np.testing.assert_allclose(found.signals["s"][2:-2], ramp[::2][2:-2])
    np.testing.assert_allclose(found.inputs["u"], ramp[::2] + 0.5)
    np.testing.assert_array_equal(found.driving("u")[1], ramp.reshape(200, 2))
    np.testing.assert_array_equal(found.moved("u", np.ones(200)).driving("u")[0], ramp[::2] + 1)
    assert found.period == 2e-3
    assert found.skip == 0.1
    assert not found.judged[100]
    assert found.judged[[50, 150]].all()


def test_the_engine_knows_no_plant() -> None:
    folder = Path(pneugantry.engine.__file__).parent
    for path in folder.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert not re.search(rf"\b({NAMES})\b", text, re.IGNORECASE), path.name
        assert "plants" not in re.findall(r"from pneugantry\.(\w+)", text), path.name
