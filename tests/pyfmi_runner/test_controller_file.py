"""A user's own controller from a Python file, and a rig's controller that is none of ours."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from controllers.catalogue import make_controller
from modelica_fmu.errors import InputError
from pyfmi_runner.blocks import recomputed_commands
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import LoggedRun, read_campaign
from pyfmi_runner.controller_file import is_known_controller, read_controller
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import write_log
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario, read_scenario

PHASES = {"approach": (0.0, 1.0), "contact": (1.0, 2.0), "contour": (2.0, 3.0)}
OWN = """
from typing import NamedTuple
from numba.extending import register_jitable
from controllers.interface import Command, Controller, clip_command

class Gains(NamedTuple):
    k_f: float = 0.004

@register_jitable
def push(params, state, reference, sense):
    return state, Command(0.8, clip_command(1.0 + params.k_f * (reference.f_nd - sense.f_z)))

class Push(Controller):
    kernel = staticmethod(push)
    def __init__(self, gains=None):
        super().__init__(Gains(**(gains or {})))
    def initial_state(self):
        return Gains()
"""


@pytest.fixture
def own(tmp_path: Path) -> Path:
    path = tmp_path / "own.py"
    path.write_text(OWN, encoding="utf-8")
    return path


def scenario(controller: str, **more: object) -> Scenario:
    return Scenario(
        workpiece="straight", start_z=0.038, phases=PHASES, controller=controller, **more
    )


def test_a_file_runs_as_its_controller_does(own: Path) -> None:
    fmu = FmuFile.read(build_fmu().path)
    named = run_scenario(scenario(str(own), gains={"k_f": 0.01}), fmu)
    given = run_scenario(scenario("own"), fmu, controller=read_controller(own, gains={"k_f": 0.01}))
    assert named.outcome == "done"
    assert np.array_equal(named.log["u_z"], given.log["u_z"])
    other = run_scenario(scenario(str(own)), fmu)
    assert not np.array_equal(named.log["u_z"], other.log["u_z"])


def test_the_file_is_compiled_once_and_anew_when_it_changes(own: Path) -> None:
    first, second = read_controller(own), read_controller(own)
    assert first.kernel is second.kernel
    own.write_text(OWN.replace("0.8", "0.9"), encoding="utf-8")
    assert read_controller(own).kernel is not first.kernel


def test_a_scenario_takes_the_file_from_its_own_folder(own: Path) -> None:
    file = own.with_name("s.toml")
    file.write_text('controller = "own.py"\n', encoding="utf-8")
    assert read_scenario(file).controller == str(own.resolve())
    file.write_text('controller = "absent.py"\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"controller: no such file .*absent\.py"):
        read_scenario(file)


BAD = {
    "absent": (None, "cannot be read"),
    "syntax": ("def (", "SyntaxError in line 1"),
    "crash": ("x = 1\n1 / 0\n", "ZeroDivisionError in line 2"),
    "no class": ("x = 1\n", "defines no class derived from Controller"),
    "two classes": (OWN + "class Other(Push): pass\n", "2 classes (Push, Other)"),
    "needs arguments": (OWN.replace("gains=None", "gains"), "missing 1 required"),
    "gives something else": ("def controller(): return 3\n", "gives int, expected a Controller"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_file_that_cannot_be_used_is_refused_by_name(case: str, tmp_path: Path) -> None:
    text, words = BAD[case]
    path = tmp_path / "own.py"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_controller(path)
    assert words in str(caught.value)
    assert "own.py" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_rig_s_own_controller_is_said_and_left_out(tmp_path: Path) -> None:
    log = run_scenario(scenario("pi_fv"), FmuFile.read(build_fmu().path)).log
    run = next(iter(read_campaign(write_log(log, tmp_path / "a.parquet"))))
    assert recomputed_commands(run, run.log.measured()) is not None
    rig = LoggedRun(replace(run.setup, controller="rig_own"), run.log)
    assert recomputed_commands(rig, run.log.measured()) is None
    (tmp_path / "a.toml").write_text('loop = "closed"\ncontroller = "rig_own"\n')
    notes = read_campaign(tmp_path / "a.parquet").notes
    assert any("'rig_own', which is none of ours" in note for note in notes)


def test_no_file_is_run_because_a_log_names_it(own: Path, tmp_path: Path) -> None:
    log = run_scenario(scenario(str(own)), FmuFile.read(build_fmu().path)).log
    setup = next(iter(read_campaign(write_log(log, tmp_path / "a.parquet")))).setup
    assert setup.controller == "own.py"
    assert not is_known_controller(setup.controller)
    assert is_known_controller("pi_fv")
    assert is_known_controller("pi_force_velocity")
    assert make_controller("pi_fv")
