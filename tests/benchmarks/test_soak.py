"""The soak in short: memory, sanitized calls and damaged files; `python -m benchmarks.soak` runs
the long form.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.soak.__main__ import main
from benchmarks.soak.archives import KINDS, fuzz_archives
from benchmarks.soak.calls import sanitized_calls
from benchmarks.soak.memory import ALLOWED, instances, steps
from modelica_fmu.errors import InputError
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile


@pytest.fixture(scope="module")
def file() -> FmuFile:
    return FmuFile.read(build_fmu().path)


def test_steps_and_instances_leave_no_memory_behind(file: FmuFile) -> None:
    for growth in (steps(file, 20_000), instances(file, 1000)):
        assert growth.grown < ALLOWED / 4, growth


def test_calls_in_any_order_are_clean_under_the_sanitizers(file: FmuFile) -> None:
    try:
        counts = sanitized_calls(file, 20_000)
    except InputError as error:
        pytest.skip(str(error))
    assert counts["calls"] == sum(
        counts[status] for status in ("ok", "warning", "discard", "error", "fatal")
    )
    assert counts["ok"] > 0.5 * counts["calls"]  # the others are refused, and that is tested too
    assert counts["error"] > 100
    assert counts["fatal"] == 0


def test_damaged_and_hostile_files_are_refused_or_harmless(file: FmuFile) -> None:
    found = fuzz_archives(file.path, 20 * len(KINDS), seed=7)
    assert found["escaped"] == 0
    for kind, counts in found["kinds"].items():
        assert set(counts) <= {"refused", "read"}, kind
        if kind in ("path outside", "bomb", "entities"):
            assert counts == {"refused": 20}, kind


def test_the_command_writes_its_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "benchmarks.soak.__main__.soak",
        lambda file, counts: {"schema": "soak/2", "passed": False, "counts": counts},
    )
    assert main(["--short", "--json", str(tmp_path / "x.json")]) == 1
    assert json.loads((tmp_path / "x.json").read_text())["counts"] == [
        10_000,
        1000,
        10_000,
        60,
        1000,
        1000,
        100,
        1,
    ]
