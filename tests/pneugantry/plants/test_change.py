"""Two campaigns of one rig: what came, what went, what stayed, on the tutorial's motor, simulated
by a Runge-Kutta method that shares nothing with the compiler (`benchmarks.two_campaigns`).
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from jsonschema import Draft202012Validator

from benchmarks.two_campaigns import KINDS, TORQUES, motor_log, pair_of, written
from pneugantry.cli import main
from pneugantry.engine.answer.result import to_json
from pneugantry.plants.changed import diagnose_change

MOTOR = Path(__file__).parents[3] / "examples" / "motor"
SCHEMA = Path(__file__).parents[3] / "docs" / "reference" / "schemas" / "gap.json"
RIG = {"J": 0.0204, "k_t": 0.495, "b": 0.021, "tau_c": 0.0, "tau_o": 0.0, "tau_g": 0.0}
WORN = RIG | {"tau_c": 0.15}
LOGS = {"sines": "fit", "steps": "held out"}


def campaign(folder: Path, rig: Mapping[str, float], seed: int) -> Path:
    """A description with its logs in a folder of its own; returns its path."""
    folder.mkdir()
    text = (MOTOR / "plant.toml").read_text(encoding="utf-8").split("[log.sines]")[0]
    text = text.replace('"Motor.mo"', '"../Motor.mo"').replace('"effects"', '"../effects"')
    for k, (log, use) in enumerate(LOGS.items()):
        noise = 0.02 * np.random.default_rng(seed + k).standard_normal(1000)
        motor_log(log, rig, noise).to_csv(folder / f"{log}.csv", index=False)
        text += f'[log.{log}]\nfile = "{log}.csv"\nuse = "{use}"\n'
    (folder / "plant.toml").write_text(text, encoding="utf-8")
    return folder / "plant.toml"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rig")
    shutil.copy(MOTOR / "Motor.mo", folder)
    shutil.copytree(MOTOR / "effects", folder / "effects")
    return folder


def told(before: Path, after: Path) -> dict:
    return to_json(diagnose_change(before, after)[0].diagnosis)


def became(found: dict) -> dict[str, str]:
    """What is likelier than not of each effect."""
    effects = found["changes"]["effects"]
    return {e["effect"]: e["what"] for e in effects if e["probabilities"][e["what"]] > 0.5}


@pytest.fixture(scope="module")
def worn(home: Path) -> Path:
    """Coulomb friction that the data sheet lacks."""
    return campaign(home / "worn", WORN, 1)


@pytest.fixture(scope="module")
def pulled(home: Path) -> Path:
    """The same with a constant torque."""
    return campaign(home / "worn_and_pulled", WORN | {"tau_o": 0.06}, 5)


def test_what_came_is_told_from_what_stayed(
    worn: Path, pulled: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, told_to = tmp_path / "change.html", tmp_path / "change.json"
    arguments = ["diagnose", str(worn), "--after", str(pulled)]
    assert main([*arguments, "--html", str(page), "--json", str(told_to)]) == 0
    found = json.loads(told_to.read_text(encoding="utf-8"))
    Draft202012Validator(json.loads(SCHEMA.read_text(encoding="utf-8"))).validate(found)
    assert found["verdict"] == "identified"
    assert became(found) == {"coulomb_friction": "stayed", "constant_torque": "came"}
    moved = {e["effect"]: e["parameters"] for e in found["changes"]["effects"]}
    torque, friction = moved["constant_torque"]["tau_o"], moved["coulomb_friction"]["tau_c"]
    low, high = torque["ci95"]
    assert torque["before"] == 0.0
    assert low < 0.06 < high < low + 0.02
    assert friction["before"] == friction["after"] == pytest.approx(0.15, rel=0.1)
    assert friction["change"] == 0.0
    gaps = {g["log"]: g for g in found["changes"]["gaps"]}
    assert set(gaps) == {"before/steps", "after/steps"}
    assert all(g["shrink"] > 0.95 for g in gaps.values())
    printed = capsys.readouterr().out
    sure = next(e for e in found["changes"]["effects"] if e["effect"] == "constant_torque")
    came = sure["probabilities"]["came"]
    assert came > 0.9
    assert f"came: constant_torque, probability {100 * came:.0f} %, tau_o from 0 to 0.0" in printed
    assert "stayed: coulomb_friction" in printed
    text = page.read_text(encoding="utf-8")
    assert "Between the campaigns" in text
    assert "came: constant_torque" in text


@pytest.mark.slow
def test_what_went_is_told(worn: Path, pulled: Path) -> None:
    found = told(pulled, worn)
    assert became(found) == {"coulomb_friction": "stayed", "constant_torque": "went"}
    moved = next(e for e in found["changes"]["effects"] if e["effect"] == "constant_torque")
    assert moved["parameters"]["tau_o"]["after"] == 0.0
    assert moved["parameters"]["tau_o"]["change"] == pytest.approx(-0.06, abs=0.01)


@pytest.mark.slow
def test_an_effect_that_grew_is_there_in_both(home: Path, worn: Path) -> None:
    found = told(worn, campaign(home / "worse", WORN | {"tau_c": 0.25}, 9))
    assert became(found) == {"coulomb_friction": "changed"}
    moved = found["changes"]["effects"][0]["parameters"]["tau_c"]
    assert moved["before"] == pytest.approx(0.15, rel=0.1)
    assert moved["ci95"][0] < 0.10 < moved["ci95"][1]


def test_nothing_changed_on_a_sound_rig(home: Path) -> None:
    sound = [campaign(home / f"sound_{seed}", RIG, seed) for seed in (21, 31)]
    found = told(*sound)
    assert found["verdict"] == "none"
    assert became(found) == {}


@pytest.mark.slow
def test_tolerance_is_one_for_both_campaigns(home: Path) -> None:
    """Parameters that are off by as much in both are the rig's own, and no effect."""
    own = RIG | {"J": 0.021, "b": 0.0225}
    found = told(campaign(home / "own_1", own, 41), campaign(home / "own_2", own, 51))
    assert found["verdict"] == "none"


def test_another_plant_is_refused(
    home: Path, worn: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = home / "other" / "plant.toml"
    shutil.copytree(worn.parent, other.parent)
    text = worn.read_text(encoding="utf-8")
    other.write_text(text.replace("period = 5e-3", "period = 10e-3"), encoding="utf-8")
    assert main(["diagnose", str(worn), "--after", str(other)]) == 2
    assert "plant.period: differs from that of the campaign before" in capsys.readouterr().err
    assert main(["diagnose", str(worn), "--after", str(other.parent / "sines.csv")]) == 2
    assert "--after: is of another kind" in capsys.readouterr().err


@pytest.mark.parametrize("plant", ["motor", "drive", "gantry"])
@pytest.mark.parametrize("kind", KINDS)
def test_pairs_of_the_benchmark_are_what_they_say(plant: str, kind: str) -> None:
    pair = pair_of(plant, 91000, kind)
    assert sorted(pair.became.values()) == sorted(KINDS[kind])
    for effect, what in pair.became.items():
        before, after = pair.before.get(effect, 0.0), pair.after.get(effect, 0.0)
        assert {"came": before == 0 < after, "went": after == 0 < before,
                "stayed": before == after > 0, "changed": 0 < before < after}[what]  # fmt: skip


def test_a_pair_is_written_as_two_descriptions(tmp_path: Path) -> None:
    pair = pair_of("motor", 91006, "one for another")
    for path, sizes in zip(written(tmp_path, pair), (pair.before, pair.after), strict=True):
        assert sorted(p.name for p in path.parent.glob("*.csv")) == ["sines.csv", "steps.csv"]
        torque = {"tau_c": 0.0, "tau_o": 0.0, "tau_g": 0.0}
        torque |= {TORQUES[effect][0]: size for effect, size in sizes.items()}
        clean = motor_log("steps", {**pair.rig.off, **torque}, np.zeros(1000))
        left = pd.read_csv(path.parent / "steps.csv")["w"] - clean["w"]
        assert np.std(left) == pytest.approx(0.02, rel=0.1)
