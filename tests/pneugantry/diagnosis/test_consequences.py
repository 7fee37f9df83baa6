"""What follows from a diagnosis: the augmented plant for other tools, the next experiment, a loop's
delay by trying.
"""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pneugantry.diagnosis.augmented import augmented_model, outside_the_plant, write_augmented
from pneugantry.diagnosis.bench import Bench
from pneugantry.diagnosis.delays import estimate_delays
from pneugantry.diagnosis.next_experiment import candidates, next_experiment
from pneugantry.diagnosis.signals import corrected, sensed_forces, table_of
from pyfmi_runner.build import build_fmu
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
    "sensors.bias_f_x": 2.0,
    "timing.delay": 0.004,
    "valve_z.K": 100.0,
}

SENSOR_ERRORS = {"bias": 1.5, "gain": 0.9, "crosstalk": 0.06, "drift": 0.1, "curve": 0.15}


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
    assert outside_the_plant(FITTED) == ["sensor: bias_f_x = 2", "controller: loop delay of 4 ms"]
    assert "// sensor: bias_f_x = 2" in augmented_model(gantry, FITTED)


def test_the_next_experiment_tells_two_plants_apart_and_can_be_run(
    gantry: FmuFile, late: Campaign
) -> None:
    found = next_experiment(
        late,
        gantry,
        {"contact.mu": 0.05},
        {"axis_x.friction.load": 0.05},
        [["bearing_drag"], ["friction_load/x"]],
    )
    assert found is not None
    assert found["separates"] == [["bearing_drag"], ["friction_load/x"]]
    assert found["separation"] > 1.2
    assert json.dumps(found)
    scenario = scenario_from(tomllib.loads(found["scenario"]))
    assert run_scenario(scenario, gantry).outcome == "done"


def test_no_experiment_tells_a_plant_from_itself(gantry: FmuFile, late: Campaign) -> None:
    assert next_experiment(late, gantry, {}, {}, [[], []]) is None
    assert len(list(candidates(late))) > 10


def test_a_loops_delay_is_found_by_trying(gantry: FmuFile, late: Campaign) -> None:
    with Bench(late, gantry) as bench:
        form = estimate_delays(bench)
        assert form is not None
        (delay,) = form.parameters
        total = delay.starts[0] + form.settings["timing.sense_delay"]
        assert total == pytest.approx(0.007)
        settled = bench.white(
            bench.all["timing"], {"timing.delay": delay.starts[0], **form.settings}
        )
        untouched = bench.white(bench.all["timing"], {})
    assert np.sqrt(np.mean(settled**2)) < 0.05 * np.sqrt(np.mean(untouched**2))


@pytest.mark.parametrize("cuts", [True, False])
def test_readings_that_were_cut_off_are_taken_in_the_middle_of_their_step(
    late: Campaign, cuts: bool
) -> None:
    run = late.logs["contour_curved"]
    step = 0.02  # m/s
    true = run.log["v_x"]
    coarse = step * np.floor(true / step + (0.0 if cuts else 0.5))
    log = replace(run.log, table=run.log.table.assign(v_x=coarse))
    table = table_of(
        Campaign("coarse", Path("coarse"), {"contour_curved": LoggedRun(run.setup, log)})
    )
    assert table.quanta["v_x"] == pytest.approx(step)
    assert abs(np.mean(table.columns["v_x"] - true)) < 0.25 * step


def test_opposite_offsets_of_two_force_channels_do_not_cancel(
    gantry: FmuFile, late: Campaign
) -> None:
    run = late.logs["contour_curved"]
    noise = 0.05 * np.random.default_rng(3).standard_normal((2, len(run.log)))
    free = replace(run.log, table=run.log.table.assign(f_x=noise[0] + 0.1, f_z=noise[1] - 0.1))
    biased = Campaign(
        "biased",
        Path("biased"),
        {"free_motion": LoggedRun(replace(run.setup, workpiece="none"), free)},
    )
    with Bench(biased, gantry) as bench:
        sensors, offsets = bench.all["sensors"], {"sensors.bias_f_x": 0.1, "sensors.bias_f_z": -0.1}
        left, gone = (bench.white(sensors, values) for values in ({}, offsets))
    assert np.mean(gone**2) == pytest.approx(1.0, abs=0.1)
    # two standard deviations on two channels, and five samples folded to one
    assert np.sum(left**2) - np.sum(gone**2) == pytest.approx(2.0**2 * 2 * len(run.log), rel=0.05)


def test_a_force_channels_errors_are_undone(late: Campaign) -> None:
    """Bias, drift, gain, crosstalk and curve of both channels: the inverse of what they do."""
    sensors = {f"sensors.{what}_f_{a}": size for a in "xz" for what, size in SENSOR_ERRORS.items()}
    table = table_of(late)
    true = np.column_stack([table.columns["f_x"], table.columns["f_z"]])
    read = sensed_forces(true, table.columns["time"], sensors)
    force = corrected(
        replace(table, columns={**table.columns, "f_x": read[:, 0], "f_z": read[:, 1]}), sensors
    ).force
    assert np.allclose(np.column_stack([force["x"], force["z"]]), true, atol=1e-3)
