"""What follows from a diagnosis: the augmented plant for other tools, the next experiment,
readings of coarse converters.
"""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pneugantry.engine.answer.decide import Decision
from pneugantry.engine.answer.imitation import Imitation
from pneugantry.engine.answer.result import Answer
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.hypotheses.hypothesis import Hypothesis
from pneugantry.engine.plant import Data
from pneugantry.engine.rules import Rules
from pneugantry.engine.task import Task
from pneugantry.engine.views.simulation import Point
from pneugantry.plants.gantry.augmented import (
    augmented_model,
    outside_the_plant,
    write_augmented,
)
from pneugantry.plants.gantry.converter import as_read, coarse_channels, rounded
from pneugantry.plants.gantry.describe import plant_of, record_of
from pneugantry.plants.gantry.next_experiment import (
    candidates,
    for_a_curve,
    next_experiment,
    proposed,
    rivals,
)
from pneugantry.plants.gantry.timing import ControllerView
from pyfmi_runner.blocks import COMMAND_QUANTUM, recomputed_commands
from pyfmi_runner.build import build_fmu, cache_folder
from pyfmi_runner.campaign import Campaign, LoggedRun, scenario_setup
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario, scenario_from
from pyfmi_runner.timing import LoopTiming

FITTED = {
    "axis_z.friction.law": 3.0,
    "axis_z.friction.beta": 14.2,
    "axis_z.friction.sigma": 9e4,
    "axis_x.m": 7.41,
    "valve_x.play_centred": 1.0,
    "coupling": 0.5,
    "sensors.f_x.bias": 2.0,
    "timing.delay": 0.004,
    "valve_z.K": 100.0,
}


TASK = Task(plant_of(), (), Data((), None), {}, cache_folder() / "parts")


@pytest.fixture(scope="module")
def gantry() -> FmuFile:
    return FmuFile.read(build_fmu().path)


@pytest.fixture(scope="module")
def late(gantry: FmuFile) -> Campaign:
    """One closed-loop log whose commands act 7 ms late."""
    scenario = Scenario(name="contour_curved", timing=LoopTiming(delay=0.007), seed=5)
    setup = scenario_setup(Scenario(name="contour_curved"))
    return Campaign(
        "late",
        Path("late"),
        {"contour_curved": LoggedRun(setup, run_scenario(scenario, gantry).log)},
    )


def driven(
    plant: FmuFile, outputs: list[str], parameters: dict[str, float] | None = None
) -> NDArray[np.float64]:
    """Outputs after 0.3 s of constant commands."""
    with FmuSession(plant, parameters=parameters or {}) as session:
        session.set({"u_x": 1.2, "u_z": 1.6})
        for k in range(300):
            session.step(1e-3, time=k * 1e-3)
        return session.get(outputs)


@pytest.mark.usefixtures("unoptimised")
def test_the_augmented_plant_compiles_to_the_fitted_one(gantry: FmuFile, tmp_path: Path) -> None:
    model, fmu = write_augmented(tmp_path, gantry, FITTED, ["presliding/z: probability 0.98"])
    text = model.read_text()
    assert "extends PneuGantry.Gantry(" in text
    assert "// presliding/z: probability 0.98" in text
    assert "valve_z" not in text  # at its nominal value
    built = FmuFile.read(fmu)
    plant = {
        name: value
        for name, value in FITTED.items()
        if not name.startswith(("sensors.", "timing."))
    }
    assert {name: built.variables[name].start for name in plant} == plant
    np.testing.assert_array_equal(
        driven(built, ["x", "z", "f_az"]), driven(gantry, ["x", "z", "f_az"], plant)
    )


@pytest.mark.usefixtures("unoptimised")
def test_a_plant_with_a_modified_array_compiles_to_the_fitted_one(
    gantry: FmuFile, tmp_path: Path
) -> None:
    uneven = {
        "axis_x.friction.position_table[3]": 0.2,
        "axis_x.friction.position_fine[21]": -0.1,
        "axis_x.friction.level": 1.1,
    }
    model, fmu = write_augmented(tmp_path, gantry, uneven)
    text = model.read_text()
    assert "position_table = {0.0, 0.0, 0.2, 0.0" in text
    assert "level = 1.1" in text
    built = FmuFile.read(fmu)
    assert {name: built.variables[name].start for name in uneven} == uneven
    assert built.variables["axis_x.friction.position_table[4]"].start == 0.0
    np.testing.assert_array_equal(
        driven(built, ["x", "z", "v_x"]), driven(gantry, ["x", "z", "v_x"], uneven)
    )


def test_what_is_no_part_of_a_plant_is_said_in_comments(gantry: FmuFile) -> None:
    assert outside_the_plant(FITTED) == ["sensor: f_x.bias = 2", "controller: loop delay of 4 ms"]
    assert "// sensor: f_x.bias = 2" in augmented_model(gantry, FITTED).text()


def test_the_next_experiment_tells_two_plants_apart_and_can_be_run(
    gantry: FmuFile, late: Campaign
) -> None:
    pair = ((("bearing_drag",), {"contact.mu": 0.05}),)
    pair += ((("friction_load/x",), {"axis_x.friction.load": 0.05}),)
    found = next_experiment(TASK, late, gantry, pair)
    assert found is not None
    assert found["separates"] == [["bearing_drag"], ["friction_load/x"]]
    assert found["separation"] > 1.2
    assert json.dumps(found)
    scenario = scenario_from(tomllib.loads(found["scenario"]))
    assert run_scenario(scenario, gantry).outcome == "done"


def test_no_experiment_is_spent_on_what_is_unlikely() -> None:
    point = Point((), np.zeros(0), {})
    nothing = np.zeros((0, 0))
    fit = Fit(Hypothesis(), point, {}, {}, {}, {}, nothing, 1.0, {}, 0.0)
    shares = {("drag",): 0.6, ("unknown",): 0.38, (): 0.01, ("mass",): 0.01}
    answers = tuple(Answer(k, p, None if "unknown" in k else fit) for k, p in shares.items())
    made = Decision("ambiguous", answers, ("drag",), 0.01, 0.38, fit)
    assert [keys for keys, _ in rivals(made)] == [("drag",)]


def told_elsewhere(*args: Any) -> list[Imitation]:
    """As if a run from another place told the way travelled, and nothing told time."""
    scenario = args[2]
    way = 100.0 if scenario.start_x < 0.9 else 5.0
    return [
        Imitation("curve/x", "way travelled", way),
        Imitation("curve/x", "time", 200.0),
    ]


def test_a_curve_is_told_from_the_way_travelled_by_a_run_that_can_be_done(
    gantry: FmuFile, late: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pneugantry.plants.gantry.next_experiment.simulated", lambda *a: a[1])
    monkeypatch.setattr("pneugantry.plants.gantry.next_experiment.expected", told_elsewhere)
    monkeypatch.setattr("pneugantry.plants.gantry.next_experiment.has_curves", lambda fit: True)
    made: Any = SimpleNamespace(
        task=TASK,
        values={},
        decision=SimpleNamespace(best=None),
        excess=SimpleNamespace(level=1.0),
    )
    found = for_a_curve(made, late, gantry, Rules())
    assert found is not None
    assert found["separates"] == [["curve/x"], ["unknown"]]
    assert found["evidence"] == 100.0
    assert found["separation"] == 10.0
    assert "way travelled" in found["what"]
    assert json.dumps(found)
    scenario = scenario_from(tomllib.loads(found["scenario"]))
    assert scenario.start_x < 0.9
    done = run_scenario(scenario, gantry)
    assert done.outcome == "done"
    assert done.log["x"].min() < scenario.start_x - 0.2


@pytest.mark.parametrize(
    ("imitated", "told", "first"),
    [
        (0.4, ("curve", "plants"), "curve"),
        (0.2, ("curve", "plants"), "plants"),
        (0.2, ("curve", None), "curve"),
        (0.4, (None, "plants"), "plants"),
        (0.01, ("curve", None), None),
    ],
)
def test_the_likelier_rival_is_told_first(
    monkeypatch: pytest.MonkeyPatch,
    gantry: FmuFile,
    late: Campaign,
    imitated: float,
    told: tuple[str | None, str | None],
    first: str | None,
) -> None:
    home = "pneugantry.plants.gantry.next_experiment"
    monkeypatch.setattr(f"{home}.for_a_curve", lambda *a: told[0])
    monkeypatch.setattr(f"{home}.next_experiment", lambda *a: told[1])
    monkeypatch.setattr(f"{home}.rivals", lambda d: [(("curve/x",), {}), (("level/x",), {})])
    answers = (SimpleNamespace(keys=("level/x",), probability=0.3),)
    decision = SimpleNamespace(imitated=imitated, answers=answers)
    made: Any = SimpleNamespace(task=TASK, decision=decision)
    assert proposed(made, late, gantry, Rules()) == first


def test_no_experiment_tells_a_plant_from_itself(gantry: FmuFile, late: Campaign) -> None:
    assert next_experiment(TASK, late, gantry, (((), {}), ((), {}))) is None
    assert len(list(candidates(late))) > 10


@pytest.mark.parametrize("cuts", [True, False])
def test_readings_that_were_cut_off_are_taken_in_the_middle_of_their_step(
    late: Campaign, cuts: bool
) -> None:
    run = late.logs["contour_curved"]
    step = 0.02  # m/s
    true = run.log["v_x"]
    coarse = step * np.floor(true / step + (0.0 if cuts else 0.5))
    log = replace(run.log, table=run.log.table.assign(v_x=coarse))
    campaign = Campaign("coarse", Path("c"), {"contour_curved": LoggedRun(run.setup, log)})
    quanta = coarse_channels(campaign)
    assert quanta == {"v_x": pytest.approx(step)}
    (read,) = rounded(campaign, quanta)
    assert abs(np.mean(read.log["v_x"] - true)) < 0.25 * step


@pytest.mark.parametrize("cuts", [True, False])
def test_what_a_log_rounds_of_coarse_readings_its_controller_never_saw(
    late: Campaign, cuts: bool
) -> None:
    """Every reading of one cell is moved alike, and the controller integrates: its commands would
    leave a multiple of their own rounding.
    """
    sent = late.logs["contour_curved"]
    step, digits = 0.2809652, 1e-2  # N
    exact = step * np.floor(sent.log["f_z"] / step + (0.0 if cuts else 0.5))
    rig = replace(sent, log=replace(sent.log, table=sent.log.table.assign(f_z=exact)))
    commands = recomputed_commands(rig, rig.log.measured())
    assert commands is not None
    running = np.isfinite(commands).all(axis=1)
    table = rig.log.table.assign(f_z=digits * np.round(exact / digits))
    for i, channel in enumerate(("u_x", "u_z")):
        table.loc[running, channel] = np.round(commands[running, i], 4)
    stored = replace(rig, log=replace(rig.log, table=table))
    campaign = Campaign("coarse", Path("c"), {"one": stored})
    quanta = coarse_channels(campaign)
    assert quanta["f_z"] == pytest.approx(step, rel=1e-4)
    read = as_read(campaign, quanta)
    left = {}
    for name, own in (("stored", campaign), ("read", read), ("middle", rounded(read, quanta))):
        view = ControllerView(own.logs)
        left[name] = np.std(view.residuals([(record_of("one", stored), {})])[0], axis=0).max()
    assert left["read"] < 0.4 * COMMAND_QUANTUM < left["stored"]
    np.testing.assert_allclose(read.logs["one"].log["f_z"], exact, atol=0.1 * digits)


def test_readings_off_the_grid_stay_as_they_are(late: Campaign) -> None:
    run = late.logs["contour_curved"]
    coarse = 0.02 * np.round(run.log["v_x"] / 0.02)
    coarse[100] += 0.009
    log = replace(run.log, table=run.log.table.assign(v_x=coarse))
    campaign = Campaign("odd", Path("c"), {"one": LoggedRun(run.setup, log)})
    (read,) = as_read(campaign, {"v_x": 0.02})
    np.testing.assert_array_equal(read.log["v_x"], coarse)


def test_commands_miss_what_a_log_of_few_digits_leaves_open(late: Campaign) -> None:
    """The view of the controller takes it for noise; a controller that is late stands out still."""
    sent = late.logs["contour_curved"]
    run = replace(sent, log=replace(sent.log, table=sent.log.table.assign(v_x=sent.log["v_x"])))
    record, off = record_of("one", run), {"v_x": 2e-3}
    plain, wide = ControllerView({"one": run}), ControllerView({"one": run}, off)
    speed = run.log.table.assign(v_x=run.log["v_x"] * (1 + 2e-3))
    moved = ControllerView({"one": replace(run, log=replace(run.log, table=speed))})
    left = [v.residuals([(record, {})])[0] for v in (plain, moved)]
    missed = np.sqrt(np.mean((left[1] - left[0]) ** 2, axis=0))
    assert plain.sigmas == (COMMAND_QUANTUM, COMMAND_QUANTUM)
    assert missed.max() > 2 * COMMAND_QUANTUM
    assert (0.5 * missed < wide.sigmas).all()
    assert (wide.sigmas < 3 * np.hypot(missed, COMMAND_QUANTUM)).all()
    late_by = wide.residuals([(record, {"timing.delay": 0.01})])[0]
    assert np.std(late_by, axis=0).max() > 3 * max(wide.sigmas)
