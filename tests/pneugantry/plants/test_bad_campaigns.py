"""Records with faults: each is named and left out, and what is left is diagnosed; a fault never
becomes a cause.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from modelica_fmu.errors import InputError
from pneugantry.engine.answer.result import to_json
from pneugantry.engine.rules import Rules
from pneugantry.plants.gantry.diagnosis import diagnose, task_of
from pneugantry.plants.gantry.usable import sound_logs
from pneugantry.truth.campaign import Campaign, write
from pneugantry.truth.case import draw_case
from pyfmi_runner.campaign import DRIVEN, read_campaign
from pyfmi_runner.log import MEASURED

Fault = Callable[[pd.DataFrame], pd.DataFrame]


@pytest.fixture(scope="module")
def drawn() -> Campaign:
    return draw_case(1021, kind="none")[0]  # a development seed


def with_fault(drawn: Campaign, folder: Path, **faults: Fault) -> Path:
    write(
        folder,
        {
            name: faults[name](table.copy()) if name in faults else table
            for name, table in drawn.items()
        },
    )
    return folder


def swapped(table: pd.DataFrame) -> pd.DataFrame:
    return table.rename(columns={"f_ax": "f_az", "f_az": "f_ax", "v_x": "v_z", "v_z": "v_x"})


def stuck(table: pd.DataFrame) -> pd.DataFrame:
    table.loc[3000:9000, "v_z"] = table["v_z"][3000]
    return table


def clipped(table: pd.DataFrame) -> pd.DataFrame:
    table["f_z"] = table["f_z"].clip(upper=18.0)
    return table


def half_rate(table: pd.DataFrame) -> pd.DataFrame:
    return table.iloc[::2].reset_index(drop=True)


def gap_in_time(table: pd.DataFrame) -> pd.DataFrame:
    return table.drop(index=range(4000, 4300)).reset_index(drop=True)


@pytest.mark.parametrize(
    ("log", "fault", "word"),
    [
        ("contour_curved", swapped, "swapped"),
        ("free_motion", stuck, "stuck"),
        ("contact_steps", clipped, "clipped"),
        ("free_motion", half_rate, "time"),
        ("contour_curved", gap_in_time, "time"),
    ],
)
def test_a_log_with_a_fault_is_left_out_and_named(
    drawn: Campaign, tmp_path: Path, log: str, fault: Fault, word: str
) -> None:
    campaign = read_campaign(with_fault(drawn, tmp_path, **{log: fault}), strict=False)
    sound, left_out = sound_logs(campaign)
    (said,) = [text for text in [*campaign.notes, *left_out] if "left out" in text]
    assert said.startswith(log)
    assert word in said
    assert log not in sound.logs
    assert len(sound.logs) == len(drawn) - 1


def test_a_sound_campaign_loses_nothing(drawn: Campaign, tmp_path: Path) -> None:
    campaign = read_campaign(with_fault(drawn, tmp_path))
    sound, left_out = sound_logs(campaign)
    assert list(sound.logs) == list(campaign.logs)
    assert left_out == []


def test_a_campaign_whose_every_log_has_a_fault_is_refused(drawn: Campaign, tmp_path: Path) -> None:
    campaign = read_campaign(
        with_fault(drawn, tmp_path, **dict.fromkeys(drawn, swapped)), strict=False
    )
    with pytest.raises(InputError, match="no log can be diagnosed"):
        sound_logs(campaign)


def test_a_log_that_no_view_judges_is_left_out(drawn: Campaign, tmp_path: Path) -> None:
    """The held-out log measures x alone: another one is held out in its place."""
    few = {n: drawn[n] for n in ("valve_steps_0", "valve_steps_500", "contour_straight")}
    gone = [c for c in MEASURED if c != "x"]
    few["contour_straight"] = few["contour_straight"].drop(columns=gone)
    write(tmp_path, few)
    task = task_of(read_campaign(tmp_path, strict=False, needs=DRIVEN), {}, Rules())
    assert [r.name for r in task.data.fitted] == ["valve_steps_0"]
    assert task.data.held_out is not None
    assert task.data.held_out.name == "valve_steps_500"
    assert any(n.startswith("contour_straight left out: nothing in it can") for n in task.notes)
    write(tmp_path / "still", {"valve_steps_0": few["valve_steps_0"].drop(columns=gone)})
    with pytest.raises(InputError, match="nothing in its logs can be judged"):
        task_of(read_campaign(tmp_path / "still", strict=False, needs=DRIVEN), {}, Rules())


@pytest.mark.slow
def test_what_is_left_of_a_bad_campaign_names_no_wrong_cause(
    drawn: Campaign, tmp_path: Path
) -> None:
    folder = with_fault(drawn, tmp_path, contour_curved=swapped, free_motion=stuck)
    (folder / "valve_steps_500.parquet").unlink(missing_ok=True)
    (folder / "valve_steps_500.csv").unlink(missing_ok=True)
    result = to_json(diagnose(read_campaign(folder, strict=False)).diagnosis)
    assert result["verdict"] == "none"
    assert {note.split()[0] for note in result["notes"] if "left out" in note} == {
        "valve_steps_500",
        "contour_curved",
        "free_motion",
    }
    assert any(
        "towards" in note or "does not move" in note for note in result["notes"]
    )  # what the rest cannot show
