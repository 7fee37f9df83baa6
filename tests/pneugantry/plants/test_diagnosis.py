"""The gantry's diagnosis: what a campaign makes of the engine's task, and what is said beside its
answer.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from modelica_fmu.errors import InputError
from pneugantry.engine.answer.result import Diagnosis, to_json
from pneugantry.engine.rules import Rules
from pneugantry.plants.gantry.catalogue import catalogue_of
from pneugantry.plants.gantry.converter import Converters
from pneugantry.plants.gantry.describe import plant_of, record_of
from pneugantry.plants.gantry.diagnosis import _coarse, _full_rate, diagnose, task_of
from pneugantry.plants.gantry.excitation import not_excited
from pneugantry.plants.gantry.nominal import parameters_of
from pneugantry.plants.gantry.timing import ControllerView
from pneugantry.truth.campaign import write
from pneugantry.truth.case import plan_case, run_case
from pyfmi_runner.blocks import COMMAND_QUANTUM, recomputed_commands
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import Campaign, LoggedRun, read_campaign, scenario_setup
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario
from pyfmi_runner.suspicions import log_warnings
from pyfmi_runner.timing import LoopTiming

SHORT = {"approach": (0.0, 1.0), "contact": (1.0, 2.0), "contour": (2.0, 3.0)}
FEW = Rules(rounds=1, iterations=3)


@pytest.fixture(scope="module")
def gantry() -> FmuFile:
    return FmuFile.read(build_fmu().path)


def tracked(gantry: FmuFile, **scenario: object) -> LoggedRun:
    """3 s of tracking the straight edge."""
    made = Scenario(name="short", workpiece="straight", phases=SHORT, start_z=0.038, **scenario)
    return LoggedRun(replace(scenario_setup(made)), run_scenario(made, gantry).log)


def campaign_of(**logs: LoggedRun) -> Campaign:
    named = {n: replace(r, log=replace(r.log, name=n)) for n, r in logs.items()}
    return Campaign("short", Path("short"), named, [])


@pytest.fixture(scope="module")
def late(gantry: FmuFile) -> Campaign:
    """One log whose commands act 7 ms late."""
    return campaign_of(one=tracked(gantry, timing=LoopTiming(delay=0.007)))


def test_what_a_controller_reads_late_is_not_a_late_command(gantry: FmuFile) -> None:
    """Commands recomputed from measurements 5 ms old leave the commands' rounding; late commands of
    the same delay do not, for the phases begin in time.
    """
    run = tracked(gantry)
    old = np.vstack([np.repeat(run.log.measured()[:1], 5, axis=0), run.log.measured()[:-5]])
    commands = recomputed_commands(run, np.round(old, 12))
    assert commands is not None
    running = np.isfinite(commands).all(axis=1)
    table = run.log.table.copy()
    for i, channel in enumerate(("u_x", "u_z")):
        table.loc[running, channel] = commands[running, i]
    read_late = LoggedRun(run.setup, replace(run.log, table=table))
    view = ControllerView({"one": read_late})
    record = record_of("one", read_late)
    late = [{}, {"timing.delay": 0.005}, {"timing.sensing": 0.005}]
    unmoved, acting, sensing = np.abs(view.residuals([(record, v) for v in late])).max(axis=(1, 2))
    assert sensing < 1e-3 * unmoved
    assert acting > 10 * sensing


def test_until_a_late_command_comes_the_valves_keep_the_one_before(late: Campaign) -> None:
    run = late.logs["one"]
    view, record = ControllerView({"one": run}), record_of("one", run)
    (left,) = view.residuals([(record, {"timing.delay": 0.007})])
    assert np.abs(left).max() < 5 * COMMAND_QUANTUM


def test_a_log_as_it_was_recorded_keeps_what_is_known_of_it_alone(late: Campaign) -> None:
    """Where a learnt wave stands in it; what its file says of it stays as it is."""
    raw = record_of("one", late.logs["one"])
    learnt = replace(raw, parameters={**raw.parameters, "friction.missing_1.p3": 0.06})
    found = _full_rate(learnt, late)
    assert found.parameters == {**raw.parameters, "friction.missing_1.p3": 0.06}
    assert found.rows == len(late.logs["one"].log.table)


def without(campaign: Campaign, *channels: str) -> Campaign:
    logs = {
        n: replace(r, log=replace(r.log, table=r.log.table.drop(columns=list(channels))))
        for n, r in campaign.logs.items()
    }
    return replace(campaign, logs=logs)


def test_one_short_log_is_diagnosed_and_run_again(late: Campaign) -> None:
    only = {"loop_delay": catalogue_of()["loop_delay"]}
    stages: list[str] = []
    found = to_json(diagnose(late, only, FEW, say=stages.append).diagnosis)
    assert (found["verdict"], found["where"][0]["block"]) == ("identified", "timing")
    assert found["causes"][0]["parameters"]["timing.delay"]["value"] == pytest.approx(
        0.007, abs=5e-4
    )
    assert any(note.startswith("one log only") for note in found["notes"])
    assert any(note.startswith("one workpiece only") for note in found["notes"])
    assert set(found["closed_loop"]) == {"nominal", "augmented", "floor", "shrink"}
    assert stages[0] == "model"
    assert stages[-1] == "closed loop"


def test_channels_that_no_sensor_has_are_left_out(late: Campaign) -> None:
    fewer = without(late, "f_ax", "f_az", "v_x")
    task = task_of(fewer, {}, Rules())
    assert [s.name for s in task.plant.signals] == ["x", "z", "v_z", "f_x", "f_z"]
    assert not any("f_a" in n.parameter or "v_x" in n.parameter for n in task.plant.nuisances)
    assert log_warnings(fewer.logs["one"].log) == []
    felt = not_excited(without(late, "f_x", "f_z"))
    assert any("no contact force is measured" in text for text in felt)
    bare = without(late, "x", "z", "v_x", "v_z", "f_x", "f_z", "f_ax", "f_az")
    with pytest.raises(InputError, match="no log measures anything"):
        task_of(bare, {}, Rules())


def test_a_coarse_converter_is_a_cause_without_a_fit(late: Campaign) -> None:
    quanta = {"v_x": 0.02}
    task = task_of(late, {}, Rules(), coarse=Converters(quanta))
    widths = {s.name: s.sigma for s in task.plant.signals}
    assert widths["v_x"] == pytest.approx(np.hypot(1e-3 / np.sqrt(2), 0.02 / np.sqrt(12)))
    assert any(note.startswith("v_x is read on a grid of 0.02 m/s") for note in task.notes)
    none = Diagnosis("none", (), (), ((),), probabilities={"none": 0.9, "unknown": 0.0})
    found = to_json(_coarse(none, quanta))
    assert found["verdict"] == "identified"
    assert [(w["block"], w["share"]) for w in found["where"]] == [("sensors", 1.0)]
    assert found["causes"][0]["parameters"]["step_v_x"]["value"] == 0.02
    assert found["answer_set"] == [["quantisation"]]


@pytest.mark.usefixtures("unoptimised")
def test_an_fmu_gives_parameters_and_no_equations(gantry: FmuFile, tmp_path: Path) -> None:
    from pneugantry.plants.gantry.augmented import write_augmented

    run = tracked(gantry)
    assert parameters_of(gantry, gantry, run) == {}
    heavier = FmuFile.read(write_augmented(tmp_path, gantry, {"axis_x.m": 9.0})[1])
    assert parameters_of(heavier, gantry, run) == {"axis_x.m": 9.0}
    with pytest.raises(InputError, match="does not replay"):
        parameters_of(heavier, replace_start(gantry, heavier), run)


def replace_start(gantry: FmuFile, heavier: FmuFile) -> FmuFile:
    """The gantry as if its mass were declared as the other's, though it is not."""
    variables = {**gantry.variables, "axis_x.m": heavier.variables["axis_x.m"]}
    return replace(gantry, description=replace(gantry.description, variables=variables))


@pytest.mark.slow
def test_a_valves_delay_is_found_with_its_size_and_closes_the_gap(tmp_path: Path) -> None:
    campaign, label = run_case(plan_case(1001, "one", 0.02, effects=(("valve_delay", "z"),)))
    write(tmp_path, campaign)
    result = to_json(diagnose(read_campaign(tmp_path)).diagnosis)
    assert result["verdict"] == "identified"
    assert (result["causes"][0]["effect"], result["causes"][0]["axis"]) == ("valve_delay", "z")
    assert result["where"][0]["block"] == "valve_z"
    assert result["causes"][0]["parameters"]["valve_z.delay_time"]["value"] == pytest.approx(
        label["causes"][0]["size"], rel=0.05
    )
    assert result["gap"]["log"] == "contour_straight"
    assert result["gap"]["shrink"] > 0.95
    assert result["closed_loop"]["shrink"] > 0.9


def test_signals_have_the_units_of_a_log() -> None:
    units = {s.name: s.unit for s in plant_of().signals}
    assert units == {
        **dict.fromkeys(("x", "z"), "m"),
        **dict.fromkeys(("v_x", "v_z"), "m/s"),
        **dict.fromkeys(("f_x", "f_z", "f_ax", "f_az"), "N"),
    }
