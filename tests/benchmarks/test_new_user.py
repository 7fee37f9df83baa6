"""The timed path is the documented one: its steps are found in README and notebook, and run there
(tests of both run the same text).
"""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.new_user import Step, steps, timed
from modelica_fmu.errors import RunError
from pneugantry.cli import parser

ROOT = Path(__file__).parents[2]


def test_the_steps_are_those_of_readme_and_notebook() -> None:
    found = {step.name: step for step in steps(ROOT)}
    assert list(found)[:4] == [
        "environment",
        "first plot",
        "first own controller",
        "first own effect",
    ]
    assert found["environment"].command[1] in (ROOT / "Makefile").read_text(
        encoding="utf-8"
    ).replace("$(VENV)", ".venv")
    assert parser().parse_args(list(found["first plot"].command[1:])).plot
    for name, word in {
        "first own controller": "class StraightPi(Controller",
        "first own effect": "leaning_workpiece",
    }.items():
        script = found[name].script
        assert script is not None
        compile(script[1], script[0], "exec")
        assert word in script[1]


def test_a_step_that_fails_says_why(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="it: exit code 3: no way"):
        timed(Step("it", ("sh", "my.sh"), ("my.sh", "echo no way >&2; exit 3")), tmp_path)
    with pytest.raises(RunError, match="it: nothing-of-the-kind: No such file"):
        timed(Step("it", ("nothing-of-the-kind",)), tmp_path)
