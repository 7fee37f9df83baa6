"""What must not get worse: the answers to campaigns whose truth is in their names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pneugantry.engine.answer.result import to_json
from pneugantry.engine.hypotheses.catalogue import Effect
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


def valve_steps(name: str, effects: dict[str, Effect]) -> dict[str, Any]:
    """The answer to one log of clamped pistons with a handful of effects: what always runs."""
    campaign = read_campaign(CAMPAIGNS / name)
    steps = next(n for n in campaign.logs if n.startswith("valve_steps"))
    one = replace(campaign, logs={steps: campaign.logs[steps]})
    return to_json(diagnose(one, effects, Rules(rounds=1)).diagnosis)


@pytest.mark.parametrize("name", ["nominal", "example_valve_delay_z"])
def test_a_valve_by_itself_is_answered_as_before(name: str) -> None:
    few = {k: e for k, e in catalogue_of().items() if k in ("valve_delay/z", "valve_lag/z")}
    verdict, key, block = answered(valve_steps(name, few))
    assert verdict == GOLDEN[name][0]
    if verdict != "none":
        assert (key, block) == GOLDEN[name][1:]


def test_an_effect_that_the_catalogue_lacks_is_unknown_in_its_block() -> None:
    lag = {k: e for k, e in catalogue_of().items() if k == "valve_lag/z"}
    verdict, _, block = answered(valve_steps("example_valve_delay_z", lag))
    assert (verdict, block) == ("unknown", "valve_z")


def test_two_effects_that_no_log_tells_apart_are_ambiguous() -> None:
    late = catalogue_of()["valve_delay/z"]
    other = replace(late, name="late_command")
    found = valve_steps("example_valve_delay_z", {late.key: late, other.key: other})
    verdict, _, block = answered(found)
    assert (verdict, block) == ("ambiguous", "valve_z")
    assert {tuple(keys) for keys in found["answer_set"]} == {(late.key,), (other.key,)}
