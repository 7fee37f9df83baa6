"""The JSON of every command has a published schema, and keeps to it."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator, ValidationError

from pneugantry.cli import main
from pneugantry.engine.answer.confirm import Gap
from pneugantry.engine.answer.result import Diagnosis, to_json

Check = Callable[[dict[str, Any]], None]
ROOT = Path(__file__).parents[2]
RECORDED = sorted((ROOT / "docs" / "results" / "data").glob("*.json"))
SCHEMAS = ROOT / "docs" / "reference" / "schemas"
NAMES = sorted(path.stem for path in SCHEMAS.glob("*.json"))
APART = {"truth", "state", "fmu"}  # files, not the result of a command
PHASES = "phases = { approach = [0.0, 1.0], contact = [1.0, 2.0], contour = [2.0, 3.0] }"


def schema(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((SCHEMAS / f"{name}.json").read_text(encoding="utf-8"))
    return found


@pytest.mark.parametrize("name", NAMES)
def test_a_schema_is_one_and_names_itself(name: str) -> None:
    found = schema(name)
    Draft202012Validator.check_schema(found)
    assert found["title"] == f"{name}/1"
    assert found["properties"]["schema"] == {"const": f"{name}/1"}


def test_every_result_has_a_schema() -> None:
    code = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "pneugantry").rglob("*.py"))
    named = set(re.findall(r'"schema": "(\w+)/1"', code)) - APART
    assert named == set(NAMES)


def test_every_result_of_a_command_stands_in_the_documents() -> None:
    told = (ROOT / "docs" / "reference" / "cli.md").read_text(encoding="utf-8")
    assert {name for name in NAMES if f"| `{name}/1` |" not in told} == {"thesis_peers"}


def test_a_diagnosis_is_documented_field_by_field() -> None:
    """What is written, what the schema has and what the page of it tells, each once."""
    written = re.findall(r'^ +(?:\*\*.* )?\{?"(\w+)": ', inspect.getsource(to_json), re.MULTILINE)
    fields = {*schema("gap")["properties"]}
    assert fields == {f for f in written if f != "effect"} | {"learned"}
    page = (ROOT / "docs" / "reference" / "gap.md").read_text(encoding="utf-8")
    heads = re.findall(r"^\| (`.*?`) \|", page.split("## Result")[1].split("## Scores")[0], re.M)
    told = [name for head in heads for name in re.findall(r"`(\w+)`", head)]
    assert sorted(told) == sorted(fields - {"schema", "unknown_probability"})


def test_the_gap_until_the_replay_left_the_log_keeps_to_the_schema(keeps_to_schema: Check) -> None:
    early = Gap(9.0, 1.0, 1.0, 1.0, (0.9, 1.0), "log", {})
    gap = Gap(14.0, 8.0, 1.0, 0.7, (0.5, 0.9), "log", {}, parted=1.5, early=early)
    found = to_json(Diagnosis("none", (), (), (), gap))
    keeps_to_schema(found)
    assert found["gap"]["until"]["t"] == 1.5
    found["gap"]["until"]["other"] = 1.0
    with pytest.raises(ValidationError):
        keeps_to_schema(found)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results")
    start = "start = { x = 0.95, z = 0.038 }"
    (folder / "s.toml").write_text(f'workpiece = "straight"\n{start}\n{PHASES}\n', encoding="utf-8")
    (folder / "sweep.toml").write_text('base = "s.toml"\n[grid]\nseed = [1, 2]\n', encoding="utf-8")
    return folder


COMMANDS = {
    "build": "build",
    "run": "run s.toml --out log.parquet",
    "log": "log check log.parquet",
    "replay": "replay log.parquet",
    "linearize": "linearize --sampled",
    "rootlocus": "rootlocus --lag none",
    "rootlocus with a delay": "rootlocus --delay 0.005",
    "sweep": "sweep sweep.toml --workers 1 --out sweep",
    "list": "list effects",
    "controller": "controller init my.py",
    "completion": "completion bash",
    "thesis": "thesis --list",
}  # identify, blind, bench, demo and plan: where their own tests run them


def test_results_keep_to_their_schemas(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    keeps_to_schema: Check,
) -> None:
    monkeypatch.chdir(folder)
    for words in COMMANDS.values():
        capsys.readouterr()
        assert main([*words.split(), "--json", "-"]) == 0, words
        keeps_to_schema(json.loads(capsys.readouterr().out))


@pytest.mark.parametrize("path", RECORDED, ids=lambda path: path.stem)
def test_recorded_results_keep_to_their_schemas(path: Path, keeps_to_schema: Check) -> None:
    """Whole studies that no test can run: the thesis' tables, its board, its gap."""
    kept = json.loads(path.read_text(encoding="utf-8"))
    if kept["command"].startswith("pneugantry"):  # the others are `python -m benchmarks.*`
        keeps_to_schema(kept["result"])


def test_a_result_that_breaks_its_schema_is_seen(keeps_to_schema: Check) -> None:
    with pytest.raises(ValidationError, match="'report' is a required property"):
        keeps_to_schema({"schema": "demo/1"})
