"""The commands for speed and for other tools: controllers as FMUs, bench."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from pneugantry.cli import main

ROOT = Path(__file__).parents[2]
Capture = pytest.CaptureFixture[str]
SCENARIO = (
    'workpiece = "straight"\nstart = { x = 0.95, z = 0.038 }\nphases = { contact = [0.0, '
    "1.0], contour = [1.0, 2.0] }\n"
)


def result(capture: Capture, *arguments: str) -> dict:
    capture.readouterr()
    assert main([*arguments, "--json", "-"]) == 0
    return json.loads(capture.readouterr().out)


def test_a_controller_is_built_as_an_fmu_and_runs_like_the_native_one(
    capsys: Capture, tmp_path: Path
) -> None:
    built = result(capsys, "build", "--controller", "pi_fv", "--out", str(tmp_path))
    assert Path(built["fmu"]).name == "PneuGantry_Controllers_pi_fv.fmu"
    assert (
        result(capsys, "build", "--controller", "pi_fv", "--out", str(tmp_path))["rebuilt"] is False
    )
    (tmp_path / "short.toml").write_text(SCENARIO)
    native = result(capsys, "run", str(tmp_path / "short.toml"))
    exported = result(capsys, "run", str(tmp_path / "short.toml"), "--controller", built["fmu"])
    assert native["metrics"] == exported["metrics"]


def test_a_controller_with_arrays_is_refused_in_one_line(capsys: Capture, tmp_path: Path) -> None:
    assert main(["build", "--controller", "pi_fv_mbpm", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "holds ndarray nn.v" in said


def test_the_parts_of_a_diagnosis_are_compiled_once(
    capsys: Capture, keeps_to_schema: Callable[[dict], None]
) -> None:
    motor = str(ROOT / "examples/motor/plant.toml")
    result(capsys, "build", "--parts", motor)
    again = result(capsys, "build", "--parts", motor)
    keeps_to_schema(again)
    assert again["parts"] == 0
    assert main(["build", "--parts", "--controller", "pi_fv"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "--controller: is not for --parts" in said


def test_bench_writes_the_rows_that_cli_md_promises(
    capsys: Capture, keeps_to_schema: Callable[[dict], None]
) -> None:
    found = result(capsys, "bench", "--rounds", "1", "--only-paths")
    keeps_to_schema(found)
    assert {"path", "us_per_step", "ratio_to_c"} <= set(found["rows"][0])
    assert found["rows"][0]["ratio_to_c"] == 1.0
    assert found["machine"]["cores"] >= 1
    assert main(["bench", "--rounds", "0"]) == 2
