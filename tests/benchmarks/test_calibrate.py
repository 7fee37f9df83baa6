"""Rigs whose truth is known, as blind checks and truth plants leave them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.calibrate import cases_in, main
from pneugantry.engine.calibration.weights import PARTS

TRUTH = {"kind": "one", "causes": [{"effect": "drag", "axis": "x", "known": True}]}
SAID = {"weighed": [{"effects": ["drag/x"], "cost": -100.0}], "stands_out": 0.1}


def put(path: Path, what: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(what), encoding="utf-8")


def test_truth_lies_beside_a_diagnosis_or_is_sealed_above_it(tmp_path: Path) -> None:
    seeds = range(PARTS)
    put(tmp_path / "blind" / "sealed_labels.json", {str(s): TRUTH for s in (*seeds, 99)})
    for seed in seeds:
        put(tmp_path / "blind" / f"case_{seed}" / "diagnosis.json", SAID)
    put(tmp_path / "rig" / "truth.json", {**TRUTH, "kind": "unknown"})
    put(tmp_path / "rig" / "diagnosis.json", SAID)
    found = cases_in([tmp_path])
    assert len(found) == PARTS + 1  # one of the sealed ones has not been diagnosed
    assert [c.unknown for c in found].count(True) == 1
    assert {c.effects for c in found} == {frozenset({"drag/x"})}


def test_other_weights_are_held_against_the_present_ones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for seed in range(PARTS):
        put(tmp_path / f"rig_{seed}" / "truth.json", TRUTH)
        put(tmp_path / f"rig_{seed}" / "diagnosis.json", SAID)
    assert main(["--with", "imitated=0.5", str(tmp_path)]) == 0
    head, now, other = capsys.readouterr().out.splitlines()
    assert head.startswith(f"{PARTS} rigs")
    assert other.endswith("imitated 0.5")
    assert float(now.split()[0]) > float(other.split()[0])  # what it named was there


@pytest.mark.parametrize("given", ["imitated", "imitated=1.5", "temper=0", "entry=nan", "age=3"])
def test_what_is_no_weight_is_refused(given: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["--with", given, "."])
    assert stopped.value.code == 2
    assert f"'{given}': NAME=VALUE" in capsys.readouterr().err
