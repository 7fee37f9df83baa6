"""What must not get worse: the answers to campaigns whose truth is in their names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from pneugantry.engine.result import to_json
from pneugantry.engine.rules import Rules
from pneugantry.plants.gantry.catalogue import catalogue_of
from pneugantry.plants.gantry.diagnosis import diagnose
from pyfmi_runner.campaign import read_campaign

CAMPAIGNS = Path(__file__).parents[4] / "shared" / "campaigns"
pytestmark = pytest.mark.skipif(not CAMPAIGNS.is_dir(), reason="no stored campaigns")
GOLDEN = {  # campaign: verdict, top cause, block
    "nominal": ("none", "", ""),
    "rig_none_1": ("none", "", ""),
    "rig_none_2": ("none", "", ""),
    "rig_coulomb_level_x": ("identified", "coulomb_level/x", "friction_x"),
    "example_presliding_z": ("identified", "presliding/z", "friction_z"),
    "example_valve_delay_z": ("identified", "valve_delay/z", "valve_z"),
}


def answered(found: dict) -> tuple[str, str, str]:
    cause = next(iter(found["causes"]), None)
    key = f"{cause['effect']}/{cause['axis']}" if cause else ""
    return found["verdict"], key, found["where"][0]["block"] if found["where"] else ""


@pytest.mark.slow
@pytest.mark.parametrize("name", GOLDEN)
def test_a_labelled_campaign_is_answered_as_before(name: str) -> None:
    found = to_json(diagnose(read_campaign(CAMPAIGNS / name)).diagnosis)
    verdict, key, block = answered(found)
    assert verdict == GOLDEN[name][0]
    if verdict != "none":
        assert (key, block) == GOLDEN[name][1:]


@pytest.mark.parametrize("name", ["nominal", "example_valve_delay_z"])
def test_a_valve_by_itself_is_answered_as_before(name: str) -> None:
    """One log of clamped pistons and a handful of effects: what always runs."""
    campaign = read_campaign(CAMPAIGNS / name)
    steps = next(n for n in campaign.logs if n.startswith("valve_steps"))
    few = {k: e for k, e in catalogue_of().items() if k in ("valve_delay/z", "valve_lag/z")}
    found = to_json(
        diagnose(
            replace(campaign, logs={steps: campaign.logs[steps]}), few, Rules(rounds=1)
        ).diagnosis
    )
    verdict, key, block = answered(found)
    assert verdict == GOLDEN[name][0]
    if verdict != "none":
        assert (key, block) == GOLDEN[name][1:]
