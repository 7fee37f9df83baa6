"""What FMI's cross-check asks of an exporter; `python -m benchmarks.cross_check` writes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fmpy.cross_check.validate_vendor_repo import validate_test_fmu

from benchmarks.cross_check import TYPES, checked, main, read_csv

MODEL = """model Oscillator "A mass on a spring"
  input Real f(unit = "N") "Force";
  output Real y(unit = "m") = s "Position";
  Real s(unit = "m", start = 0.1, fixed = true) "Position";
  Real v(unit = "m/s", start = 0, fixed = true) "Speed";
equation
  der(s) = v;
  der(v) = f - 100*s - 2*v;
end Oscillator;
"""
STEP = 1e-3


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cross-check")
    (folder / "Oscillator.mo").write_text(MODEL)
    named = ["--model", str(folder / "Oscillator.mo"), "--class", "Oscillator", "--stop", "2"]
    assert main([str(folder), *named]) == 0
    return folder


@pytest.fixture(params=TYPES)
def folder(request: pytest.FixtureRequest, out: Path) -> Path:
    (found,) = out.glob(f"fmus/2.0/{request.param}/*/PneuGantry/*/Oscillator")
    return found


def test_the_folder_holds_what_the_rules_ask_for(folder: Path) -> None:
    ends = (".fmu", "_ref.csv", "_ref.opt", "_in.csv")
    assert {p.name for p in folder.iterdir()} == {*(f"Oscillator{e}" for e in ends), "README.md"}
    assert validate_test_fmu(str(folder)) == []
    first = (folder / "Oscillator_ref.csv").read_text().splitlines()[0]
    assert first == '"time","y"'


def test_an_importer_finds_the_reference(folder: Path) -> None:
    problems, off = checked(folder, STEP)
    assert problems == []
    assert off < (1e-6 if "cs" in folder.parts else 1e-3)  # our solver, CVode


def test_the_reference_obeys_the_oscillators_equation(folder: Path) -> None:
    """s'' + 2 s' + 100 s = f by differences of the table, with the inputs of the other table."""
    solution, inputs = (read_csv(folder / f"Oscillator_{kind}.csv") for kind in ("ref", "in"))
    assert solution is not None
    assert inputs is not None
    t, s = solution["time"], solution["y"]
    speed = np.gradient(s, t)
    left = np.gradient(speed, t) + 2 * speed + 100 * s
    f = np.interp(t, inputs["time"], inputs["f"])
    assert np.abs(inputs["f"]).max() > 0.5
    assert left[5:-5] == pytest.approx(f[5:-5], abs=0.05)


def test_a_wrong_reference_is_found(folder: Path, tmp_path: Path) -> None:
    copy = tmp_path.joinpath(*folder.parts[-7:])
    copy.mkdir(parents=True)
    for file in folder.iterdir():
        (copy / file.name).write_bytes(file.read_bytes())
    table = copy / "Oscillator_ref.csv"
    head, *rows = table.read_text().splitlines()
    bent = [f"{row.split(',')[0]},{-float(row.split(',')[1])}" for row in rows]
    table.write_text("\n".join([head, *bent]) + "\n")
    problems, off = checked(copy, STEP)
    assert "epsilon band" in problems[0]
    assert off > 0.5
    table.write_text("\n".join(['"time","speed"', *rows]) + "\n")
    assert "does not exist" in validate_test_fmu(str(copy))[0]


def test_a_class_that_is_not_there_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "Oscillator.mo").write_text(MODEL)
    named = ["--model", str(tmp_path / "Oscillator.mo"), "--class", "Pendulum"]
    assert main([str(tmp_path / "out"), *named]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
