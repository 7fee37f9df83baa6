"""Logs: what is written comes back, what is wrong is refused in one line, what is suspicious is
said.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from modelica_fmu.errors import InputError
from pyfmi_runner import log as log_module
from pyfmi_runner.log import (
    MEASURED,
    REQUIRED,
    SIGMA,
    Log,
    check_table,
    read_log,
    write_log,
)
from pyfmi_runner.suspicions import log_warnings

CAMPAIGNS = Path(__file__).resolve().parents[3] / "shared" / "campaigns"


def sound_log(rows: int = 3000, seed: int = 1) -> Log:
    """Both axes move, z presses with 30 N in the second half; noise of the rig."""
    time = np.arange(rows) * 1e-3
    table = pd.DataFrame({name: np.zeros(rows) for name in REQUIRED})
    table["time"], table["u_x"], table["u_z"] = time, 0.8, 1.0
    table["x"], table["v_x"] = 0.5 + 0.2 * np.cos(time), -0.2 * np.sin(time)
    table["z"], table["v_z"] = 0.05 - 0.04 * np.cos(2 * time), 0.08 * np.sin(2 * time)
    table["f_z"] = np.where(time > time[-1] / 2, 30.0, 0.0)
    table["f_ax"], table["f_az"] = (
        -30.0 * (1 - np.exp(-time / 0.3)),
        40.0 * (1 - np.exp(-time / 0.15)),
    )
    noise = np.random.default_rng(seed).standard_normal((rows, 8))
    for k, name in enumerate(MEASURED):
        table[name] += SIGMA[name] * noise[:, k]
    return Log(table, "sound", {"rig": "bench"})


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
@settings(
    max_examples=15,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    st.lists(st.floats(0.0, 5.0), min_size=10, max_size=30),
    st.dictionaries(
        st.text(st.characters(codec="utf-8"), min_size=1, max_size=12).filter(
            lambda key: key != "units"
        ),
        st.recursive(
            st.none() | st.booleans() | st.integers() | st.text(max_size=8), st.lists, max_leaves=4
        ),
        max_size=3,
    ),
)
def test_a_log_survives_the_round_trip_bit_for_bit(
    tmp_path: Path, suffix: str, commands: list[float], provenance: dict[str, object]
) -> None:
    table = sound_log(len(commands)).table.assign(u_z=commands, phase=1.0)
    path = write_log(Log(table, "trip", provenance), tmp_path / f"trip{suffix}")
    back = read_log(path)
    pd.testing.assert_frame_equal(back.table, table, check_exact=True)
    assert back.name == "trip"
    assert back.provenance == provenance


def test_unknown_columns_are_kept_and_phase_names_become_codes() -> None:
    table = sound_log().table.assign(operator="Ann", phase="contour")
    checked = check_table(table)
    assert (checked["operator"] == "Ann").all()
    assert (checked["phase"] == 2.0).all()


def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_log(sound_log(), tmp_path / "a.parquet")
    before = path.read_bytes()

    def broken(log: Log, temporary: Path) -> None:
        temporary.write_bytes(before[:100])
        raise KeyboardInterrupt

    monkeypatch.setattr(log_module, "_write_parquet", broken)
    with pytest.raises(KeyboardInterrupt):
        write_log(sound_log(seed=2), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.parquet"]


def put(column: str, row: int, value: float) -> Callable[[pd.DataFrame], pd.DataFrame]:
    def change(table: pd.DataFrame) -> pd.DataFrame:
        table.loc[row, column] = value
        return table

    return change


def scaled(column: str, by: float) -> Callable[[pd.DataFrame], pd.DataFrame]:
    return lambda table: table.assign(**{column: table[column] * by})


REFUSED: dict[str, tuple[Callable[[pd.DataFrame], pd.DataFrame], list[str]]] = {
    "missing": (lambda t: t.drop(columns="f_az"), ["f_az", "missing"]),
    "misnamed": (lambda t: t.rename(columns={"v_z": "vz"}), ['rename column "vz" to "v_z"']),
    "nan": (put("f_z", 17, np.nan), ["f_z", "row 17"]),
    "inf": (put("x", 5, np.inf), ["x", "row 5", "infinite"]),
    "text": (lambda t: t.astype({"z": object}).pipe(put("z", 4, "oops")), ["z", "row 4", "oops"]),  # type: ignore[arg-type]
    "decimal comma": (lambda t: t.assign(z="0,05"), ["z", "decimal point"]),
    "half rate": (lambda t: t.iloc[::2], ["time", "500 Hz"]),
    "double rate": (scaled("time", 0.5), ["time", "2000 Hz", "every 2"]),
    "milliseconds": (scaled("time", 1e3), ["time", "divide column time by 1000"]),
    "gap": (lambda t: t.drop(index=range(100, 150)), ["time", "row 100", "gap", "51 ms"]),
    "repeated row": (
        lambda t: t.iloc[[*range(50), *range(49, 3000)]],
        ["time", "row 50", "increase"],
    ),
    "z in mm": (scaled("z", 1e3), ["z", "divide column z by 1000"]),
    "x in mm": (scaled("x", 1e3), ["x", "divide column x by 1000"]),
    "v_x in mm/s": (scaled("v_x", 1e3), ["v_x", "divide column v_x by 1000"]),
    "resting v_z in mm/s": (
        lambda t: t.assign(v_z=0.5 * np.random.default_rng(3).standard_normal(len(t))),
        ["v_z", "divide column v_z by 1000"],
    ),
    "u in mV": (scaled("u_z", 1e3), ["u_z", "divide column u_z by 1000"]),
    "negative u": (lambda t: t.assign(u_x=-2.0), ["u_x", "0..5"]),
    "x and z swapped": (lambda t: t.rename(columns={"x": "z", "z": "x"}), ["swap columns x and z"]),
    "too short": (lambda t: t.iloc[:3], ["3 rows"]),
    "column twice": (lambda t: pd.concat([t, t[["z"]]], axis=1), ["z", "twice"]),
    "beyond a float": (
        lambda t: t.astype({"z": object}).pipe(put("z", 4, 10**400)),
        ["z", "row 4", "infinite"],
    ),
    "lists": (lambda t: t.assign(phase=[[1.0]] * len(t)), ["phase", "row 0", "not a number"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_unusable_tables_are_refused_naming_file_column_and_mend(case: str) -> None:
    change, words = REFUSED[case]
    with pytest.raises(InputError) as caught:
        check_table(change(sound_log().table.copy()), "rig.csv")
    text = str(caught.value)
    assert text.startswith("rig.csv: ")
    assert "\n" not in text
    assert "; " in text
    for word in words:
        assert word in text


def test_an_axis_that_swings_is_no_noise() -> None:
    """A valve that oscillates: 3 m/s at 6 Hz."""
    table = sound_log().table.copy()
    swing = 2 * np.pi * 6 * table["time"]
    table["x"] += 0.08 * (1 - np.cos(swing))
    table["v_x"] += 0.08 * 2 * np.pi * 6 * np.sin(swing)
    check_table(table, "rig.csv")
    with pytest.raises(InputError, match="v_x"):
        check_table(table.assign(v_x=1e3 * table["v_x"]), "rig.csv")
    still = table.assign(x=0.5, v_x=0.5 * np.random.default_rng(3).standard_normal(len(table)))
    with pytest.raises(InputError, match="looks like mm/s"):
        check_table(still, "rig.csv")


def test_unreadable_files_are_refused_in_one_line(tmp_path: Path) -> None:
    whole = write_log(sound_log(), tmp_path / "whole.parquet").read_bytes()
    text = write_log(sound_log(), tmp_path / "whole.csv").read_text()
    files = {
        "empty.parquet": (b"", "empty"),
        "cut.parquet": (whole[: len(whole) // 2], "Parquet"),
        "text.parquet": (b"time,x\n", "Parquet"),
        "empty.csv": (b"# only: 1\n", "no header"),
        "cut.csv": (text[:-30].encode(), "cut short"),
        "latin.csv": ("# gerät: 1\n".encode("latin-1"), "UTF-8"),
        "decimal.csv": (text.replace(".", ",").encode(), "decimal point"),
        "log.xlsx": (b"PK", "unknown kind"),
    }
    for name, (content, word) in files.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=word) as caught:
            read_log(tmp_path / name)
        assert name in str(caught.value)
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r"did you mean whole\.parquet"):
        read_log(tmp_path / "whol.parquet")
    for name in ("a\0.csv", "a" * 300 + ".csv"):
        with pytest.raises(InputError, match="cannot be read"):
            read_log(tmp_path / name)
    (tmp_path / "more.csv").write_text(
        ",".join(REQUIRED) + "\n" + f'{"0," * len(REQUIRED)}"a",1\n' * 20
    )
    with pytest.raises(InputError, match="not a readable table"):
        read_log(tmp_path / "more.csv")
    with pytest.raises(InputError, match="is a folder"):
        read_log(tmp_path)
    with pytest.raises(InputError, match="end it in"):
        write_log(sound_log(), tmp_path / "log.xlsx")


def test_semicolons_and_tabs_separate_too(tmp_path: Path) -> None:
    text = write_log(sound_log(), tmp_path / "a.csv").read_text()
    for mark in ";\t":
        (tmp_path / "b.csv").write_text(
            "".join(line.replace(",", mark) for line in text.splitlines(True)[2:])
        )
        pd.testing.assert_frame_equal(read_log(tmp_path / "b.csv").table, sound_log().table)


SUSPICIOUS: dict[str, tuple[Callable[[pd.DataFrame], pd.DataFrame], str]] = {
    "stuck": (lambda t: t.assign(f_ax=t.f_ax.where(t.time < 2, t.f_ax[2000])), "f_ax holds"),
    "dead": (lambda t: t.assign(f_x=0.0), "f_x reads 0 N throughout"),
    "clipped": (lambda t: t.assign(f_z=t.f_z.clip(upper=25.0)), "f_z looks clipped at 25"),
    "forces swapped": (
        lambda t: t.rename(columns={"f_x": "f_z", "f_z": "f_x"}),
        "f_x and f_z swapped",
    ),
    "force reversed": (lambda t: t.assign(f_z=-t.f_z), "f_z is negative"),
    "actuators swapped": (
        lambda t: t.rename(columns={"f_ax": "f_az", "f_az": "f_ax"}),
        "f_ax and f_az swapped",
    ),
    "actuator reversed": (lambda t: t.assign(f_ax=-t.f_ax), "f_ax is positive"),
    "speeds swapped": (
        lambda t: t.rename(columns={"v_x": "v_z", "v_z": "v_x"}),
        "v_x and v_z swapped",
    ),
    "speed reversed": (lambda t: t.assign(v_x=-t.v_x), "v_x runs against"),
    "speed scaled": (lambda t: t.assign(v_z=2 * t.v_z), "v_z is 2 times"),
    "speed offset": (lambda t: t.assign(v_x=t.v_x + 0.03), "v_x reads +0.03"),
    "force offset": (lambda t: t.assign(f_x=t.f_x + 1.0), "f_x starts at"),
    "position offset": (lambda t: t.assign(z=t.z - 0.015), "z spans"),
    "cut start": (
        lambda t: t.iloc[1000:].assign(time=t.time[:2000].to_numpy()).reset_index(drop=True),
        "at rest",
    ),
}


@pytest.mark.parametrize("case", SUSPICIOUS)
def test_suspicious_logs_are_warned_of(case: str) -> None:
    change, words = SUSPICIOUS[case]
    assert any(words in text for text in log_warnings(Log(change(sound_log().table))))


def test_an_offset_without_contact_is_no_reversed_sign() -> None:
    table = sound_log().table
    noise = table["f_z"] - table["f_z"].round(0)  # what is left of it without the contact
    said = log_warnings(Log(table.assign(f_z=noise - 2.7)))
    assert any("f_z starts at -2.7 N" in text for text in said)
    assert not any("reversed" in text for text in said)


def test_a_sound_log_gives_no_warning() -> None:
    assert log_warnings(sound_log()) == []


@pytest.mark.skipif(not CAMPAIGNS.is_dir(), reason=f"{CAMPAIGNS} is absent")
@pytest.mark.parametrize("path", sorted(CAMPAIGNS.glob("nominal/*.parquet")), ids=lambda p: p.stem)
def test_the_nominal_campaign_reads_without_warning(path: Path) -> None:
    assert log_warnings(read_log(path)) == []
