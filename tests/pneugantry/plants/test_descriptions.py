"""Descriptions in the repository keep to the published schema, and it refuses what the reader of
descriptions refuses.
"""

from __future__ import annotations

import copy
import json
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

ROOT = Path(__file__).resolve().parents[3]
SCHEMA = json.loads((ROOT / "docs/reference/plant.schema.json").read_text(encoding="utf-8"))
LOG = {"train": {"file": "train.csv"}}


@pytest.mark.parametrize("name", ["bam", "drive", "emps", "motor", "seals"])
def test_an_example_keeps_to_the_schema(name: str) -> None:
    path = ROOT / "examples" / name / "plant.toml"
    table = {"log": LOG, **tomllib.loads(path.read_text(encoding="utf-8"))}
    Draft202012Validator(SCHEMA).validate(table)


@pytest.mark.parametrize("key", ["outputs", "plant.periods", "log.sines.use", "tolerance.J"])
def test_what_is_no_description_does_not(key: str) -> None:
    path = ROOT / "examples" / "motor" / "plant.toml"
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    wrong = copy.deepcopy(table)
    *parents, last = key.split(".")
    node = wrong
    for parent in parents:
        node = node[parent]
    if parents:
        node[last] = "x"
    else:
        del node[last]
    assert Draft202012Validator(SCHEMA).is_valid(table)
    assert not Draft202012Validator(SCHEMA).is_valid(wrong)
