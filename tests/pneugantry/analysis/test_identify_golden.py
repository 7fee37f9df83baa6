"""Identified parameters of stored campaigns are those of the slow way, which solved anew for every
Jacobian and by scipy's least squares: a trusted answer, frozen before the chord method came. Two of
them were frozen again when a speed that jumps was smoothed otherwise (0157), which moves what their
logs tell by up to 0.4 %; the code that fits had not changed.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from pneugantry.api import runs

CAMPAIGNS = Path(__file__).parents[4] / "shared" / "campaigns"
GOLDEN = Path(__file__).parent / "golden"
SHIFT = 0.1  # of an interval's half-width
WIDTH = 0.05  # of a width


@pytest.mark.skipif(not CAMPAIGNS.is_dir(), reason="no stored campaigns")
@pytest.mark.parametrize(
    "name",
    [
        "nominal",
        pytest.param("example_presliding_z", marks=pytest.mark.slow),
        pytest.param("example_valve_delay_z", marks=pytest.mark.slow),
    ],
)
def test_the_answer_is_that_of_the_slow_way(name: str) -> None:
    frozen = json.loads((GOLDEN / f"identify_{name}.json").read_text(encoding="utf-8"))
    found = runs.identify(CAMPAIGNS / name).as_json()
    assert (found["fits"], found["notes"]) == (frozen["fits"], frozen["notes"])
    assert found["gap"] == pytest.approx(frozen["gap"], rel=1e-4)
    assert found["parameters"].keys() == frozen["parameters"].keys()
    for parameter, before in frozen["parameters"].items():
        agree(found["parameters"][parameter], before)


def agree(now: dict[str, Any], before: dict[str, Any]) -> None:
    assert now["rests_on"] == before["rests_on"]
    if before["value"] is None:
        assert now["value"] is None
        return
    if before["ci95"] is None or before["ci95"][0] is None:
        assert now["value"] == pytest.approx(before["value"], rel=1e-4, nan_ok=True)
        return
    half, half_now = ((p["ci95"][1] - p["ci95"][0]) / 2 for p in (before, now))
    assert abs(now["value"] - before["value"]) < SHIFT * half
    assert half_now == pytest.approx(half, rel=WIDTH)
