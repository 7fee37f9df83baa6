"""A sensor's learnt error, taken out of its readings; what all views tell of it then."""

from __future__ import annotations

import json
import warnings
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pneugantry.api.diagnosis import diagnose
from pneugantry.cli import main
from pneugantry.engine.plant import Array, Plant, Record, Signal
from pneugantry.engine.signals.sensors import PREFIX
from pneugantry.engine.views.view import Run
from pneugantry.learn.equations.points import Point
from pneugantry.learn.equations.sources import equations_of
from pneugantry.learn.screening.regressors import Regressor
from pneugantry.learn.terms.calibrated import Calibrated, Misreading, misreading
from pneugantry.learn.terms.forms import FORMS, REMEMBERING
from pneugantry.learn.terms.term import Term

PERIOD, ROWS = 1e-3, 6000
T = PERIOD * np.arange(ROWS)
LAWS = {f.name: f for f in (*FORMS, *REMEMBERING)}
MODEL = """
model Slide "A carriage between springs, their force and its travel measured"
  parameter Real m(unit = "kg", min = 0.1) = 2 "Mass";
  parameter Real C(unit = "N.s/m", min = 0) = 4 "Viscous friction";
  parameter Real k(unit = "N/m", min = 0) = 200 "Stiffness";
  input Real u(unit = "N") "Force";
  output Real x(unit = "m") "Travel, as it is read";
  output Real f(unit = "N") "Force of the springs";
protected
  Real s(start = 0, fixed = true, unit = "m") "Travel";
  Real v(start = 0, fixed = true, unit = "m/s");
equation
  der(s) = v;
  m*der(v) = u - C*v - f;
  f = k*s;
  x = s;
end Slide;
"""
PLANT = """
[plant]
model = "Slide.mo"
class = "Slide"
catalogue = "effects.toml"
period = 0.01
[inputs]
u = "u"
[outputs.x]
column = "x"
sigma = 0.0003
[outputs.f]
column = "f"
sigma = 0.05
[tolerance]
m = 0.03
C = 0.05
k = 0.03
[log.swings]
file = "swings.csv"
[log.sweeps]
file = "sweeps.csv"
[log.other]
file = "other.csv"
use = "held out"
"""
EFFECT = """
name = "stiffness"
block = "springs"
[[form]]
name = "k"
[form.parameters.k]
neutral = 1.0
scale = 0.3
low = 0.1
high = 10.0
relative = true
positive = true
"""


def _term(folder: Path, name: str, values: tuple[float, ...]) -> tuple[Plant, Term]:
    """An error of the sensor that reads s, as a function of s."""
    model = folder / "Slide.mo"
    model.write_text(MODEL, encoding="utf-8")
    plant = Plant("slide", model, "Slide", ("u",), (Signal("x", "x", 1.0),), {}, (), {})
    equation = next(e for e in equations_of(model) if e.left == "x")
    point = Point("", equation, sensor=True)
    return plant, Term(point, Regressor("", "s"), LAWS[name], values, (), "sensors")


@pytest.mark.parametrize(
    ("name", "values"), [("play", (-0.2, 0.3)), ("sine", (0.05, 0.7, 0.1)), ("cube", (0.02,))]
)
def test_an_error_is_taken_out(tmp_path: Path, name: str, values: tuple[float, ...]) -> None:
    plant, term = _term(tmp_path, name, values)
    misread = misreading(plant, term, {})
    assert misread == Misreading("x", "x", term)
    true = np.sin(3 * T) + 0.3 * T
    memory = term.law.memory
    if memory is None:
        error = term.law.law(true, values)
    else:
        error = values[0] * memory.walk(true, PERIOD, values[1:])
    found = misread.corrected(Record("run", PERIOD, {}, {"x": true + error, "f": true}, {}))
    assert found is not None
    assert found.signals["x"] == pytest.approx(true, abs=2e-3 * np.abs(error).max())
    assert found.signals["f"] is true


def test_where_nothing_moves_an_error_is_taken_out_as_well(tmp_path: Path) -> None:
    _, term = _term(tmp_path, "sine", (0.5, 4.0, 0.0))
    true = 0.9 + 0.001 * np.sin(3 * T)  # far less than its error
    read = true + term.law.law(true, term.values)
    found = Misreading("x", "x", term).corrected(Record("run", PERIOD, {}, {"x": read}, {}))
    assert found is not None
    assert found.signals["x"] == pytest.approx(true, abs=1e-3)


def test_a_reading_without_a_single_origin_is_left(tmp_path: Path) -> None:
    plant, term = _term(tmp_path, "sine", (1.0, 0.5, 0.0))
    record = Record("run", PERIOD, {}, {"x": np.sin(3 * T)}, {})
    assert Misreading("x", "x", term).corrected(record) is None
    with warnings.catch_warnings():  # an error that grows without end is no news to a user
        warnings.simplefilter("error")
        _, steep = _term(tmp_path, "cube", (50.0,))
        far = Record("run", PERIOD, {}, {"x": 9 * np.sin(3 * T)}, {})
        assert Misreading("x", "x", steep).corrected(far) is None
    other = Term(term.point, Regressor("", "u"), term.law, (1.0,), (), "sensors")
    assert misreading(plant, other, {}) is None  # u is not measured


class _Reader:
    """A view that reads x and tells how far it is from what it is to be."""

    name = "reader"
    signals: tuple[str, ...] = ("f",)
    blocks: tuple[str, ...] = ("springs",)
    sigmas: tuple[float, ...] = (0.1,)
    decimation = 1
    remembers = True

    def __init__(self, true: Array) -> None:
        self.true, self.moving = true, set[str]()
        self.defaults: Mapping[str, float] = {"k": 2.0}

    def shows(self, record: Record) -> bool:
        return "x" in record.signals

    def depends_on(self, parameter: str) -> bool:
        return parameter in ("k", f"{PREFIX}x.bias")

    def prepare(self, moving: Collection[str], settings: Mapping[str, float]) -> None:
        self.moving = set(moving)

    def residuals(self, runs: Sequence[Run]) -> list[Array]:
        return [given.get("k", 2.0) * (r.signals["x"] - self.true)[:, None] for r, given in runs]


def test_a_view_is_shown_readings_without_the_error_that_is_asked(tmp_path: Path) -> None:
    _, term = _term(tmp_path, "sine", (0.05, 0.7, 0.1))
    true = np.sin(3 * T)
    record = Record("run", PERIOD, {}, {"x": true + term.law.law(true, term.values)}, {})
    reader = _Reader(true)
    view = Calibrated(reader, Misreading("x", "x", term))
    size, period, place = term.parameters
    own = {size: 0.05, period: 0.7, place: 0.1}
    right, stiffer, without, absurd = view.residuals(
        [
            (record, own),
            (record, {**own, "k": 4.0}),
            (record, {**own, size: 0.0}),
            (record, {**own, size: 1.0}),
        ]
    )
    assert np.abs(right).max() < 1e-3 * 2 * 0.05
    assert stiffer == pytest.approx(2 * right)
    assert np.abs(without).max() == pytest.approx(2 * 0.05, rel=1e-3)
    assert np.isnan(absurd).all()
    assert absurd.shape == right.shape
    assert view.depends_on(size)
    assert view.depends_on("k")
    assert not view.depends_on("m")
    view.prepare({"k", size}, {})
    assert reader.moving == {"k"}
    assert view.shows(record)
    assert (view.remembers, view.defaults, view.signals) == (True, {"k": 2.0}, ("f",))


@pytest.mark.parametrize(
    ("name", "values"),
    [("play", (0.8, 3e-4)), ("play", (0.8, 3e-3)), ("lag", (0.5, 0.05)), ("linear", (0.5,))],
)
def test_an_error_that_smooths_a_sensor_s_noise_is_not_the_likelier_for_it(
    tmp_path: Path, name: str, values: tuple[float, ...]
) -> None:
    """A sensor at rest: what is left of its noise is told in units of what it reads."""
    _, term = _term(tmp_path, name, values)
    noise = 1e-3 * np.random.default_rng(3).standard_normal(ROWS)
    reader = _Reader(np.zeros(ROWS))
    reader.signals, reader.sigmas = ("x",), (1e-3,)
    (found,) = Calibrated(reader, Misreading("x", "x", term)).residuals(
        [(Record("run", PERIOD, {}, {"x": noise}, {}), {"k": 1.0})]
    )
    assert np.std(found) > 0.99 * np.std(noise)


@pytest.mark.usefixtures("unoptimised")
def test_a_sound_rig_s_sensors_have_no_error(tmp_path: Path) -> None:
    """A reading less what it remembers of itself is its noise: the only thing to be explained."""
    model = tmp_path / "Slide.mo"
    model.write_text(MODEL, encoding="utf-8")
    (tmp_path / "effects.toml").write_text(EFFECT, encoding="utf-8")
    plant = PLANT.replace("sigma = 0.05", "sigma = 2.0")  # N, a play's width is tried that small
    (tmp_path / "plant.toml").write_text(plant, encoding="utf-8")
    rng = np.random.default_rng(6)
    for log, slow, fast in (("swings", 1.7, 4.1), ("sweeps", 0.8, 2.9), ("other", 1.2, 5.3)):
        t = 0.01 * T[:1200] / PERIOD
        u = np.round(14 * np.sin(slow * t) + 8 * np.sin(fast * t + 1), 3)
        s = _travel(u, 1.97, 4.1, 206.0)
        read = s + 3e-4 * rng.standard_normal(len(s))
        f = 206.0 * s + 2.0 * rng.standard_normal(len(s))
        pd.DataFrame({"u": u, "x": read, "f": f}).to_csv(tmp_path / f"{log}.csv", index=False)
    found = diagnose(tmp_path / "plant.toml")
    assert found.verdict == "none"
    likely = replace(found.found.decision, unknown=1.0)  # looked for all the same
    learned = (
        replace(found, found=replace(found.found, decision=likely)).with_missing_term().learned
    )
    assert learned is not None
    own = [c.gain for c in learned.screen.candidates if c.point.equation.left == "f_read"]
    assert own
    assert max(own) < 40
    assert learned.best is None, learned.why


@pytest.mark.usefixtures("unoptimised")
def test_all_views_tell_a_scale_s_error(tmp_path: Path) -> None:
    """Its own view alone does not tell it this well: a force sensor reads the travel. That is a
    state, which stands in no equation of its own.
    """
    size, pitch, stiffness = 0.002, 0.03, 206.0
    model = MODEL.replace('output Real x(unit = "m") "Travel, as it is read";', "")
    model = model.replace("  x = s;\n", "").replace("protected\n  Real s", "  output Real s")
    rng = np.random.default_rng(5)
    plant = PLANT.replace('[outputs.x]\ncolumn = "x"', '[outputs.s]\ncolumn = "s"')
    for log, slow, fast in (("swings", 1.7, 4.1), ("sweeps", 0.8, 2.9), ("other", 1.2, 5.3)):
        u = np.round(
            [14 * np.sin(slow * t) + 8 * np.sin(fast * t + 1) for t in 0.01 * T[:1200] / PERIOD], 3
        )
        s = _travel(u, 1.97, 4.1, stiffness)
        read = s + size * np.sin(2 * np.pi * s / pitch) + 3e-4 * rng.standard_normal(len(s))
        f = stiffness * s + 0.05 * rng.standard_normal(len(s))
        pd.DataFrame({"u": u, "s": read, "f": f}).to_csv(tmp_path / f"{log}.csv", index=False)
    for name, text in (("Slide.mo", model), ("effects.toml", EFFECT), ("plant.toml", plant)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    told, known = tmp_path / "out.json", tmp_path / "known"
    options = ["--json", str(told), "--catalogue-out", str(known)]
    assert main(["diagnose", str(tmp_path / "plant.toml"), *options]) == 0
    learned = json.loads(told.read_text(encoding="utf-8"))["learned"]
    term = learned["term"]
    assert learned["accepted"], learned["why"]
    assert (term["equation"], term["form"]) == ("s_read = s", "sine")
    told_size, told_pitch, _ = term["parameters"].values()
    assert told_size["value"] == pytest.approx(size, rel=0.01)
    assert told_pitch["value"] == pytest.approx(pitch, rel=1e-3)
    assert "s_read = (s) + missing_" in (known / "Slide.mo").read_text(encoding="utf-8")

    next_rig = plant.replace('"Slide.mo"', '"known/Slide.mo"').replace("effects.", "known/effects.")
    next_rig = next_rig.replace('column = "s"', 'column = "s"\nvariable = "s_read"')
    assert 'variable = "s_read"' in (known / "effects.toml").read_text(encoding="utf-8")
    (tmp_path / "next.toml").write_text(next_rig, encoding="utf-8")
    assert main(["diagnose", str(tmp_path / "next.toml"), "--json", str(told)]) == 0
    again = json.loads(told.read_text(encoding="utf-8"))
    assert [c["effect"] for c in again["causes"]] == ["learnt_sine_of_s"]

    sweeps = pd.read_csv(tmp_path / "sweeps.csv")
    sweeps.drop(columns="s").to_csv(tmp_path / "sweeps.csv", index=False)  # it ended in a KeyError
    assert main(["diagnose", str(tmp_path / "plant.toml"), "--json", str(told)]) == 0
    learned = json.loads(told.read_text(encoding="utf-8"))["learned"]
    assert learned["accepted"]
    assert learned["term"]["equation"] == "s_read = s"


@pytest.mark.slow
@pytest.mark.usefixtures("unoptimised")
def test_what_leaks_from_one_sensor_into_another_is_told(tmp_path: Path) -> None:
    """The force's own view by itself has a damper beside the springs instead; the carriage's view
    takes the force as known.
    """
    leak = 3.0  # N.s/m
    model = MODEL.replace("  Real v(start", "  output Real v(start")
    plant = PLANT.replace("[tolerance]", '[outputs.v]\ncolumn = "v"\nsigma = 0.005\n[tolerance]')
    rng = np.random.default_rng(11)
    for log, slow, fast in (("swings", 1.7, 4.1), ("sweeps", 0.8, 2.9), ("other", 1.2, 5.3)):
        t = 0.01 * T[:1200] / PERIOD
        u = np.round(14 * np.sin(slow * t) + 8 * np.sin(fast * t + 1), 3)
        s = _travel(u, 1.97, 4.1, 206.0)
        v = np.gradient(s, 0.01)
        f = 206.0 * s + leak * v
        read = {
            n: c + e * rng.standard_normal(1200)
            for n, c, e in (("x", s, 3e-4), ("f", f, 0.05), ("v", v, 0.005))
        }
        pd.DataFrame({"u": u, **read}).to_csv(tmp_path / f"{log}.csv", index=False)
    for name, text in (("Slide.mo", model), ("effects.toml", EFFECT), ("plant.toml", plant)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    told = tmp_path / "out.json"
    assert main(["diagnose", str(tmp_path / "plant.toml"), "--json", str(told)]) == 0
    found = json.loads(told.read_text(encoding="utf-8"))
    term = found["learned"]["term"]
    assert found["learned"]["accepted"], found["learned"]["why"]
    assert (term["block"], term["equation"], term["regressor"]) == ("sensors", "f_read = f", "v")
    (size,) = term["parameters"].values()
    assert size["ci95"][0] < leak < size["ci95"][1]
    assert found["learned"]["causes"] == []


def _travel(u: Array, mass: float, damping: float, stiffness: float) -> Array:
    """Of the carriage (rows,) from rest, rows 10 ms apart, by the midpoint rule."""
    s = v = 0.0
    found, step = [], 1e-3
    for force in u:
        found.append(s)
        for _ in range(10):
            middle, half = (
                s + step / 2 * v,
                v + step / 2 * (force - damping * v - stiffness * s) / mass,
            )
            s, v = s + step * half, v + step * (force - damping * half - stiffness * middle) / mass
    return np.array(found)
