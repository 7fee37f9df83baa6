"""Command replay and block replay: of the recorded campaigns, and of campaigns measured on the
independent truth plant.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from modelica_fmu.errors import InputError
from pneugantry.truth import campaign as truth
from pneugantry.truth.case import plan_case
from pneugantry.truth.parameters import Rig, nominal
from pneugantry.truth.setups import campaign_setups
from pyfmi_runner.blocks import BLOCKS, BlockReplayer, noisy_copy
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import Campaign, LoggedRun, read_campaign, setup_from
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import MEASURED
from pyfmi_runner.replay import SIGMAS, Gaps, Replayer, channel_gaps
from pyfmi_runner.run import RunResult, run_scenario
from pyfmi_runner.scenario import Scenario

ROOT = Path(__file__).resolve().parents[2]

SHARED = ROOT.parent / "shared" / "campaigns"
recorded = pytest.mark.skipif(
    not SHARED.is_dir(), reason="../shared/campaigns is not on this machine"
)
FLOOR = 1.03  # of a correct plant, on every channel
SEVEN = (
    "valve_steps_1000",
    "valve_steps_500",
    "valve_steps_0",
    "free_motion",
    "contact_steps",
    "contour_straight",
    "contour_curved",
)


def gaps(campaign: Campaign, fmu: FmuFile) -> dict[str, Gaps]:
    with Replayer(fmu) as plant:
        return {
            name: channel_gaps(run.log.measured(), plant.simulate(run))
            for name, run in campaign.logs.items()
        }


def block_gaps(campaign: Campaign, fmu: FmuFile) -> dict[str, dict[str, dict[str, float]]]:
    with Replayer(fmu) as plant, BlockReplayer(fmu) as blocks:
        return {
            name: blocks.gaps(run, noisy_copy(run, plant.simulate(run)))
            for name, run in campaign.logs.items()
        }


def measured_on(rig: Rig, folder: Path, names: tuple[str, ...] = SEVEN, seed: int = 5) -> Campaign:
    """A campaign taken on a rig of the truth plant, which shares no line with the FMU or the
    runner.
    """
    setups = {name: campaign_setups()[name] for name in names}
    truth.write(folder, truth.generate(rig, seed, setups), setups)
    return read_campaign(folder)


# ---- command replay


@recorded
def test_the_nominal_campaign_replays_to_the_noise_floor(gantry: FmuFile) -> None:
    found = gaps(read_campaign(SHARED / "nominal"), gantry)
    assert tuple(found) == SEVEN
    for name, gap in found.items():
        assert set(gap.channels) == set(MEASURED)
        assert max(gap.channels.values()) <= FLOOR, name
        assert min(gap.channels.values()) > 0.97, name


def test_a_campaign_of_the_truth_plant_replays_to_the_noise_floor(
    gantry: FmuFile, tmp_path: Path
) -> None:
    found = gaps(measured_on(nominal(), tmp_path), gantry)
    assert tuple(found) == SEVEN
    for name, gap in found.items():
        assert max(gap.channels.values()) <= FLOOR, name


def test_a_run_replays_to_its_own_noise_and_a_detuned_plant_does_not(gantry: FmuFile) -> None:
    result = run_scenario(Scenario(workpiece="incline_7", seed=2, surface_finish=True), gantry)
    run = logged(result)
    with Replayer(gantry) as plant:
        exact = channel_gaps(run.log.measured(), plant.simulate(run))
        off = channel_gaps(run.log.measured(), plant.simulate(run, {"valve_z.K": 102.0}))
        again = channel_gaps(run.log.measured(), plant.simulate(run))
    assert max(exact.channels.values()) <= FLOOR
    assert again == exact  # a replay leaves nothing behind
    assert off.gap > 3


def logged(result: RunResult) -> LoggedRun:
    """A run with the set-up that its log carries."""
    return LoggedRun(setup_from(result.log.provenance["setup"]), result.log)


def test_a_run_on_a_profile_of_the_user_replays_to_its_own_noise(
    gantry: FmuFile, tmp_path: Path
) -> None:
    x = np.linspace(0.0, 1.0, 101)
    edge = tmp_path / "edge.csv"
    edge.write_text(
        "x,z_w\n"
        + "".join(
            f"{a!r},{b!r}\n"
            for a, b in zip(x.tolist(), (0.004 * np.sin(12 * x)).tolist(), strict=True)
        )
    )
    result = run_scenario(Scenario(workpiece=str(edge), seed=4), gantry)
    run = logged(result)
    with Replayer(gantry) as plant:
        exact = channel_gaps(run.log.measured(), plant.simulate(run))
    assert max(exact.channels.values()) <= FLOOR


def test_the_gap_is_the_rms_in_sigmas_over_channels_and_time() -> None:
    measured, simulated = np.zeros((4, 8)), np.zeros((4, 8))
    measured[:, 2] = 2 * SIGMAS[2]
    measured[0, 5] = 6 * SIGMAS[5]
    gap = channel_gaps(measured, simulated)
    assert gap.channels["v_x"] == pytest.approx(2.0)
    assert gap.channels["f_z"] == pytest.approx(3.0)
    assert gap.channels["x"] == 0.0
    assert gap.gap == pytest.approx(np.sqrt((4 + 9) / 8))


def test_a_foreign_fmu_is_refused(gantry: FmuFile, tmp_path: Path) -> None:
    valve = FmuFile.read(build_fmu("PneuGantry.Valve", out=tmp_path).path)
    with pytest.raises(
        InputError, match=r"u_x: is the FMU of PneuGantry\.Valve, which has no such variable"
    ):
        Replayer(valve)


# ---- block replay


@recorded
@pytest.mark.parametrize("name", ["nominal", "example_presliding_z", "example_valve_delay_z"])
def test_every_block_of_a_recorded_campaign_is_judged(name: str, gantry: FmuFile) -> None:
    found = block_gaps(read_campaign(SHARED / name), gantry)
    assert {block for entry in found.values() for block in entry} == set(BLOCKS)
    for entry in found.values():
        assert all(np.isfinite([b["gap"], b["floor"]]).all() for b in entry.values())
        assert entry["sensors"]["gap"] == pytest.approx(1.0, abs=0.05)


def test_on_the_nominal_rig_every_block_is_at_its_floor(gantry: FmuFile, tmp_path: Path) -> None:
    entries = block_gaps(measured_on(nominal(), tmp_path), gantry)
    assert {block for entry in entries.values() for block in entry} == set(BLOCKS)
    for name, entry in entries.items():
        for block, found in entry.items():
            # a window of the friction block that starts near break-away sticks or slides by the
            # luck of its noise
            allowed = 3.0 if block.startswith("friction") else 1.25
            assert found["gap"] < allowed * found["floor"], (name, block)


@pytest.mark.parametrize(
    ("effect", "axis", "block", "log"),
    [
        ("presliding", "z", "friction_z", "contact_steps"),
        ("valve_delay", "z", "valve_z", "contact_steps"),
        ("coulomb_level", "x", "friction_x", "contour_straight"),
        ("contact_stiffness", "", "contact", "contact_steps"),
    ],
)
def test_an_effect_shows_in_its_block_first(
    effect: str, axis: str, block: str, log: str, gantry: FmuFile, tmp_path: Path
) -> None:
    """Without tolerance the block with the largest gap over floor is the one that differs."""
    case = plan_case(11, effects=((effect, axis),), rms=0.0)
    (cause,) = case.causes
    rig, _ = replace(cause, size=cause.form.high).apply(case.rig)
    (entry,) = block_gaps(measured_on(rig, tmp_path, (log,)), gantry).values()
    ratios = {name: found["gap"] / found["floor"] for name, found in entry.items()}
    assert max(ratios, key=lambda name: ratios[name]) == block, ratios
    assert ratios[block] > 1.5
