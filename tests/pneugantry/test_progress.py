"""How far a command is: what a library logs is told while a command asks for it, and no longer."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import pytest

import pneugantry as pg
from modelica_fmu import Target
from pneugantry.building import build_told
from pneugantry.listening import logged
from pneugantry.progress import PAUSE, Stages, Watch
from pyfmi_runner.build import build_controller_fmu


def test_a_build_names_its_equations_and_each_binary(tmp_path: Path) -> None:
    seen: list[str] = []
    with logged("modelica_fmu", seen.append):
        build_controller_fmu("pi_fv", out=tmp_path)
        logging.getLogger("modelica_fmu").debug("of no interest")
    assert seen[0] == "equations of PneuGantry_Controllers_pi_fv"
    assert [text.split(",")[0] for text in seen[1:]] == ["binary 1 of 1"]
    with logged("modelica_fmu", seen.append):
        assert not build_controller_fmu("pi_fv", out=tmp_path).rebuilt
    logging.getLogger("modelica_fmu").warning("nobody listens")
    assert len(seen) == 2


def test_a_command_that_builds_first_says_so_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with build_told("run"):
        for _ in range(2):
            build_controller_fmu("pi_fv", Target(force=True), out=tmp_path)
    said = "run: building the FMU PneuGantry_Controllers_pi_fv, once\n"
    assert capsys.readouterr().err == said
    build_controller_fmu("pi_fv", Target(force=True), out=tmp_path)
    assert capsys.readouterr().err == ""


def test_an_unusual_length_is_not_remembered(memory: Path) -> None:
    for seconds in (20.0, 90.0):
        with Stages("run") as say:
            if seconds > 50.0:
                say.unusual()
            say.watch.worked = seconds
    assert [round(v) for v in json.loads(memory.read_text())["run"]] == [20]


def test_a_run_names_its_stages() -> None:
    seen: list[str] = []
    phases = {"approach": (0.0, 1.0), "contact": (1.0, 1.5), "contour": (1.5, 2.0)}
    pg.run(pg.Scenario(workpiece="straight", start_z=0.038, phases=phases), say=seen.append)
    assert seen[:2] == ["model", "loop, compiled for this controller"]
    assert seen[-1] == "experiment, 100 % done"


def test_a_stage_that_lasts_is_a_line_where_there_is_no_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("pneugantry.progress.REFRESH", 0.01)
    with Stages("build") as say:
        for text in ("equations of X", "binary 1 of 2, x86_64-linux"):
            say(text)
            while say.told != text:
                say.end.wait(0.005)
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(" (")[0] for line in lines] == [
        "build: equations of X",
        "build: binary 1 of 2, x86_64-linux",
    ]


def test_a_clock_that_jumps_counts_as_a_pause() -> None:
    clock = iter([0.0, 1.0, 3.1e6, 3.1e6 + 1.0, 5.0, 6.0])
    watch = Watch(lambda: next(clock))
    assert [watch.tick() for _ in range(5)] == [1.0, 1.0 + PAUSE, 2.0 + PAUSE, 2.0 + PAUSE, 33.0]


@pytest.fixture
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of lengths, in a cache of its own."""
    monkeypatch.setenv("PNEUGANTRY_CACHE", str(tmp_path))
    return tmp_path / "durations.json"


@pytest.mark.parametrize(
    "stored", [3.1e6, [3.1e6], [-1.0, 0.0], [float("nan")], ["7"], {"each": 3}, None]
)
def test_a_stored_length_that_cannot_be_foretells_nothing(memory: Path, stored: object) -> None:
    memory.write_text(json.dumps({"diagnose campaign": stored}), encoding="utf-8")
    assert Stages("diagnose", "campaign").usual == 0.0


def test_one_spoilt_length_among_several_changes_little(memory: Path) -> None:
    lengths = [60.0, 62.0, 9_000.0, 61.0]
    memory.write_text(json.dumps({"diagnose campaign": lengths}), encoding="utf-8")
    assert Stages("diagnose", "campaign").usual == pytest.approx(61.5)


def test_lengths_are_kept_for_each_unit_of_work(
    memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A diagnosis counted as one and a demo counted in rows once shared an entry: 53,000 min."""
    monkeypatch.setattr("pneugantry.progress.WORTH", -1.0)
    for size, unit in ((1.0, "campaign"), (4.0, "binary")):
        with Stages("diagnose", unit, size) as say:
            say.watch.worked = 120.0
    assert Stages("diagnose", "campaign").usual == pytest.approx(120.0, abs=1.0)
    assert Stages("diagnose", "binary", 8.0).usual == pytest.approx(240.0, abs=2.0)
    assert Stages("diagnose").usual == 0.0


def test_the_last_lengths_are_remembered_and_no_more(memory: Path) -> None:
    for worked in (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 1e5):
        with Stages("plan") as say:
            say.watch.worked = worked
    assert [round(v) for v in json.loads(memory.read_text())["plan"]] == [20, 30, 40, 50, 60]
