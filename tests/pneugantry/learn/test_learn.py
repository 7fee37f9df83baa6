"""A plant whose model lacks a term: found in its equation, of its variable, in its form."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pandas as pd
import pytest

from pneugantry.cli import main
from pneugantry.engine.plant import Array

ROOT = Path(__file__).parents[3]
MODEL = """
model Cart "A mass on a guide, pushed by a force"
  parameter Real m(unit = "kg", min = 0.1) = 2 "Mass";
  parameter Real C(unit = "N.s/m", min = 0) = 4 "Viscous friction";
  parameter Real F_0(unit = "N") = 0 "Constant force; neutral 0";
  input Real u(unit = "N") "Force";
  output Real v(start = 0, fixed = true, unit = "m/s") "Speed";
  Real s(start = 0, fixed = true, unit = "m");
equation
  m*der(v) = u - C*v - F_0;
  der(s) = v;
end Cart;
"""
PLANT = """
[plant]
model = "Cart.mo"
class = "Cart"
catalogue = "effects.toml"
period = 0.01
[inputs]
u = "u"
[outputs.v]
column = "v"
sigma = 0.003
[tolerance]
m = 0.03
C = 0.05
[log.swings]
file = "swings.csv"
[log.steps]
file = "steps.csv"
[log.other]
file = "other.csv"
use = "held out"
"""
EFFECT = """
name = "constant_force"
block = "guide"
[[form]]
name = "force"
[form.parameters.F_0]
scale = 1.0
low = -50
high = 50
"""
PERIOD, LENGTH, FINE = 0.01, 8.0, 10  # s, s, integration steps a row


def force(log: str, t: float) -> float:
    if log == "steps":
        return (6.0, -9.0, 12.0, -4.0)[int(t / 2.0) % 4]
    slow, fast = (1.7, 4.1) if log == "swings" else (1.2, 5.3)
    return 9.0 * float(np.sin(slow * t) + 0.6 * np.sin(fast * t + 1.0))


def moved(u: Array, rate: Callable[[float, float, float, float], float]) -> Array:
    """Speeds of a cart from rest. rate: of its speed; of time, position, speed and force."""
    s = v = 0.0
    speeds, step = [], PERIOD / FINE
    for i, f in enumerate(u):
        speeds.append(v)
        for j in range(FINE):  # midpoint rule
            t = i * PERIOD + j * step
            half = v + step / 2 * rate(t, s, v, f)
            middle = s + step / 2 * v
            s, v = s + step * half, v + step * rate(t + step / 2, middle, half, f)
    return np.array(speeds)


def rig(folder: Path, term: Callable[[float, float], float]) -> Path:
    """Logs of a cart with other parameters than the model's and one more force of (s, v)."""
    for k, log in enumerate(("swings", "steps", "other")):
        rows = round(LENGTH / PERIOD)
        u = np.array([round(force(log, i * PERIOD), 3) for i in range(rows)])
        speeds = moved(u, lambda t, s, v, f: (f - 4.1 * v + term(s, v)) / 1.97)
        noise = 0.003 * np.random.default_rng(k).standard_normal(rows)
        table = pd.DataFrame({"u": u, "v": np.round(speeds + noise, 4)})
        table.to_csv(folder / f"{log}.csv", index=False)
    (folder / "Cart.mo").write_text(MODEL, encoding="utf-8")
    (folder / "effects.toml").write_text(EFFECT, encoding="utf-8")
    path = folder / "plant.toml"
    path.write_text(PLANT, encoding="utf-8")
    return path


def diagnosed(folder: Path, term: Callable[[float, float], float], *options: str) -> dict[str, Any]:
    path = rig(folder, term)
    assert main(["diagnose", str(path), "--json", str(folder / "out.json"), *options]) == 0
    found: dict[str, Any] = json.loads((folder / "out.json").read_text(encoding="utf-8"))
    return found


def test_quadratic_drag_is_learnt_named_and_written_back(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    keeps_to_schema: Callable[[dict[str, Any]], None],
) -> None:
    out, known = tmp_path / "out", tmp_path / "known"
    page = tmp_path / "page.html"
    options = ("--augmented", str(out), "--catalogue-out", str(known), "--html", str(page))
    found = diagnosed(tmp_path, lambda s, v: -1.5 * v * abs(v), *options)
    keeps_to_schema(found)
    learned = found["learned"]
    assert learned["accepted"], learned["why"]
    term = learned["term"]
    assert (term["regressor"], term["form"]) == ("v", "signed square")
    (size,) = term["parameters"].values()
    assert size["ci95"][0] < -1.5 < size["ci95"][1]
    assert size["ci95"][1] < -1.2
    assert learned["gap"]["with"] < 1.3 * learned["gap"]["floor"] < learned["gap"]["without"]
    assert (found["verdict"], found["causes"], found["answer_set"]) == (
        "unknown",
        [],
        [["unknown"]],
    )
    assert found["gap"]["augmented"] == learned["gap"]["with"]
    assert found["gap"]["shrink"] == pytest.approx(learned["gap"]["shrink"])
    (place,) = found["where"]
    assert (place["block"], place["share"]) == (term["block"], 1.0)
    at, value = (np.array(term["curve"][k]) for k in ("at", "value"))
    assert value == pytest.approx(-1.5 * at * np.abs(at), abs=0.15)
    assert "missing term (learnt)" in capsys.readouterr().out
    assert term["formula"] in page.read_text(encoding="utf-8")
    assert len(term["points"]["at"]) == len(term["points"]["value"]) > 5
    model = (out / "Cart.mo").read_text(encoding="utf-8")
    assert "block Residual_1" in model
    assert "v_read" not in model  # what its sensor reads is as it was
    measured = pd.read_csv(tmp_path / "other.csv")
    fmu, u = out / "AugmentedCart.fmu", measured["u"].to_numpy()
    speeds = foreign(fmu, u)
    assert np.sqrt(np.mean((measured["v"] - speeds) ** 2)) < 1.3 * 0.003  # the sensor's noise
    assert in_casadi(fmu, u, tmp_path / "unzipped") == pytest.approx(speeds, abs=2e-4)

    (tmp_path / "next").mkdir()
    path = rig(tmp_path / "next", lambda s, v: -0.8 * v * abs(v))
    path.write_text(
        PLANT.replace("Cart.mo", "../known/Cart.mo").replace("effects.", "../known/effects."),
        encoding="utf-8",
    )
    assert main(["diagnose", str(path), "--json", str(tmp_path / "next.json")]) == 0
    again = json.loads((tmp_path / "next.json").read_text(encoding="utf-8"))
    assert again["verdict"] == "identified"
    (cause,) = again["causes"]
    assert cause["effect"] == "learnt_signed_square_of_v"
    low, high = cause["parameters"]["missing_1.p1"]["ci95"]
    assert low < -0.8 < high < -0.6


def foreign(fmu: Path, u: np.ndarray) -> np.ndarray:
    """Speeds at the rows of a log, as fmpy simulates an FMU whose force is held over each row."""
    times = np.arange(len(u) + 1) * PERIOD
    table = np.zeros(2 * len(u), dtype=[("time", float), ("u", float)])
    table["time"] = np.stack([times[:-1], times[1:]], axis=1).ravel()
    table["u"] = np.repeat(u, 2)
    made = fmpy.simulate_fmu(
        str(fmu), stop_time=times[-2], output_interval=PERIOD, input=table, output=["v"]
    )
    return np.interp(times[:-1], made["time"], made["v"])


def in_casadi(fmu: Path, u: np.ndarray, folder: Path) -> np.ndarray:
    """The same as CasADi reads the FMU, its rates integrated by the Runge-Kutta method."""
    casadi = pytest.importorskip("casadi")
    with zipfile.ZipFile(fmu) as zipped:
        zipped.extractall(folder)
    read = casadi.DaeBuilder("cart", str(folder))
    rates = read.create("rates", ["x", "u"], ["ode"])
    x, step = np.array([read.start(n)[0] for n in read.x()]), PERIOD / 2
    speeds = []
    for force in u:
        speeds.append(x[read.x().index("v")])
        for _ in range(2):
            a = rates(x, force).full().ravel()
            b = rates(x + step / 2 * a, force).full().ravel()
            c = rates(x + step / 2 * b, force).full().ravel()
            x = x + step / 6 * (a + 2 * b + 2 * c + rates(x + step * c, force).full().ravel())
    return np.array(speeds)


def test_a_known_effect_is_told_beside_what_is_missing(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, lambda s, v: -2.0 - 1.5 * v * abs(v))
    learned = found["learned"]
    assert learned["accepted"], learned["why"]
    assert (learned["term"]["regressor"], learned["term"]["form"]) == ("v", "signed square")
    assert found["causes"] == learned["causes"]
    (cause,) = found["causes"]
    assert cause["effect"] == "constant_force"
    assert found["answer_set"][0] == ["constant_force", "unknown"]
    low, high = cause["parameters"]["F_0"]["ci95"]
    assert low < 2.0 < high < 2.5


def test_there_is_no_catalogue_to_write_without_a_term(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = rig(tmp_path, lambda s, v: 0.0)
    files = ("--html", str(tmp_path / "page.html"), "--json", str(tmp_path / "found.json"))
    assert main(["diagnose", str(path), "--catalogue-out", str(tmp_path / "known"), *files]) == 0
    assert "note: --catalogue-out: no missing term was looked for" in capsys.readouterr().err
    assert not (tmp_path / "known").exists()
    assert (tmp_path / "page.html").is_file()
    assert json.loads((tmp_path / "found.json").read_text("utf-8"))["verdict"] == "none"


def test_a_sound_rig_is_given_no_term(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, lambda s, v: 0.0)
    assert found["verdict"] == "none"
    assert "learned" not in found


def test_a_known_effect_is_no_missing_term(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, lambda s, v: -2.0)
    assert [c["effect"] for c in found["causes"]] == ["constant_force"]
    assert "learned" not in found


def test_it_is_not_looked_for_where_that_is_not_wanted(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, lambda s, v: -1.5 * v * abs(v), "--no-learn")
    assert found["verdict"] == "unknown"
    assert "learned" not in found


def test_a_sensor_s_error_is_learnt_as_one(tmp_path: Path) -> None:
    """A scale that repeats an error every 0.7 m; the speed is measured beside it."""
    path = rig(tmp_path, lambda s, v: 0.0)
    model = MODEL.replace("equation", '  output Real x(unit = "m");\nequation\n  x = s;')
    (tmp_path / "Cart.mo").write_text(model, encoding="utf-8")
    signal = '[outputs.x]\ncolumn = "x"\nsigma = 0.001\n[tolerance]'
    path.write_text(PLANT.replace("[tolerance]", signal), encoding="utf-8")
    for k, log in enumerate(("swings", "steps", "other")):
        table = pd.read_csv(tmp_path / f"{log}.csv")
        s = PERIOD * np.cumsum(table["v"] - table["v"].iloc[0])
        noise = 0.001 * np.random.default_rng(9 + k).standard_normal(len(s))
        table["x"] = s + 0.012 * np.sin(2 * np.pi * s / 0.7 + 0.5) + noise
        table.to_csv(tmp_path / f"{log}.csv", index=False)
    assert main(["diagnose", str(path), "--json", str(tmp_path / "out.json")]) == 0
    found = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    learned = found["learned"]
    assert learned["accepted"], learned["why"]
    term = learned["term"]
    assert (term["equation"], term["block"]) == ("x = s", "sensors")
    assert (term["regressor"], term["form"]) == ("s", "sine")
    size, period, _ = (p["value"] for p in term["parameters"].values())
    assert abs(size) == pytest.approx(0.012, rel=0.1)
    assert period == pytest.approx(0.7, rel=0.02)
    assert term["units"] == {"regressor": "m", "term": "m"}
    assert max(np.diff(term["curve"]["at"])) < period / 20  # drawn, it looks like a sine


class Play:
    """What follows a position that has left a band about it; from 0 at each log's start."""

    def __init__(self, half: float) -> None:
        self.half, self.at = half, 0.0

    def __call__(self, s: float, v: float) -> float:
        begins = s == v == 0.0
        self.at = 0.0 if begins else min(max(self.at, s - self.half), s + self.half)
        return self.at


@pytest.mark.slow
def test_a_spring_behind_a_play_is_learnt_as_one(tmp_path: Path) -> None:
    play = Play(0.3)
    learned = diagnosed(tmp_path, lambda s, v: -3.0 * (s - play(s, v)))["learned"]
    assert learned["accepted"], learned["why"]
    term = learned["term"]
    assert (term["regressor"], term["form"]) == ("s", "play")
    stiffness, half = term["parameters"].values()
    assert stiffness["value"] == pytest.approx(-3.0, abs=0.06)
    assert half["value"] == pytest.approx(0.3, abs=0.01)
    assert learned["gap"]["with"] < 1.3 * learned["gap"]["floor"]
    at, value = (np.array(term["curve"][k]) for k in ("at", "value"))
    back = at.argmax()
    assert np.abs(value[back + 10] - value[back - 10]) > 0.5  # there and back are apart


PAIR = f"""
package Pair
  {MODEL.strip()}
  model Both
    Cart one, two(m = 3);
    input Real u_1(unit = "N"), u_2(unit = "N");
    output Real v_1(unit = "m/s"), v_2(unit = "m/s");
  equation
    one.u = u_1;
    two.u = u_2;
    v_1 = one.v;
    v_2 = two.v;
  end Both;
end Pair;
"""
OF_BOTH = """
[plant]
model = "Pair.mo"
class = "Pair.Both"
catalogue = "effects.toml"
period = 0.01
[inputs]
u_1 = "u_1"
u_2 = "u_2"
[outputs.v_1]
column = "v_1"
sigma = 0.003
[outputs.v_2]
column = "v_2"
sigma = 0.003
[tolerance]
"one.m" = 0.03
"two.m" = 0.03
"one.C" = 0.05
"two.C" = 0.05
[log.swings]
file = "swings.csv"
[log.steps]
file = "steps.csv"
[log.other]
file = "other.csv"
use = "held out"
"""


def _shaken(begin: float, m: float, t: float, s: float, v: float, f: float) -> float:
    """Rate of the speed of one of the pair."""
    return (f - 4.1 * v + 0.8 * float(np.sin(2 * np.pi * (begin + t) / 0.63))) / m


@pytest.mark.slow
def test_what_shakes_two_components_is_one_term(tmp_path: Path) -> None:
    """Each cart's force has the same wave in it, which runs on between logs."""
    rows, begins = round(LENGTH / PERIOD), {"swings": 0.3, "steps": 1.1, "other": 2.9}
    for k, (log, begin) in enumerate(begins.items()):
        noise = 0.003 * np.random.default_rng(k).standard_normal((2, rows))
        table = {}
        for n, (m, delay) in enumerate(((2.03, 0.0), (2.94, 0.7))):
            u = np.array([round(force(log, abs(i * PERIOD - delay)), 3) for i in range(rows)])
            shaken = partial(_shaken, begin, m)
            table |= {f"u_{n + 1}": u, f"v_{n + 1}": np.round(moved(u, shaken) + noise[n], 4)}
        pd.DataFrame(table).to_csv(tmp_path / f"{log}.csv", index=False)
    (tmp_path / "Pair.mo").write_text(PAIR, encoding="utf-8")
    effect = EFFECT.replace("parameters.F_0", 'parameters."one.F_0"')
    (tmp_path / "effects.toml").write_text(effect, encoding="utf-8")
    path = tmp_path / "plant.toml"
    path.write_text(OF_BOTH, encoding="utf-8")
    out = tmp_path / "out"
    options = ["--json", str(tmp_path / "out.json"), "--augmented", str(out)]
    assert main(["diagnose", str(path), *options]) == 0
    learned = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["learned"]
    assert learned["accepted"], learned["why"]
    term = learned["term"]
    assert (term["regressor"], term["form"]) == ("time", "sine")
    assert set(term["parameters"]) == {"common_missing_1_p1", "common_missing_1_p2"}
    size, period = term["parameters"].values()
    assert abs(size["value"]) == pytest.approx(0.8, abs=0.02)
    assert period["value"] == pytest.approx(0.63, abs=0.002)
    assert learned["gap"]["with"] < 1.3 * learned["gap"]["floor"]
    text = (out / "Pair.mo").read_text(encoding="utf-8")
    assert text.count("missing_1(p1 = common_missing_1_p1") == 2
