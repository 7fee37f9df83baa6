"""Many campaigns: each diagnosed once, what fails said and tried again."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from modelica_fmu.errors import InputError
from pneugantry.cli import main
from pneugantry.jobs.job import Ended, Factory, Job, answer
from pneugantry.plants import campaigns
from pneugantry.plants.campaigns import RESULT, Diagnoser, campaign_folders, diagnose_campaigns
from pneugantry.plants.gantry.catalogue import FOLDER
from pneugantry.report.page import Extras
from pyfmi_runner.build import build_fmu

RUNS: list[str] = []


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Three campaigns, the second unreadable; the diagnosis is a stand-in that says which campaign
    it saw.
    """

    def read(path: Path, strict: bool, needs: Sequence[str]) -> SimpleNamespace:
        assert "f_ax" not in needs  # a rig need not measure everything
        if path.name == "b" and not (path / "mended").exists():
            raise InputError("no usable log", file=path / "campaign.toml", hint="correct its logs")
        return SimpleNamespace(diagnosis=SimpleNamespace(name=path.name, strict=strict))

    def here(factory: Factory, jobs: Sequence[Job], **_: object) -> Iterator[Ended]:
        function = factory()
        return (answer(function, job) for job in jobs)

    def report(found: Any, learned: None) -> dict[str, Any]:
        assert learned is None
        seen = found.diagnosis
        RUNS.append(seen.name)
        return {"verdict": "none", "strict": seen.strict, "campaign": seen.name}

    for name, value in {
        "read_campaign": read,
        "run_jobs": here,
        "diagnose": lambda found, *_, **__: found,
        "with_missing_term": lambda found, *_: (found, None),
        "to_json": report,
    }.items():
        monkeypatch.setattr(campaigns, name, value)
    RUNS.clear()
    for name in "abc":
        (tmp_path / name).mkdir()
        (tmp_path / name / "campaign.toml").touch()
    return tmp_path


def test_each_is_diagnosed_once_and_what_failed_is_tried_again(folder: Path) -> None:
    found = campaign_folders(folder)
    told: list[str] = []
    fmu = build_fmu().path
    results = diagnose_campaigns(found, Diagnoser(fmu, strict=False), done=told.append)
    assert [path.name for path in results] == told == ["a", "b", "c"]
    assert (
        results[folder / "a"].items()
        >= {"verdict": "none", "strict": False, "campaign": "a"}.items()
    )
    assert results[folder / "b"]["verdict"] == "failed"
    assert "no usable log; correct its logs" in results[folder / "b"]["reason"]
    assert json.loads((folder / "c" / RESULT).read_text())["campaign"] == "c"
    assert not (folder / "b" / RESULT).exists()
    (folder / "b" / "mended").touch()
    (folder / "b" / RESULT).write_text("[]")  # not what was written there
    assert diagnose_campaigns(found, Diagnoser(fmu))[folder / "b"]["campaign"] == "b"
    assert RUNS == ["a", "c", "b"]
    catalogue = folder / "own.toml"
    catalogue.write_bytes((FOLDER / "stribeck.toml").read_bytes())
    diagnose_campaigns(
        found, Diagnoser(fmu, catalogue)
    )  # what another catalogue found is no answer
    assert RUNS == ["a", "c", "b", "a", "b", "c"]


def test_what_was_diagnosed_otherwise_is_diagnosed_again(folder: Path) -> None:
    one, logs = [folder / "a"], folder / "a" / "logs"
    logs.mkdir()
    steps = [
        (folder / "a" / "campaign.toml", "name = 'corrected'"),
        (folder / "a" / "straight.csv", "time,u_x\n"),
        (folder / "a" / "straight.csv", "time,u_z\n"),
        (folder / "a" / "campaign.toml", "[log.other]\nfile = 'logs/other.dat'"),
        (logs / "other.dat", "time"),
        *((folder / "a" / RESULT, other) for other in ("[]", "{}", '{"verdict": "none"}')),
    ]
    diagnose_campaigns(one, Diagnoser())
    for count, (path, text) in enumerate(steps, start=2):
        path.write_text(text)
        for _ in range(2):
            diagnose_campaigns(one, Diagnoser())
        assert len(RUNS) == count, path


def test_a_folder_that_cannot_be_read_leaves_the_others(folder: Path) -> None:
    (folder / "a" / "campaign.toml").write_text("[log")
    (folder / "d").mkdir()
    (folder / "d" / "plant.toml").write_text("[inputs]")
    results = diagnose_campaigns(campaign_folders(folder), Diagnoser())
    assert "plant" in results[folder / "d"]["reason"]
    assert results[folder / "c"]["verdict"] == "none"


def test_the_command_says_a_line_for_each(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    cause = {"effect": "presliding", "axis": "z"}
    found = {"verdict": "identified", "causes": [cause], "gap": {"shrink": 0.91}}
    monkeypatch.setattr(campaigns, "to_json", lambda *_: found)
    monkeypatch.setattr(campaigns, "extras_of", lambda *_: Extras())
    monkeypatch.setattr(campaigns, "write_page", lambda _, path, *rest: path.touch())
    assert main(["diagnose", str(folder), "--json", str(folder / "all.json")]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "a: identified presliding/z, shrink 0.910"
    assert said[1].startswith("b: failed: ")
    assert set(json.loads((folder / "all.json").read_text())["campaigns"]) == {"a", "b", "c"}
    assert (folder / "a" / "diagnosis.html").is_file()
    assert main(["diagnose", str(folder), "--html", "x.html"]) == 2
    assert "--html: is for one campaign" in capsys.readouterr().err


def test_a_campaign_is_no_folder_of_campaigns(folder: Path) -> None:
    assert (
        campaign_folders(folder / "a")
        == campaign_folders(folder / "a" / "campaign.toml")
        == campaign_folders(folder / "gone")
        == []
    )
