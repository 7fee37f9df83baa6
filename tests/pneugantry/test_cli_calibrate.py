"""`pneugantry calibrate`."""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pneugantry.cli import main
from pneugantry.commands.calibrate import _kept, _rigs
from pneugantry.jobs.job import Ended, Job
from pneugantry.plants.calibrate import KEPT
from pneugantry.plants.calibration_file import chances_of, stamp_of

MOTOR = Path(__file__).parents[2] / "examples" / "motor"
Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibrate") / "motor"
    shutil.copytree(MOTOR, folder)
    return folder / "plant.toml"


def calibrate(plant: Path, *options: str) -> int:
    return main(["calibrate", str(plant), "--workers", "1", "--json", "-", *options])


def test_a_motor_s_probabilities(
    capsys: Capture, plant: Path, keeps_to_schema: Callable[[dict[str, Any]], None]
) -> None:
    """Ten rigs; what is done is kept, and the result serves the next diagnosis."""
    capsys.readouterr()
    assert main(["diagnose", str(plant), "--no-learn"]) == 0
    assert "probabilities are not calibrated for this plant" in capsys.readouterr().out
    assert calibrate(plant, "--cases", "10") == 0
    found = json.loads(capsys.readouterr().out)
    keeps_to_schema(found)
    assert found["rigs"] == 10
    assert found["failed"] == []
    assert found["error"] < 0.2
    kept = plant.with_suffix(".rigs.jsonl")
    assert len(kept.read_text(encoding="utf-8").splitlines()) == 10
    assert calibrate(plant, "--cases", "10") == 0  # from what is kept
    again = json.loads(capsys.readouterr().out)
    assert again["chances"] == found["chances"]
    assert len(kept.read_text(encoding="utf-8").splitlines()) == 10
    assert main(["diagnose", str(plant), "--no-learn"]) == 0
    assert "calibrated" not in capsys.readouterr().out


def test_other_effects_are_another_calibration(plant: Path) -> None:
    """Given, or changed in their folder; neither is taken for the rigs that were kept."""
    other = plant.with_name("fewer")
    other.mkdir()
    shutil.copy(next(iter(sorted(plant.with_name("effects").glob("*.toml")))), other)
    plain, given = stamp_of(plant), stamp_of(plant, other)
    assert plain != given
    assert plain == stamp_of(plant, plant.with_name("effects"))
    assert chances_of(plant)[1] == ""
    note = chances_of(plant, other)[1]
    assert "or the catalogue has changed since plant.calibration.json" in note
    assert note.endswith(f"pneugantry calibrate {plant} --catalogue {other}")
    kept = plant.with_suffix(".rigs.jsonl")
    assert [len(_kept(kept, stamp)) for stamp in (plain, given)] == [10, 0]
    older = kept.with_name("older.jsonl")
    older.write_text(kept.read_text(encoding="utf-8").replace("stood_out", "was_out"), "utf-8")
    assert _kept(older, plain) == []
    for changed in ("data/sines.csv", "Motor.mo", "effects/unbalance.toml"):
        file = plant.parent / changed
        text = file.read_text(encoding="utf-8")
        file.write_text(text + "\n", encoding="utf-8")
        assert stamp_of(plant) != plain, changed
        file.write_text(text, encoding="utf-8")
    assert stamp_of(plant) == plain


def test_a_changed_description_needs_another_one(capsys: Capture, plant: Path) -> None:
    text = plant.read_text(encoding="utf-8")
    changed = plant.with_name("other.toml")
    changed.write_text(text + "\n# another\n", encoding="utf-8")
    shutil.copy(plant.with_suffix(".calibration.json"), changed.with_suffix(".calibration.json"))
    capsys.readouterr()
    assert main(["diagnose", str(changed), "--no-learn"]) == 0
    assert "has changed since other.calibration.json was made" in capsys.readouterr().out
    made = json.loads(changed.with_suffix(".calibration.json").read_text(encoding="utf-8"))
    made["plant"] = stamp_of(changed)
    made["chances"]["unknown_beside"] = made["chances"].pop("unknown_left")
    changed.with_suffix(".calibration.json").write_text(json.dumps(made), encoding="utf-8")
    assert "other.calibration.json was made by another version" in chances_of(changed)[1]
    changed.with_suffix(".calibration.json").write_text("{}", encoding="utf-8")
    assert main(["diagnose", str(changed), "--no-learn"]) == 2
    assert "other.calibration.json: is no calibration" in capsys.readouterr().err


def test_an_unusable_description_is_one_line(capsys: Capture, plant: Path) -> None:
    wrong = plant.with_name("wrong.toml")
    wrong.write_text(plant.read_text(encoding="utf-8").replace("J = ", "Jx = "), encoding="utf-8")
    capsys.readouterr()
    assert calibrate(wrong, "--cases", "10") == 2
    assert "wrong.toml: tolerance.Jx: no such variable" in capsys.readouterr().err


def test_what_is_no_plant_is_refused(capsys: Capture, plant: Path, tmp_path: Path) -> None:
    capsys.readouterr()
    assert calibrate(tmp_path, "--cases", "10") == 2
    assert "is no description of a plant" in capsys.readouterr().err
    assert calibrate(plant, "--cases", "0") == 2
    assert "--cases: is 0, expected >= 10" in capsys.readouterr().err
    own = tmp_path / "new.toml"
    shutil.copy(plant, own)
    assert calibrate(own, "--cases", "9") == 2  # before any rig is drawn
    assert "--cases: is 9, expected >= 10; draw more" in capsys.readouterr().err
    assert not own.with_suffix(".rigs.jsonl").exists()


def test_a_line_that_a_stop_cut_off_costs_no_other(
    plant: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut = plant.with_name("cut.toml")
    shutil.copy(plant, cut)
    stamp, kept = stamp_of(cut), cut.with_suffix(".rigs.jsonl")
    said = {"answer": dict.fromkeys(KEPT)}
    lines = [json.dumps({"seed": seed, "plant": stamp, **said}) for seed in range(3)]
    kept.write_text("\n".join(lines)[:-20], encoding="utf-8")

    def run(factory: object, jobs: list[Job], **more: object) -> list[Ended]:
        return [Ended(job.key, value={"seed": job.key, **said}) for job in jobs]

    monkeypatch.setattr("pneugantry.jobs.run.run_jobs", run)
    options = {"cases": 10, "seed": 0, "catalogue": None, "workers": 1, "scheduler": None}
    rigs, _ = _rigs(argparse.Namespace(plant=cut, **options))
    assert [r["seed"] for r in rigs] == list(range(10))
    assert [r["seed"] for r in _kept(kept, stamp)] == list(range(10))
