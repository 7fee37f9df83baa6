"""`pneugantry plan`."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pneugantry.cli import main

ROOT = Path(__file__).resolve().parents[2]
MOTOR = ROOT / "examples" / "motor"
CAMPAIGN = ROOT.parent / "shared" / "campaigns" / "nominal"
Capture = pytest.CaptureFixture[str]


def result(capture: Capture, *arguments: str) -> Any:
    capture.readouterr()
    assert main(["plan", *arguments, "--json", "-"]) == 0
    return json.loads(capture.readouterr().out)


def test_a_motor_s_plan_says_what_its_logs_can_tell(
    capsys: Capture, tmp_path: Path, keeps_to_schema: Callable[[Any], None]
) -> None:
    page = tmp_path / "plan.html"
    found = result(capsys, str(MOTOR / "plant.toml"), "--logs-only", "--html", str(page))
    keeps_to_schema(found)
    assert set(found) == {
        "schema", "plant", "logs", "signals", "told", "effects", "unseen", "pairs", "adds",
        "notes", "seconds",
    }  # fmt: skip
    assert found["schema"] == "plan/1"
    assert found["logs"] == ["sines", "steps"]
    effects = {e["effect"]: e for e in found["effects"]}
    assert {"coulomb_friction", "constant_torque", "unbalance"} <= set(effects)
    coulomb = effects["coulomb_friction"]
    assert coulomb["visible"]
    assert coulomb["unit"] == "N.m"
    assert 0 < coulomb["smallest"] < coulomb["usual"] == pytest.approx(0.2)
    assert sum(s["share"] for s in coulomb["seen_by"]) == pytest.approx(1.0)
    assert {a["what"] for a in found["adds"]["logs"]} == {"sines", "steps"}
    assert found["adds"]["experiments"] == found["adds"]["sensors"] == []
    assert "coulomb_friction" in page.read_text(encoding="utf-8")


def test_an_fmu_without_source_is_refused_in_one_line(capsys: Capture, tmp_path: Path) -> None:
    text = (MOTOR / "plant.toml").read_text(encoding="utf-8")
    text = text.replace('model = "Motor.mo"\nclass = "Motor.Axis"', 'fmu = "motor.fmu"')
    (tmp_path / "plant.toml").write_text(text, encoding="utf-8")
    assert main(["plan", str(tmp_path / "plant.toml")]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "plant: plan needs the Modelica source" in said


def test_a_folder_that_is_no_campaign_is_one_line(capsys: Capture, tmp_path: Path) -> None:
    assert main(["plan", str(tmp_path)]) == 2
    assert "campaign.toml" in capsys.readouterr().err


def test_a_signal_that_is_not_measured_cannot_be_left_out(capsys: Capture) -> None:
    assert main(["plan", str(MOTOR / "plant.toml"), "--without", "speed"]) == 2
    assert "speed: is no measured signal; use some of w" in capsys.readouterr().err


def test_a_page_does_not_replace_the_description(capsys: Capture, tmp_path: Path) -> None:
    shutil.copytree(MOTOR, tmp_path / "motor")
    plant = str(tmp_path / "motor" / "plant.toml")
    assert main(["plan", plant, "--html", plant]) == 2
    assert "would replace" in capsys.readouterr().err


@pytest.mark.usefixtures("unoptimised")
@pytest.mark.skipif(not CAMPAIGN.is_dir(), reason="no campaign beside the repository")
def test_a_campaign_without_its_actuator_forces_tells_the_valve_less(capsys: Capture) -> None:
    """Logs alone: the command line's way; channels are left out in `plants/gantry`."""
    from dataclasses import replace

    from pneugantry.engine.planning.plan import make_plan
    from pneugantry.plants.gantry.describe import plant_of
    from pneugantry.plants.gantry.experiments import case_of
    from pyfmi_runner.build import cache_folder
    from pyfmi_runner.campaign import read_campaign
    from pyfmi_runner.log import MEASURED

    case = case_of(read_campaign(CAMPAIGN), cache_folder() / "parts", experiments=False)
    effects = ("valve_delay/z", "valve_gain/z", "contact_stiffness", "pressure_gain/z")
    case = replace(
        case, catalogue={k: case.catalogue[k] for k in effects}, records=case.records[3:5]
    )
    few = plant_of([c for c in MEASURED if c not in ("f_ax", "f_az")])
    whole, part = make_plan(case), make_plan(replace(case, plant=few))
    before, after = ({s.effect: s for s in p.sights} for p in (whole, part))
    assert part.unread == ("pressure_gain/z",)
    assert after["valve_delay/z"].sigma < before["valve_delay/z"].sigma
    assert before["valve_gain/z"].sigma == pytest.approx(5.0, rel=0.02)  # 15 % beside 2 % times 1.5
    assert after["contact_stiffness"].sigma == pytest.approx(
        before["contact_stiffness"].sigma, rel=0.05
    )
