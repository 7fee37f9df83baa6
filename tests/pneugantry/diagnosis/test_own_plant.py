"""A user's own plant with a user's own catalogue: a mass on a guide, simulated apart
from its FMU.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from modelica_fmu.errors import InputError
from pneugantry.cli import main
from pneugantry.diagnosis.mat_file import read_mat
from pneugantry.diagnosis.own_diagnose import diagnose_own, own_json
from pneugantry.diagnosis.own_plant import is_own_plant, read_own_plant
from pneugantry.engine.catalogue import read_catalogue

MODEL = """
model Cart "A mass on a guide"
  parameter Real m(unit = "kg", min = 0.1) = 2 "Mass";
  parameter Real C(unit = "N.s/m", min = 0) = 4 "Viscous friction";
  parameter Real F_c(unit = "N", min = 0) = 0 "Coulomb friction; neutral 0";
  parameter Real F_0(unit = "N") = 0 "Constant force; neutral 0";
  parameter Real rise(unit = "1", min = -1) = 0
    "Share by which Coulomb friction is higher at rest; neutral 0";
  input Real u(unit = "N") "Force";
  output Real v(start = 0, fixed = true, unit = "m/s") "Speed";
equation
  m*der(v) = u - C*v - F_0 - F_c*(1 + rise*exp(-(v/0.05)^2))*tanh(v/2e-3);
end Cart;
"""
PLANT = """
[plant]
model = "Cart.mo"
class = "Cart"
catalogue = "effects"
period = 2e-3

[inputs]
u = "force"

[outputs.v]
column = "speed"
sigma = 0.002
unit = "m/s"

[tolerance]
m = 0.03
C = 0.05

[log.swings]
file = "swings.csv"

[log.other]
file = "other.csv"
use = "held out"
"""
EFFECT = (
    'name = "{0}"\nblock = "{1}"\n{5}\n[[form]]\n[form.parameters.{2}]\nscale = {3}\nlow = '
    "{4}\nhigh = 50.0\n"
)
EFFECTS = {
    "coulomb": ("guide", "F_c", 1.0, 0.0, ""),
    "offset": ("drive", "F_0", 1.0, -50.0, ""),
    "stribeck": ("guide", "rise", 0.3, -0.9, 'refines = ["coulomb"]'),
}
SIGMA, PERIOD, ROWS = 0.002, 2e-3, 3000


def record(path: Path, seed: int, further: Callable[[float, float], float]) -> None:
    """Midpoint rule at 0.05 ms; m and C 2 % off; `further`: force against v at speed
    and position.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(ROWS) * PERIOD
    tones = rng.uniform(0.3, 3.0, 5), rng.uniform(0, 2 * math.pi, 5)
    force = 4.0 * sum(np.sin(2 * math.pi * f * time + p) for f, p in zip(*tones, strict=True))
    speed, v, s, h = np.empty(ROWS), 0.0, 0.0, PERIOD / 40
    for k in range(ROWS):
        speed[k] = v
        for _ in range(40):
            half = v + 0.5 * h * (force[k] - 3.92 * v - further(v, s)) / 2.04
            v, s = v + h * (force[k] - 3.92 * half - further(half, s)) / 2.04, s + h * half
    pd.DataFrame({"force": force, "speed": speed + rng.normal(0, SIGMA, ROWS)}).to_csv(
        path, index=False
    )


def write_plant(folder: Path, further: Callable[[float, float], float]) -> Path:
    (folder / "effects").mkdir(exist_ok=True)
    for name, (block, *values, extra) in EFFECTS.items():
        (folder / "effects" / f"{name}.toml").write_text(
            EFFECT.format(name, block, *values, extra), encoding="utf-8"
        )
    (folder / "Cart.mo").write_text(MODEL, encoding="utf-8")
    (folder / "plant.toml").write_text(PLANT, encoding="utf-8")
    record(folder / "swings.csv", 1, further)
    record(folder / "other.csv", 2, further)
    return folder / "plant.toml"


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fmus")


def test_an_effect_is_found_with_its_size_and_closes_the_gap_of_the_held_out_log(
    tmp_path: Path, fmus: Path
) -> None:
    plant = read_own_plant(
        write_plant(tmp_path, lambda v, s: 1.5 * v / math.hypot(v, 2e-3)), out=fmus
    )
    assert plant.catalogue is not None
    found = own_json(diagnose_own(plant, read_catalogue(plant.catalogue)))
    assert found["verdict"] == "identified"
    assert found["causes"][0]["effect"] == "coulomb"
    assert found["where"][0]["block"] == "guide"
    assert found["answer_set"][0] == ["coulomb"]
    assert found["causes"][0]["parameters"]["F_c"]["value"] == pytest.approx(1.5, rel=0.03)
    assert found["gap"]["log"] == "other"
    assert found["gap"]["shrink"] > 0.98


def test_tolerance_alone_is_no_effect(tmp_path: Path, fmus: Path) -> None:
    plant = read_own_plant(write_plant(tmp_path, lambda v, s: 0.0), out=fmus)
    assert plant.catalogue is not None
    found = own_json(diagnose_own(plant, read_catalogue(plant.catalogue)))
    assert found["verdict"] == "none"
    assert found["causes"] == []
    assert found["where"] == []
    assert found["gap"]["augmented"] == pytest.approx(1.0, abs=0.05)


def test_what_no_effect_explains_is_called_unknown(tmp_path: Path, fmus: Path) -> None:
    plant = read_own_plant(write_plant(tmp_path, lambda v, s: 2.0 * math.sin(60 * s)), out=fmus)
    assert plant.catalogue is not None
    found = own_json(diagnose_own(plant, read_catalogue(plant.catalogue)))
    assert found["verdict"] == "unknown"
    assert any("times the sensors' noise" in note for note in found["notes"])


def test_the_command_line_takes_the_plant(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_plant(tmp_path, lambda v, s: 1.5 * math.tanh(v / 1e-3))
    assert is_own_plant(path)
    assert not is_own_plant(tmp_path)
    assert main(["diagnose", str(path), "--json", str(tmp_path / "out.json")]) == 0
    out = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert {
        "schema",
        "verdict",
        "where",
        "causes",
        "answer_set",
        "gap",
        "closed_loop",
        "next_experiment",
        "seconds",
    } <= set(out)
    assert "coulomb" in capsys.readouterr().out
    assert (
        main(
            [
                "diagnose",
                str(path),
                "--catalogue",
                str(Path(__file__).parents[3] / "pneugantry" / "diagnosis" / "effects"),
            ]
        )
        == 2
    )
    assert "no such parameter" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('u = "force"', 'u = "torque"', "torque: no such column"),
        ('u = "force"', 'w = "force"', "w: no such variable"),
        ("m = 0.03", "mass = 0.03", "mass: no such variable"),
        ("sigma = 0.002", "sigma = 0", "must be > 0"),
        ("period = 2e-3", "period = 2.5e-3", "whole number of milliseconds"),
        ('"swings.csv"', '"none.csv"', "no such file"),
        ('"swings.csv"', '"swings.csv"\nuse = "held out"', "every log is held out"),
        ("[inputs]", "[input]", "input: unknown key; did you mean inputs"),
    ],
)
def test_an_unusable_description_is_refused_in_one_line(
    tmp_path: Path, fmus: Path, old: str, new: str, said: str
) -> None:
    path = write_plant(tmp_path, lambda v, s: 0.0)
    path.write_text(PLANT.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=said):
        read_own_plant(path, out=fmus)


def test_a_matlab_file_is_read_apart_and_a_damaged_one_ends_nothing(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    savemat(path, {"file": np.arange(5.0), "note": "no number", "qg": np.ones((4, 1))})
    columns = read_mat(path)
    assert sorted(columns) == ["file", "qg"]
    assert columns["file"].ravel().tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    whole = path.read_bytes()
    for cut in (0, 100, 140, len(whole) - 3):
        path.write_bytes(whole[:cut])
        with pytest.raises(ValueError, match=r"\w"):
            read_mat(path)
