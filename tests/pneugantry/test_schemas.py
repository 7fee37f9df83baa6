"""The JSON of every command has a published schema, and keeps to it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from pneugantry.cli import main

ROOT = Path(__file__).parents[2]
SCHEMAS = ROOT / "docs" / "reference" / "schemas"
NAMES = sorted(path.stem for path in SCHEMAS.glob("*.json"))
APART = {"truth", "state", "fmu"}  # files, not the result of a command
PHASES = "phases = { approach = [0.0, 1.0], contact = [1.0, 2.0], contour = [2.0, 3.0] }"


def schema(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((SCHEMAS / f"{name}.json").read_text(encoding="utf-8"))
    return found


def check(result: dict[str, Any]) -> None:
    """A result against the schema that it names."""
    Draft202012Validator(schema(result["schema"].split("/")[0])).validate(result)


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
}


def test_results_keep_to_their_schemas(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    for words in COMMANDS.values():
        capsys.readouterr()
        assert main([*words.split(), "--json", "-"]) == 0, words
        check(json.loads(capsys.readouterr().out))
