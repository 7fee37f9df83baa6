"""The gantry's logs without some of its sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from modelica_fmu.errors import InputError
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.plant import Data
from pneugantry.engine.rules import Rules
from pneugantry.plants.gantry.describe import data_of, measured_of, plant_of, record_of, views_of
from pyfmi_runner.build import cache_folder
from pyfmi_runner.campaign import DRIVEN, Campaign, read_campaign
from pyfmi_runner.log import MEASURED

ROOT = Path(__file__).resolve().parents[3]
NOMINAL = ROOT.parent / "shared" / "campaigns" / "nominal"
FORCES = ("f_ax", "f_az")
campaigns = pytest.mark.skipif(not NOMINAL.is_dir(), reason="no campaign beside the repository")


def lacking(folder: Path, missing: Sequence[str], rows: int | None = None) -> Path:
    """The nominal campaign without some columns, its logs cut to their first rows."""
    for log in NOMINAL.glob("*.parquet"):
        pd.read_parquet(log).drop(columns=list(missing))[:rows].to_parquet(folder / log.name)
    (folder / "campaign.toml").write_bytes((NOMINAL / "campaign.toml").read_bytes())
    return folder


def small(folder: Path, columns: Sequence[str]) -> Path:
    """A log of nothing but a rig at rest."""
    rows = 200
    table = pd.DataFrame({c: np.full(rows, 0.05) for c in columns if c != "time"})
    table.insert(0, "time", 1e-3 * np.arange(rows))
    table.to_csv(folder / "rest.csv", index=False)
    (folder / "campaign.toml").write_text(
        "[log.rest]\nstart = { x = 0.05, z = 0.05 }\n", encoding="utf-8"
    )
    return folder


def test_a_log_without_actuator_forces_is_refused_unless_asked_for(tmp_path: Path) -> None:
    own = [*DRIVEN, *(c for c in MEASURED if c not in FORCES)]
    folder = small(tmp_path, own)
    with pytest.raises(InputError, match="f_ax: column is missing"):
        read_campaign(folder)
    found = read_campaign(folder, needs=DRIVEN)
    assert measured_of(found) == tuple(c for c in MEASURED if c not in FORCES)
    assert found.notes == ["rest does not measure f_ax, f_az"]
    table = pd.read_csv(folder / "rest.csv").rename(columns={"v_x": "Xspeed"})
    table.to_csv(folder / "rest.csv", index=False)
    (said,) = read_campaign(folder, needs=DRIVEN).notes
    assert said.startswith("rest does not measure v_x, f_ax, f_az; column Xspeed is not known: ")
    assert "`pneugantry log init FILE` maps names" in said
    alone = read_campaign(folder / "rest.csv", needs=DRIVEN)
    assert alone.logs["rest"].setup.start_x == 0.05


def test_a_log_needs_commands_and_one_channel(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="columns: measures nothing; add one of x, z"):
        read_campaign(small(tmp_path, DRIVEN), needs=DRIVEN)
    with pytest.raises(InputError, match="u_x: column is missing"):
        read_campaign(small(tmp_path, ("time", "u_z", "x")), needs=DRIVEN)


def test_positions_alone_are_a_campaign(tmp_path: Path) -> None:
    found = read_campaign(small(tmp_path, (*DRIVEN, "z")), needs=DRIVEN)
    assert measured_of(found) == ("z",)
    (record,) = data_of(found, Rules()).fitted
    assert set(record.signals) == {"z"}
    named = {n.parameter for n in plant_of(measured_of(found)).nuisances}
    assert "sensors.z.scale" in named
    assert not {n for n in named if n.startswith("sensors.") and ".z." not in n}


@campaigns
def test_views_reach_from_the_commands_where_no_actuator_force_is_measured(tmp_path: Path) -> None:
    """Each carriage's view then reads its valve, and the controller's is there still."""
    found = read_campaign(lacking(tmp_path, FORCES), needs=DRIVEN)
    plant = plant_of(measured_of(found))
    views = {v.signals: v for v in views_of(plant, found, cache_folder() / "parts", Rules())}
    assert set(views) == {("x",), ("z",), ("v_x",), ("v_z",), ("f_x", "f_z"), ("u_x", "u_z")}
    assert views["v_z",].depends_on("valve_z.tau")
    assert views["v_z",].depends_on("axis_z.m")
    assert not views["v_z",].depends_on("valve_x.tau")
    closed = views["u_x", "u_z"]
    shown = [n for n, r in found.logs.items() if closed.shows(record_of(n, r))]
    assert shown == [n for n, r in found.logs.items() if r.setup.loop == "closed"]


def fitted(campaign: Campaign, data: Data) -> dict[str, float]:
    """Noise that a null fit leaves, in units of the quoted one."""
    rules = Rules()
    plant = plant_of(measured_of(campaign), rules.thinning)
    views = views_of(plant, campaign, cache_folder() / "parts", rules)
    fitter = Fitter(plant, views, data.fitted, rules)
    try:
        fit = fitter.null()
    finally:
        fitter.close()
    views_by_name = fitter.simulation.views
    return {
        s: w.sigma / quoted
        for (name, _), whiteners in fit.noise.items()
        for s, w, quoted in zip(
            views_by_name[name].signals, whiteners, views_by_name[name].sigmas, strict=True
        )
    }


@pytest.mark.usefixtures("unoptimised")
@campaigns
def test_a_null_fit_comes_to_the_noise_without_actuator_forces(tmp_path: Path) -> None:
    """The log of free motion alone, its first 4 s: seconds, not minutes."""
    campaign = read_campaign(lacking(tmp_path, FORCES, 4000), needs=DRIVEN)
    runs = {n: r for n, r in campaign.logs.items() if n == "free_motion"}
    campaign = replace(campaign, logs=runs)
    noise = fitted(campaign, data_of(campaign, Rules()))
    assert set(noise) == {"x", "z", "v_x", "v_z", "f_x", "f_z"}
    for signal, size in noise.items():
        assert 0.75 < size < 1.25, (signal, size)  # orders of few rows predict some of it


@campaigns
@pytest.mark.slow
def test_a_null_fit_of_the_whole_campaign_comes_to_the_noise(tmp_path: Path) -> None:
    campaign = read_campaign(lacking(tmp_path, FORCES), needs=DRIVEN)
    for signal, size in fitted(campaign, data_of(campaign, Rules())).items():
        if signal not in ("u_x", "u_z"):  # whose residual is a quantum of the converter
            # the positions' noise, through the stiff contact, is one of the force that wanders
            most = 1.6 if signal.startswith("f_") else 1.25
            assert 0.75 < size < most, (signal, size)  # orders of few rows predict some of it
