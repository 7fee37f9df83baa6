"""The timed path is the documented one: its steps are found in README, tutorials and notebook, and
run there (tests of those run the same text).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.new_user import HAND, RECORDER, Step, steps, timed
from modelica_fmu.errors import RunError
from pneugantry.cli import main, parser
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import write_log
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario

ROOT = Path(__file__).parents[2]
PHASES = {"approach": (0.0, 1.0), "contact": (1.0, 4.0), "contour": (4.0, 5.0)}


def test_the_steps_are_those_of_readme_tutorials_and_notebook() -> None:
    found = {step.name: step for step in steps(ROOT)}
    assert [name.split(":")[0] for name in found] == [
        "environment",
        "first plot",
        *["own log"] * 6,
        *["own plant"] * 2,
        "own controller",
        "own effect",
        "plot again, nothing to build or compile anew",
    ]
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8").replace("$(VENV)", ".venv")
    assert found["environment"].command[1] in makefile
    for step in found.values():
        if step.command[0] == "pneugantry":
            parser().parse_args(list(step.command[1:]))
        for name, text in step.files.items():
            if name.endswith(".py"):
                compile(text, name, "exec")
    assert "class StraightPi(Controller" in found["own controller"].files["straight_pi.py"]
    assert "leaning_workpiece" in found["own effect"].files["my_effect.py"]
    model = found["own plant: model"].files
    assert set(model) >= {"mine/Motor.mo", "mine/plant.toml", "mine/data/sines.csv"}


def test_the_recorder_and_the_hand_make_a_log_that_is_read(tmp_path: Path) -> None:
    """The two stand-ins for a user, with `log init` between them."""
    scenario = Scenario(workpiece="curved", phases=PHASES, seed=1)
    log = run_scenario(scenario, FmuFile.read(build_fmu().path)).log
    write_log(log, tmp_path / "out" / "late.parquet")
    timed(Step("recorder", (sys.executable, "recorder.py"), {"recorder.py": RECORDER}), tmp_path)
    assert main(["log", "init", str(tmp_path / "rig.csv")]) == 0
    timed(Step("hand", (sys.executable, "hand.py"), {"hand.py": HAND}), tmp_path)
    run = read_campaign(tmp_path / "rig.csv").logs["rig"]
    assert (run.setup.loop, run.setup.workpiece) == ("closed", "curved")
    assert run.setup.clamped == ("x until contour",)
    np.testing.assert_allclose(run.log["f_az"][::2], log["f_az"][::2], atol=1e-9)


def test_a_step_that_fails_says_why(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="it: exit code 3: no way"):
        timed(Step("it", ("sh", "my.sh"), {"my.sh": "echo no way >&2; exit 3"}), tmp_path)
    with pytest.raises(RunError, match="it: nothing-of-the-kind: No such file"):
        timed(Step("it", ("nothing-of-the-kind",)), tmp_path)
