"""A recorder's own log: its columns, units, decimal mark and rate; MATLAB files;
swapped commands.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from modelica_fmu.errors import InputError
from pneugantry.cli import main
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import MEASURED, REQUIRED, Log, read_log
from pyfmi_runner.log_import import UNITS, import_from
from pyfmi_runner.log_template import guessed_columns, template
from pyfmi_runner.resample import even_stamps, is_regular, resampled
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario
from pyfmi_runner.suspicions import log_warnings

PHASES = {"approach": (0.0, 1.0), "contact": (1.0, 2.0), "contour": (2.0, 3.0)}
NAMES = {
    "time": "t [ms]",
    "u_x": "Ventil X (V)",
    "u_z": "Ventil Z (V)",
    "x": "PosX_mm",
    "z": "PosZ_mm",
    "v_x": "SpeedX_mm/s",
    "v_z": "SpeedZ_mm/s",
    "f_x": "LoadcellX [N]",
    "f_z": "LoadcellZ [kN]",
    "f_ax": "ActuatorX [N]",
    "f_az": "ActuatorZ [N]",
}
THOUSANDTH = ("time", "x", "z", "v_x", "v_z")


@pytest.fixture(scope="module")
def log() -> Log:
    scenario = Scenario(workpiece="straight", start_z=0.038, phases=PHASES, seed=1)
    return run_scenario(scenario, FmuFile.read(build_fmu().path)).log


def foreign(log: Log, every: int = 1) -> pd.DataFrame:
    """The log as another recorder writes it."""
    table = log.table[list(NAMES)].iloc[::every].copy()
    for name in THOUSANDTH:
        table[name] *= 1e3
    table["f_z"] *= 1e-3
    return table.rename(columns=NAMES)


def replace_in(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


def test_init_makes_a_foreign_log_readable(
    log: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rig.csv"
    foreign(log).to_csv(path, sep=";", decimal=",", index=False)
    with pytest.raises(InputError, match=r"column is missing; .*`pneugantry log init rig\.csv`"):
        read_campaign(path)
    assert main(["log", "init", str(path)]) == 0
    assert main(["log", "init", str(path)]) == 2  # nothing is replaced unasked
    assert "is there already; edit it, or give --force" in capsys.readouterr().err
    replace_in(path.with_suffix(".toml"), 'workpiece = "?"', 'workpiece = "straight"')
    campaign = read_campaign(path)
    read = next(iter(campaign)).log
    for name in REQUIRED:
        np.testing.assert_allclose(read[name], log[name], atol=1e-9)
    assert any("columns read as time = 't [ms]' [ms]" in note for note in campaign.notes)
    assert main(["log", "convert", str(path), "--out", str(tmp_path / "si.parquet")]) == 0
    np.testing.assert_allclose(read_log(tmp_path / "si.parquet")["z"], log["z"], atol=1e-9)


def test_every_column_of_a_foreign_log_is_guessed_with_its_unit(log: Log) -> None:
    found = guessed_columns(foreign(log))
    assert {name: guess.column for name, guess in found.items()} == NAMES
    assert found["f_z"].unit == "kN"
    bare = foreign(log).rename(columns={"PosZ_mm": "zpos", "t [ms]": "t"})
    assert guessed_columns(bare)["z"].unit == "mm"  # by its values
    assert guessed_columns(bare)["time"].unit == "ms"


def test_what_is_not_found_is_left_for_the_user_and_refused_by_name(
    log: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rig.csv"
    foreign(log).rename(columns={"Ventil X (V)": "Kanal 7"}).to_csv(path, index=False)
    assert main(["log", "init", str(path), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["missing"] == ["u_x"]
    assert main(["log", "check", str(path)]) == 2
    err = capsys.readouterr().err
    assert "rig.toml: import.u_x.column: is not filled in yet; name the column of rig.csv" in err
    replace_in(path.with_suffix(".toml"), 'column = "?"', 'column = "Kanal 7"')
    assert main(["log", "check", str(path)]) == 2
    err = capsys.readouterr().err
    assert "rig.toml: workpiece: is not filled in yet; say how the log was taken" in err
    replace_in(path.with_suffix(".toml"), '"?"', '"straight"')
    assert main(["log", "check", str(path)]) == 0


def test_init_sees_a_controller_and_a_workpiece_in_the_log(log: Log) -> None:
    closed = template(Path("rig.csv"), foreign(log))
    assert 'loop = "closed"' in closed
    assert 'workpiece = "?"' in closed
    ramps = foreign(log).assign(**{n: 0.0 for n in NAMES.values() if n.startswith("Loadcell")})
    ramps = ramps.assign(**{NAMES["u_x"]: 0.0, NAMES["u_z"]: np.arange(len(log)) * 1e-4})
    opened = template(Path("rig.csv"), ramps)
    assert 'loop = "open"' in opened
    assert 'workpiece = "none"' in opened


def test_a_force_without_a_workpiece_is_noted(log: Log, tmp_path: Path) -> None:
    path = tmp_path / "rig.csv"
    foreign(log).to_csv(path, index=False)
    main(["log", "init", str(path)])
    replace_in(path.with_suffix(".toml"), '"?"', '"none"')
    assert any("rig feels a contact force in f_z" in n for n in read_campaign(path).notes)
    replace_in(path.with_suffix(".toml"), '"none"', '"straight"')
    assert not any("contact force" in n for n in read_campaign(path).notes)


def test_a_slower_log_is_resampled_and_it_is_said(log: Log, tmp_path: Path) -> None:
    path = tmp_path / "rig.csv"
    foreign(log, every=2).to_csv(path, index=False)
    main(["log", "init", str(path)])
    replace_in(path.with_suffix(".toml"), 'workpiece = "?"', 'workpiece = "straight"')
    campaign = read_campaign(path)
    read = next(iter(campaign)).log
    assert any("recorded at 500 Hz: resampled to 1 kHz" in note for note in campaign.notes)
    for name in MEASURED:  # every second row is a measured one, the others lie between
        np.testing.assert_allclose(read[name][::2], log[name][::2][: len(read[name][::2])])
    np.testing.assert_array_equal(read["u_z"][1::2], read["u_z"][:-1:2])  # held


def test_uneven_stamps_and_faster_logs() -> None:
    rng = np.random.default_rng(0)
    time = np.sort(rng.uniform(0.0, 2.0, 1500))
    columns, said = resampled({"time": time, "x": 0.3 * time, "u_x": np.floor(time)})
    assert is_regular(columns["time"])
    np.testing.assert_allclose(columns["x"], 0.3 * columns["time"], atol=1e-9)
    assert set(np.unique(columns["u_x"])) <= {0.0, 1.0}
    assert "stamps uneven" in said
    fast = even_stamps(20_000, 10_000.0)
    noise = rng.standard_normal(len(fast))
    columns, said = resampled({"time": fast, "x": noise})
    assert len(columns["time"]) == 2000
    assert float(np.std(columns["x"])) == pytest.approx(10**-0.5, rel=0.1)
    assert "averaged over each millisecond" in said


def test_a_command_that_changes_within_a_row_acts_for_the_rest_of_it() -> None:
    """Between rows its integral is that of what was commanded, neither late nor early."""
    rng = np.random.default_rng(1)
    time = np.append(0.0, np.sort(rng.uniform(0.0, 2.0, 1400)))
    stamps = {"time": time, "x": 0.0 * time}
    command, switch = np.round(5 * np.sin(9 * time), 1), (time > 1.0).astype(float)
    columns, said = resampled({**stamps, "u_x": command, "u_z": switch, "phase": 2 * switch})
    steps = np.diff(time, append=columns["time"][-1] + 1e-3)
    assert columns["u_x"].sum() * 1e-3 == pytest.approx(command @ steps, abs=1e-9)
    own = np.searchsorted(time, columns["time"] + 1e-9, side="right") - 1
    unchanged = own[:-1] == own[1:]
    np.testing.assert_array_equal(columns["u_x"][:-1][unchanged], command[own[:-1]][unchanged])
    assert set(np.unique(columns["u_z"])) == {0.0, 1.0}
    assert set(np.unique(columns["phase"])) == {0.0, 2.0}
    assert "changes within a row" in said


@pytest.mark.parametrize(
    ("time", "words"),
    [
        ([0.0, 0.002, 0.004, 0.5, 0.502], "follows a gap of 496 ms"),
        ([0.0, 0.002, 0.002, 0.004], "does not increase"),
    ],
)
def test_stamps_that_cannot_be_resampled_are_refused(time: list[float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        resampled({"time": np.array(time), "x": np.zeros(len(time))})


def test_a_matlab_file_s_columns_structures_and_matrices(log: Log, tmp_path: Path) -> None:
    table = foreign(log)
    plain = {name: table[column].to_numpy() for name, column in NAMES.items()}
    path = tmp_path / "rig.mat"
    savemat(path, {"d": plain, "note": "text", "few": np.zeros(3)})
    units = {"time": "ms", "x": "mm", "z": "mm", "v_x": "mm/s", "v_z": "mm/s", "f_z": "kN"}
    lines = [
        f'{name} = {{ column = "d.{name}", unit = "{unit}" }}'
        for name in NAMES
        for unit in [units.get(name, "V" if name[0] == "u" else "N")]
    ]
    path.with_suffix(".toml").write_text("[import]\n" + "\n".join(lines), encoding="utf-8")
    read = next(iter(read_campaign(path))).log
    np.testing.assert_allclose(read["f_z"], log["f_z"], atol=1e-9)
    savemat(path, {"m": table.to_numpy()})
    numbered = {name: f"m_{k + 1}" for k, name in enumerate(NAMES)}
    lines = [
        line.replace(f"d.{name}", numbered[name]) for name, line in zip(NAMES, lines, strict=True)
    ]
    path.with_suffix(".toml").write_text("[import]\n" + "\n".join(lines), encoding="utf-8")
    np.testing.assert_allclose(next(iter(read_campaign(path))).log["x"], log["x"], atol=1e-9)


def test_a_campaign_shares_an_import(log: Log, tmp_path: Path) -> None:
    for name in ("a", "b"):
        foreign(log).to_csv(tmp_path / f"{name}.csv", index=False)
    main(["log", "init", str(tmp_path / "a.csv")])
    text = (tmp_path / "a.toml").read_text(encoding="utf-8")
    shared = text[text.index("[import]") :]
    (tmp_path / "a.toml").unlink()
    (tmp_path / "campaign.toml").write_text(
        f"{shared}\n[log.a]\n[log.b]\n[log.b.import]\nz = {{ column = 'PosZ_mm', unit = 'cm' }}\n",
        encoding="utf-8",
    )
    with pytest.raises(InputError, match="z"):  # ten times too far
        read_campaign(tmp_path)
    (tmp_path / "campaign.toml").write_text(f"{shared}\n[log.a]\n[log.b]\n", encoding="utf-8")
    for run in read_campaign(tmp_path):
        np.testing.assert_allclose(run.log["z"], log["z"], atol=1e-9)


BAD = {
    "unknown column": ({"q": "a"}, "import.q: unknown key"),
    "unknown unit": ({"z": {"column": "a", "unit": "inch"}}, "no unit of z; use m, mm"),
    "rate and time": ({"rate": 500.0, "time": "t"}, "is given beside time"),
    "no number": ({"rate": "fast"}, "expected a number"),
}


@pytest.mark.parametrize("case", BAD)
def test_an_import_that_cannot_be_used_is_refused_by_key(case: str) -> None:
    table, words = BAD[case]
    with pytest.raises(InputError) as caught:
        import_from(table, "rig.toml")
    assert words in str(caught.value)
    assert str(caught.value).startswith("rig.toml: ")


def test_units_are_those_of_the_columns() -> None:
    assert UNITS["rad"]["deg"] * 180 == pytest.approx(np.pi)
    assert all(table[si] == 1.0 for si, table in UNITS.items())


SWAPS: dict[str, Callable[[pd.DataFrame], pd.DataFrame]] = {
    "commands": lambda t: t.rename(columns={"u_x": "u_z", "u_z": "u_x"}),
    "none": lambda t: t,
}


@pytest.mark.parametrize("case", SWAPS)
def test_swapped_commands_are_noticed(case: str, log: Log) -> None:
    said = [text for text in log_warnings(Log(SWAPS[case](log.table))) if "u_x and u_z" in text]
    assert bool(said) == (case == "commands")
