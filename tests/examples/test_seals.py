"""The seals: raw files read onto an even grid, levels by least squares, logs that a plant reads."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from examples.seals.__main__ import RAW, main
from examples.seals.convert import (
    AREA,
    PERIOD,
    PLANT,
    PRESSURES,
    SEALS,
    levels,
    pressure_fit,
    read_raw,
    write_seal,
)
from modelica_fmu.errors import InputError
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile, FmuSession

recorded = pytest.mark.skipif(not RAW.is_dir(), reason="../shared/real is not on this machine")
LEVEL, GROWTH = 3.0, 0.25  # N at 1 bar, per bar


def write_raw(folder: Path, seal: str = "O-ring") -> None:
    """Strokes of 8 mm/s against four pressures, stamped unevenly, friction known."""
    rng = np.random.default_rng(3)
    for bar in PRESSURES:
        time = np.cumsum(rng.uniform(0.009, 0.012, 2500))
        phase = (time / 10.0) % 1.0
        position = 36.0 * np.where(phase < 0.5, 2 * phase, 2 - 2 * phase)
        sense = np.where(phase < 0.5, 1.0, -1.0)
        force = bar * 1e5 * AREA + LEVEL * (1 + GROWTH * (bar - 1)) * sense
        columns = [
            1e3 * time,
            0 * time,
            0 * time,
            0 * time,
            position,
            bar + 0.002 * rng.standard_normal(len(time)),
            force + 0.05 * rng.standard_normal(len(time)),
        ]
        np.savetxt(folder / f"friction__{seal}_{bar}bar.csv", np.column_stack(columns), "%.3f")


def test_levels_and_growth_are_found_again(tmp_path: Path) -> None:
    write_raw(tmp_path)
    logs = {bar: read_raw(tmp_path, "O-ring", bar) for bar in PRESSURES}
    assert np.diff(logs[1]["time"]) == pytest.approx(PERIOD, abs=1e-6)
    assert levels(logs[1]).median == pytest.approx(LEVEL, rel=0.03)
    assert levels(logs[7]).median == pytest.approx(LEVEL * (1 + 6 * GROWTH), rel=0.03)
    fit = pressure_fit(logs)
    assert fit["F_c"] == pytest.approx(LEVEL, rel=0.05)
    assert fit["growth_per_bar"] == pytest.approx(GROWTH, rel=0.05)
    assert fit["growing"] < 0.3 * fit["constant"]


def test_the_model_gives_the_force_of_a_moving_rod(tmp_path: Path) -> None:
    built = build_fmu("Seals.Plant", PLANT.parent / "Seals.mo", out=tmp_path)
    growth = 3e-6
    parameters = {"seal.F_c": LEVEL, "seal.growth": growth}
    with FmuSession(FmuFile.read(built.path), parameters=parameters) as session:
        for speed, sense in ((8e-3, 1.0), (-8e-3, -1.0)):
            session.set({"v": speed, "p": 5e5})
            for _ in range(50):
                session.step(PERIOD)
            want = 4.9087385e-4 * 5e5 + sense * LEVEL * (1 + growth * 4e5)
            assert session.get("F") == pytest.approx(want, abs=1e-3)


def test_a_seal_is_written_with_a_description_that_finds_its_model(tmp_path: Path) -> None:
    write_raw(tmp_path)
    path = write_seal(tmp_path, tmp_path / "out", "O-ring")
    described = tomllib.loads(path.read_text())
    assert {name: log["use"] for name, log in described["log"].items()} == {
        "1bar": "fit",
        "3bar": "held out",
        "5bar": "fit",
        "7bar": "held out",
    }
    assert (path.parent / described["plant"]["model"]).is_file()
    assert described["parameters"]["seal.F_c"] == pytest.approx(LEVEL, rel=0.03)


def test_bad_input_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InputError, match="no such log"):
        read_raw(tmp_path, "O-ring", 1)
    (tmp_path / "friction__KDN_1bar.csv").write_text("1 2 3\n" * 40)
    with pytest.raises(InputError, match="seven columns"):
        read_raw(tmp_path, "KDN", 1)
    assert main(["convert", "--raw", str(tmp_path), "--out", str(tmp_path), "--seal", "NBR"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@recorded
def test_friction_grows_with_pressure_and_differs_between_seals() -> None:
    found = {
        seal: {bar: levels(read_raw(RAW, seal, bar)).median for bar in (1, 7)} for seal in SEALS
    }
    for seal in ("O-ring", "NAPN", "NAP310"):
        assert found[seal][7] > 1.8 * found[seal][1]
    assert found["KDN"][7] < 1.3 * found["KDN"][1]
    assert found["O-ring"][1] > 1.5 * found["NAP310"][1]
