"""A user's plant: from its description to an answer, a model with that answer in it, and one line
for what cannot be.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from modelica_fmu.errors import InputError
from pneugantry.cli import main
from pneugantry.engine.answer.result import to_json
from pneugantry.engine.run import Found
from pneugantry.plants.described import (
    described_task,
    diagnose_described,
    is_plant_description,
    write_augmented,
)
from pneugantry.report.page import Extras, write_page
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile, FmuSession

MODEL = """
model Cart "A mass on a guide"
  parameter Real m(unit = "kg", min = 0.1) = 2 "Mass";
  parameter Real C(unit = "N.s/m", min = 0) = 4 "Viscous friction";
  parameter Real F_0(unit = "N") = 0 "Constant force; neutral 0";
  parameter Real spring(unit = "N/m") = 0 "Neutral 0";
  input Real u(unit = "N") "Force";
  output Real v(start = 0, fixed = true, unit = "m/s") "Speed";
  Real s(start = 0, fixed = true, unit = "m");
equation
  m*der(v) = u - C*v - F_0 - spring*s;
  der(s) = v;
end Cart;
"""
PLANT = """
[plant]
model = "Cart.mo"
class = "Cart"
catalogue = "effects"
period = {period}

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
EFFECT = """name = "{name}"
block = "{block}"
[[form]]
[form.parameters.{parameter}]
scale = 1.0
low = -50.0
high = 50.0
"""
EFFECTS = {"offset": ("drive", "F_0"), "spring": ("guide", "spring")}
OFFSET, PERIOD, ROWS = 1.5, 4e-3, 800


def record(path: Path, seed: int, period: float) -> None:
    """Exact for a force held over a period; m and C 2 % off; `OFFSET` against the force."""
    draw = np.random.default_rng(seed)
    time = np.arange(ROWS) * period
    force = 4 * np.sin((2 + seed) * time * (1 + time)) * PERIOD / period
    m, c, speed, v = 2.04, 3.92, np.empty(ROWS), 0.0
    decay = np.exp(-c / m * period)
    for k in range(ROWS):
        speed[k] = v
        v = decay * v + (1 - decay) * (force[k] - OFFSET) / c
    noisy = speed + draw.normal(0, 0.002, ROWS)
    pd.DataFrame({"force": force, "speed": noisy}).to_csv(path, index=False)


def text_of(name: str) -> str:
    block, parameter = EFFECTS[name]
    return EFFECT.format(name=name, block=block, parameter=parameter)


def written(folder: Path, period: float = PERIOD) -> Path:
    (folder / "effects").mkdir(parents=True)
    for name in EFFECTS:
        (folder / "effects" / f"{name}.toml").write_text(text_of(name), encoding="utf-8")
    (folder / "Cart.mo").write_text(MODEL, encoding="utf-8")
    (folder / "plant.toml").write_text(PLANT.format(period=period), encoding="utf-8")
    record(folder / "swings.csv", 1, period)
    record(folder / "other.csv", 2, period)
    return folder / "plant.toml"


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("parts")


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("own") / "cart")


@pytest.fixture(scope="module")
def one_file(plant: Path) -> Path:
    """The catalogue as one file."""
    tables = [text_of(n).replace("[[form]]", "[[effect.form]]") for n in EFFECTS]
    tables = [t.replace("[form.", "[effect.form.") for t in tables]
    path = plant.parent / "both.toml"
    path.write_text("".join(f"[[effect]]\n{t}" for t in tables), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def found(plant: Path, one_file: Path, cache: Path) -> Found:
    return diagnose_described(plant, one_file, cache)[0]


def test_an_effect_is_found_with_its_size_and_closes_the_gap(found: Found) -> None:
    told = to_json(found.diagnosis)
    assert told["verdict"] == "identified"
    assert told["answer_set"][0] == ["offset"]
    assert told["where"][0]["block"] == "drive"
    size = told["causes"][0]["parameters"]["F_0"]
    assert size["ci95"][0] < OFFSET < size["ci95"][1]
    assert told["gap"]["log"] == "other"
    assert told["gap"]["augmented"] == pytest.approx(1.0, abs=0.1)
    assert told["gap"]["shrink"] > 0.99


def test_the_plant_with_the_answer_in_it_moves_as_the_replay(found: Found, tmp_path: Path) -> None:
    model, fmu = write_augmented(tmp_path, found)
    text = model.read_text(encoding="utf-8")
    assert "extends Cart(" in text
    assert f"F_0 = {float(found.values['F_0'])!r}" in text
    assert "offset: probability" in text
    held = found.task.data.held_out
    assert held is not None
    assert found.augmented is not None
    out = np.empty(200)
    with FmuSession(FmuFile.read(fmu)) as session:
        for row in range(len(out)):
            session.set({"u": float(held.inputs["u"][row])})
            out[row] = session.get("v")
            session.step(PERIOD)
    bias, scale = (found.values[f"sensors.v.{w}"] for w in ("bias", "scale"))
    said = found.augmented.simulated[: len(out), 0]
    assert np.abs(scale * out + bias - said).max() < 1e-4


def test_it_has_a_page(found: Found, tmp_path: Path) -> None:
    page = write_page(found, tmp_path / "page.html", Extras(source="plant.toml"))
    text = page.read_text(encoding="utf-8")
    assert "Sim-to-real gap of cart" in text
    assert 'data-log="swings"' in text


def test_an_fmu_without_source_gives_the_same_answer(
    found: Found, plant: Path, cache: Path
) -> None:
    fmu = build_fmu("Cart", plant.parent / "Cart.mo", out=plant.parent / "fmu").path
    text = plant.read_text(encoding="utf-8").replace('class = "Cart"\n', "")
    text = text.replace('model = "Cart.mo"', f'fmu = "fmu/{fmu.name}"')
    foreign = plant.with_name("foreign.toml")
    foreign.write_text(text, encoding="utf-8")
    other, _ = diagnose_described(foreign, None, cache)
    assert other.diagnosis.verdict == "identified"
    assert other.decision.chosen == ("offset",)
    assert other.gap is not None
    assert found.gap is not None
    assert other.gap.nominal == pytest.approx(found.gap.nominal, rel=1e-3)
    assert other.gap.augmented == pytest.approx(found.gap.augmented, rel=1e-2)
    with pytest.raises(InputError, match="an FMU without source cannot be extended"):
        write_augmented(plant.parent / "out", other)


def test_the_command_writes_page_json_and_model(
    plant: Path, one_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told, page, out = tmp_path / "a.json", tmp_path / "a.html", tmp_path / "out"
    written = ["--json", str(told), "--html", str(page), "--augmented", str(out)]
    assert main(["diagnose", str(plant), "--catalogue", str(one_file), *written]) == 0
    assert "verdict: identified" in capsys.readouterr().out
    facts = json.loads(told.read_text(encoding="utf-8"))
    assert facts["causes"][0]["effect"] == "offset"
    assert "Sim-to-real gap of cart" in page.read_text(encoding="utf-8")
    assert {"AugmentedCart.fmu", "AugmentedCart.mo"} <= {p.name for p in out.iterdir()}


def test_periods_below_a_millisecond_are_read(tmp_path: Path, cache: Path) -> None:
    described, task = described_task(written(tmp_path / "fast", 0.25e-3), None, cache)
    assert described.data.fitted[0].period == pytest.approx(0.25e-3)
    (view,) = task.views
    left = view.residuals([(described.data.fitted[0], {"m": 2.04, "C": 3.92, "F_0": OFFSET})])[0]
    assert np.sqrt(np.mean(left**2)) == pytest.approx(0.002, rel=0.1)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("catalogue = ", "# "), "plant.catalogue: names no catalogue; write catalogue ="),
        (('column = "speed"', 'column = "rate"'), "no log has any of the columns"),
        (('class = "Cart"', ""), "names no plant, or more than one"),
        (("[tolerance]\nm", "[tolerance]\nmass"), "no such variable in the model"),
    ],
)
def test_what_cannot_be_is_one_line(
    change: tuple[str, str], words: str, plant: Path, tmp_path: Path, cache: Path
) -> None:
    text = plant.read_text(encoding="utf-8").replace(*change)
    wrong = plant.with_name("wrong.toml")
    wrong.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        described_task(wrong, None, cache)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("log", ["swings", "other"])
def test_a_log_that_shows_nothing_is_one_line(
    log: str, plant: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without the measured column, and with one that never moves: fitted, and held out."""
    folder = tmp_path / "cart"
    shutil.copytree(plant.parent, folder)
    table, file = pd.read_csv(folder / f"{log}.csv"), folder / f"{log}.csv"
    table.drop(columns="speed").to_csv(file, index=False)
    for command in ("diagnose", "calibrate"):
        assert main([command, str(folder / "plant.toml")]) == 2
        said = capsys.readouterr().err
        assert f"plant.toml: log.{log}: has no column of a measured signal (v); correct" in said
        assert said.count("\n") == 1
    table.assign(speed=0.001).to_csv(file, index=False)
    assert main(["diagnose", str(folder / "plant.toml")]) == 2
    where = "log" if log == "swings" else "log.other"
    assert f"plant.toml: {where}: nothing can be judged: no signal mov" in capsys.readouterr().err


def test_a_further_log_that_shows_nothing_is_noted(
    plant: Path, tmp_path: Path, cache: Path
) -> None:
    folder = tmp_path / "cart"
    shutil.copytree(plant.parent, folder)
    table = pd.read_csv(folder / "swings.csv")
    table.assign(speed=0.001).to_csv(folder / "still.csv", index=False)
    with (folder / "plant.toml").open("a", encoding="utf-8") as text:
        text.write('[log.still]\nfile = "still.csv"\n')
    _, task = described_task(folder / "plant.toml", None, cache)
    assert "still: nothing in it can be judged, not used" in task.notes


def test_a_log_in_another_unit_is_told(
    tmp_path: Path, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One of two logs has its speed in mm/s: no effect explains it, but the note says what may."""
    path = written(tmp_path / "cart")
    table = pd.read_csv(path.parent / "swings.csv")
    table["speed"] *= 1000
    table.to_csv(path.parent / "swings.csv", index=False)
    found, _ = diagnose_described(path, cache=cache)
    assert found.diagnosis.verdict == "unknown"
    (note,) = [n for n in found.diagnosis.notes if "check its unit" in n]
    assert note.startswith("swings: v reads ")
    assert "thousandths of the unit" in note
    assert main(["diagnose", str(path), "--no-learn"]) == 0
    assert note in capsys.readouterr().out


def test_a_sign_that_is_turned_round_is_told(tmp_path: Path, cache: Path) -> None:
    path = written(tmp_path / "cart")
    for name in ("swings", "other"):
        table = pd.read_csv(path.parent / f"{name}.csv")
        table["speed"] *= -1
        table.to_csv(path.parent / f"{name}.csv", index=False)
    found, _ = diagnose_described(path, cache=cache)
    assert found.diagnosis.verdict == "unknown"
    turned = [n for n in found.diagnosis.notes if "check the sign" in n]
    assert len(turned) == 2
    assert "v reads -1" in turned[0] or "v reads -0.9" in turned[0]


def test_a_simulation_without_noise_is_sound(tmp_path: Path, cache: Path) -> None:
    """What one tries first: the model's own motion, in closed form, as a log. One view is left to
    the last digit, another one integrates between rows.
    """
    path = written(tmp_path / "cart")
    text = path.read_text(encoding="utf-8")
    more = '[outputs.s]\nsigma = 0.0005\nunit = "m"\n\n[tolerance]'
    path.write_text(text.replace("[tolerance]", more), encoding="utf-8")
    rate = 4 / 2
    for name in ("swings", "other"):
        force = pd.read_csv(path.parent / f"{name}.csv")["force"].to_numpy()
        v, s = np.zeros(ROWS), np.zeros(ROWS)
        for k in range(ROWS - 1):
            end, fade = force[k] / 4, np.exp(-rate * PERIOD)
            v[k + 1] = end + (v[k] - end) * fade
            s[k + 1] = s[k] + end * PERIOD + (v[k] - end) * (1 - fade) / rate
        table = pd.DataFrame({"force": force, "speed": v, "s": s})
        table.to_csv(path.parent / f"{name}.csv", index=False)
    found, _ = diagnose_described(path, cache=cache)
    assert found.diagnosis.verdict == "none"
    assert found.diagnosis.probabilities["unknown"] < 0.05


def test_one_output_does_not_tell_who_is_late(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The plant moves as it was told 5 rows ago; or its speed is read 5 rows late."""
    monkeypatch.setattr(f"{__name__}.OFFSET", 0.0)
    path = written(tmp_path / "cart")
    for name in ("swings", "other"):
        log = pd.read_csv(path.parent / f"{name}.csv")
        told = np.append(log["force"][5:], [log["force"].iloc[-1]] * 5)
        log.assign(force=told).iloc[:-5].to_csv(path.parent / f"{name}.csv", index=False)
    found = diagnose_described(path, cache=cache)[0].diagnosis
    assert {k for keys in found.answer_set for k in keys} == {"input_delay(u)", "sensor_delay(v)"}


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("parameters.F_0", "parameters.F_9", "the plant has no such parameter"),
        ("block =", 'refines = ["magic"]\nblock =', "refines 'magic', which the catalogue lacks"),
        (
            "scale =",
            "neutral = 3.0\nscale =",
            "effect.toml: offset: F_0: neutral is 3, but 0 is what the plant has without",
        ),
        (
            "scale =",
            "relative = true\nscale =",
            "effect.toml: offset: F_0: is relative, but 0 is what the plant has without the effect",
        ),
        (
            "[form.parameters.F_0]",
            "[form.settings]\nspring = 1.0\n[form.parameters.F_0]\nrelative = true",
            "effect.toml: offset: F_0: is relative, but 0 is what the plant has without the effect",
        ),
        (
            "[form.parameters.F_0]",
            '[form.parameters."sensors.v.bias"]\nscale = 1.0\nlow = -1.0\nhigh = 1.0\n'
            "relative = true\n[form.parameters.F_0]",
            "effect.toml: offset: sensors.v.bias: is relative, but 0 is what the plant has",
        ),
        ("low = -50.0", "low = 0.1\npositive = true", "F_0.neutral: is 0, and the parameter pos"),
        ("low = -50.0", "low = 0.1", "F_0.low: is 0.1, high 50, and 0 is no effect"),
    ],
)
def test_a_catalogue_of_another_plant_is_refused(
    name: str, value: str, words: str, plant: Path, tmp_path: Path, cache: Path
) -> None:
    wrong = tmp_path / "effect.toml"
    wrong.write_text(text_of("offset").replace(name, value), encoding="utf-8")
    with pytest.raises(InputError, match=words):
        described_task(plant, wrong, cache)


def test_what_a_description_sets_holds_without_an_effect(tmp_path: Path, cache: Path) -> None:
    """The force that was found is written into the description; the catalogue stays as it is."""
    path = written(tmp_path / "cart")
    path.write_text(path.read_text("utf-8") + f"[parameters]\nF_0 = {OFFSET}\n", encoding="utf-8")
    assert diagnose_described(path, cache=cache)[0].diagnosis.verdict == "none"


def test_what_is_a_plant_of_ones_own(plant: Path, tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.toml"
    scenario.write_text('workpiece = "straight"\n', encoding="utf-8")
    assert [is_plant_description(p) for p in (plant, scenario, tmp_path)] == [True, False, False]
