"""Campaigns: folders and single logs, round trip, clamps, refusals, and leaving out what cannot be
used.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from modelica_fmu.errors import InputError
from pyfmi_runner.campaign import (
    Campaign,
    LoggedRun,
    LogSetup,
    read_campaign,
    scenario_setup,
    setup_from,
    setup_table,
)
from pyfmi_runner.campaign import write_campaign as write
from pyfmi_runner.log import REQUIRED, Log, write_log
from pyfmi_runner.scenario import Scenario

CAMPAIGNS = Path(__file__).resolve().parents[3] / "shared" / "campaigns"
CONTOUR = LogSetup(
    loop="closed",
    clamped=("x until contour",),
    workpiece="curved",
    standoff=0.09,
    phases={"approach": (0.0, 0.1), "contact": (0.1, 0.3), "contour": (0.3, 0.5)},
    approach_command=(0.0, 1.05),
    f_nd=30.0,
    v_td=-0.06,
    controller="pi_fv",
    gains={"Kp_vx": 1.0},
)


def resting_log(rows: int = 500, x: float = 0.95, z: float = 0.0) -> Log:
    table = pd.DataFrame({name: np.zeros(rows) for name in REQUIRED})
    return Log(table.assign(time=np.arange(rows) * 1e-3, x=x, z=z))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rest = LogSetup(clamped=("x", "z"), start_x=0.5, start_z=0.05)
    logs = {
        "contour": LoggedRun(CONTOUR, resting_log()),
        "rest": LoggedRun(rest, resting_log(x=0.5, z=0.05)),
    }
    write(Campaign("bench 3", tmp_path / "rig", logs), tmp_path / "rig")
    return tmp_path / "rig"


def test_a_campaign_survives_the_round_trip(folder: Path) -> None:
    campaign = read_campaign(folder)
    assert list(campaign.logs) == ["contour", "rest"]
    assert campaign.name == "bench 3"
    assert campaign.notes == []
    assert campaign.logs["contour"].setup == CONTOUR
    pd.testing.assert_frame_equal(campaign.logs["contour"].log.table, resting_log().table)


def test_a_users_workpiece_travels_with_the_campaign(tmp_path: Path) -> None:
    edge = tmp_path / "edge.csv"
    edge.write_text("x,z_w\n0.3,0\n0.5,-0.01\n0.8,-0.02\n0.95,0\n")
    setup = LogSetup(workpiece=str(edge), standoff=0.05)
    write(Campaign("c", tmp_path, {"edge": LoggedRun(setup, resting_log())}), tmp_path / "new")
    edge.unlink()
    back = read_campaign(tmp_path / "new").logs["edge"].setup
    assert Path(back.workpiece).parent == tmp_path / "new"
    assert back.z_0 == 0.05


def test_clamps_hold_until_their_phase_starts() -> None:
    time = np.arange(500) * 1e-3
    assert CONTOUR.clamp_signal("x", time).sum() == 300
    assert CONTOUR.clamp_signal("x", time + 1e-9).sum() == 300
    assert not CONTOUR.clamp_signal("z", time).any()
    assert LogSetup(clamped=("x", "z")).clamp_signal("z", time).all()
    with pytest.raises(ValueError, match="no phase 'retreat'"):
        LogSetup(clamped=("x until retreat",))


def test_a_scenarios_setup_survives_as_provenance() -> None:
    setup = scenario_setup(Scenario(workpiece="incline_16"))
    assert setup_from(setup_table(setup)) == setup
    assert setup.z_0 == 0.092


def test_a_single_log_takes_its_setup_from_what_lies_beside_it(
    folder: Path, tmp_path: Path
) -> None:
    assert read_campaign(folder / "contour.parquet").logs["contour"].setup == CONTOUR
    (folder / "contour.toml").write_text('workpiece = "straight"\nclamped = ["x"]\n')
    beside = read_campaign(folder / "contour.parquet").logs["contour"].setup
    assert (beside.workpiece, beside.clamped, beside.loop) == ("straight", ("x",), "open")
    assert beside.start_x == pytest.approx(0.95)
    provenance = {"setup": setup_table(CONTOUR)}
    alone = write_log(Log(resting_log().table, "alone", provenance), tmp_path / "alone.csv")
    assert read_campaign(alone).logs["alone"].setup == CONTOUR
    assert read_campaign(alone, setup={"f_nd": 20.0}).logs["alone"].setup.f_nd == 20.0


def test_a_bare_log_is_open_loop_from_its_first_rows(tmp_path: Path) -> None:
    campaign = read_campaign(write_log(resting_log(x=0.4, z=0.02), tmp_path / "bare.parquet"))
    setup = campaign.logs["bare"].setup
    assert (setup.loop, setup.workpiece, setup.clamped) == ("open", "none", ())
    assert (setup.start_x, setup.start_z) == pytest.approx((0.4, 0.02))
    assert "nothing says how bare.parquet was taken" in campaign.notes[0]


def test_a_log_that_contradicts_its_setup_is_noted(folder: Path) -> None:
    write_log(resting_log(rows=400, x=0.5), folder / "contour.parquet")
    notes = read_campaign(folder).notes
    assert any("starts at x = 0.5 m, its setup says 0.95 m" in note for note in notes)
    assert any("ends at 0.399 s, its phases at 0.5 s" in note for note in notes)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            'workpiece = "curved"',
            'workpiece = "curvd"',
            r"log.contour.workpiece: unknown workpiece 'curvd'; did you mean",
        ),
        ('workpiece = "curved"', 'workpiece = "no.csv"', r"log.contour.workpiece: no such file"),
        ('loop = "closed"', 'loop = "close"', "log.contour.loop: is 'close'"),
        ("f_nd", "f_dn", "log.contour.f_dn: unknown key; did you mean f_nd"),
        ("[log.contour]", "[log.missing]", "log.missing: no missing.parquet or missing.csv"),
        ("[log.rest]", "[lag.rest]", "lag: unknown key; did you mean log"),
        ('"x until contour"', '"x till contour"', "log.contour.clamped: has 'x till contour'"),
        ("start = { x = 0.95", 'start = { x = "far"', "log.contour.start.x: is 'far'"),
        (
            "contour = [0.3, 0.5]",
            "contour = [0.5, 0.3]",
            "log.contour.phases.contour: ends at 0.3 s",
        ),
        ("[log.contour]", "[log.contour", "not valid TOML"),
    ],
)
def test_unusable_tables_are_refused_naming_file_key_and_mend(
    folder: Path, old: str, new: str, words: str
) -> None:
    index = folder / "campaign.toml"
    text = index.read_text()
    assert old in text
    index.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=words) as caught:
        read_campaign(folder)
    assert str(caught.value).startswith(str(index))
    assert "; " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_log_without_a_table_and_a_folder_without_an_index_are_refused(folder: Path) -> None:
    write_log(resting_log(), folder / "stray.csv")
    with pytest.raises(InputError, match=r"stray.csv has no table \[log.stray\]; add the table"):
        read_campaign(folder)
    assert "stray.csv" in read_campaign(folder, strict=False).notes[0]
    (folder / "campaign.toml").unlink()
    with pytest.raises(InputError, match=r"campaign\.toml: no such file; write one"):
        read_campaign(folder)


def test_the_rest_of_a_campaign_is_read_where_asked(folder: Path) -> None:
    (folder / "rest.parquet").write_bytes(b"PAR1 cut short")
    with pytest.raises(InputError, match=r"rest.parquet"):
        read_campaign(folder)
    campaign = read_campaign(folder, strict=False)
    assert list(campaign.logs) == ["contour"]
    assert "rest left out" in campaign.notes[0]
    (folder / "contour.parquet").unlink()
    with pytest.raises(InputError, match="no usable log"):
        read_campaign(folder, strict=False)


@pytest.mark.skipif(not CAMPAIGNS.is_dir(), reason=f"{CAMPAIGNS} is absent")
def test_the_nominal_campaign_reads_whole() -> None:
    campaign = read_campaign(CAMPAIGNS / "nominal")
    assert len(campaign.logs) == 7
    assert campaign.notes == []
    curved = campaign.logs["contour_curved"]
    assert curved.setup.clamp_signal("x", curved.log.time).sum() == 7000
    assert isinstance(curved.setup.gains, dict)
    assert curved.setup.gains["Ki_vx"] == 4.0
