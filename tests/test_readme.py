"""README.md keeps its word: its snippets run, its commands parse, its tables and its file map are
those of the code.
"""

from __future__ import annotations

import importlib.util
import re
import shlex
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

from pneugantry.cli import COMMANDS, parser
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import setup_from
from pyfmi_runner.log import COLUMNS
from pyfmi_runner.scenario import scenario_from

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def file_map_module() -> ModuleType:
    spec = importlib.util.spec_from_file_location("file_map", ROOT / "docs" / "file_map.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (0, r"[1-9]\d\.\d N at z = 4\d\.\d mm\n"),
        (1, r"[1-9]\d\.\d+ \[\[.*\]\]\n"),
        (2, r"done [1-9]\d?\.\d+\n"),
    ],
)
def test_a_python_snippet_runs(
    number: int, said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    build_fmu(out=ROOT / "fmus")
    monkeypatch.chdir(ROOT)
    assert len(blocks("python")) == 3
    module = ModuleType("snippet")  # a kernel's compilation looks its globals up there
    monkeypatch.setitem(sys.modules, "snippet", module)
    exec(compile(blocks("python")[number], f"README.md snippet {number}", "exec"), module.__dict__)
    assert re.fullmatch(said, capsys.readouterr().out)


def test_the_scenario_and_the_campaign_are_ones() -> None:
    scenario, campaign = (tomllib.loads(text) for text in blocks("toml"))
    assert scenario_from(scenario).timing.delay == 0.0015
    for table in campaign["log"].values():
        assert setup_from(table).workpiece == "curved"


def test_the_commands_are_those_of_the_command_line() -> None:
    table = re.findall(r"^\| `(\w+)` \| [^|]+ \|$", README, re.MULTILINE)
    assert table == [name for name in (*COMMANDS,) if name in table]  # same order, nothing made up
    assert set(table) == set(COMMANDS)
    lines = [
        *re.findall(r"^    (pneugantry .*)$", README, re.MULTILINE),
        *re.findall(r"`(pneugantry [a-z]+ -[^`]*)`", README),
    ]
    assert len(lines) > 3
    for line in lines:
        if "COMMAND" not in line:
            parser().parse_args(shlex.split(line)[1:])


def test_the_columns_are_those_of_a_log() -> None:
    rows = re.findall(r"^\| `(\w+)` \| ([^|]+) \| ([^|]+) \|$", README, re.MULTILINE)
    assert [(name, COLUMNS[name].unit, COLUMNS[name].sign) for name in COLUMNS] == rows


def test_every_module_says_in_a_sentence_what_it_is() -> None:
    module = file_map_module()
    for package in module.PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            if path.read_text(encoding="utf-8").strip():
                assert module.summary(path), path


def test_pictures_and_links_are_there_and_small() -> None:
    for target in re.findall(r"\]\((?!http)([^)]+)\)", README):
        assert (ROOT / target).is_file(), target
    for picture in (ROOT / "docs" / "images").iterdir():
        assert picture.stat().st_size < 200_000, picture


def test_no_path_of_one_machine() -> None:
    for path in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        assert not re.search(
            r"(?<![\w.])/(work|home|root|tmp|usr|Users)/", path.read_text(encoding="utf-8")
        ), path
