"""One FMU, the same trajectory in every tool; `python -m benchmarks.importers` prints the table."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.importers import IMPORTERS, Importer, binaries, commands, compared, main, ours
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile

TOLERANCE = {
    "fmpy, CVode": 0.02,
    "CasADi": 1e-4,
}  # sensor sigma: other solvers than ours; the rest step the FMU's own


@pytest.fixture(scope="module")
def file() -> FmuFile:
    return FmuFile.read(build_fmu().path)


@pytest.mark.parametrize("importer", IMPORTERS, ids=lambda importer: importer.name)
def test_it_gives_our_trajectory(file: FmuFile, importer: Importer) -> None:
    (row,) = compared(file, commands(1000), (importer,))
    if row["error"] is None:
        pytest.skip(f"{importer.package} is not installed")
    assert row["steps"] == 1000 or (importer.name == "CasADi" and row["steps"] > 20)
    assert row["error"] <= TOLERANCE.get(importer.name, 1e-6), row


def test_the_commands_move_both_axes(file: FmuFile) -> None:
    rows = ours(file, commands(1000))
    assert (np.abs(rows[:, 2:4]).max(axis=0) > 0.05).all()


def test_the_command_prints_and_writes_both_tables(
    file: FmuFile, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--fmu", str(file.path), "--json", str(tmp_path / "found.json")]) == 0
    said = capsys.readouterr().out
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert [row["importer"] for row in found["importers"]] == [
        importer.name for importer in IMPORTERS
    ]
    assert found["binaries"] == binaries(file.path)
    for name in (*found["binaries"], "libcosim", "CasADi"):
        assert name in said
