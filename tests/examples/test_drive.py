"""The drive of the tutorial: its model and its independent simulator agree, its cases are whole."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pneugantry.blind.drive import DESCRIPTION, main, write_drive_case
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.hypotheses.hypothesis import Hypothesis
from pneugantry.engine.run import run
from pneugantry.engine.selection.contenders import distant
from pneugantry.engine.selection.trials import main_forms
from pneugantry.engine.views.synthetic import Nominal
from pneugantry.plants.described import described_task
from pneugantry.truth.drive.case import LOGS, ROWS, DriveSet, commands, draw_drive_case, record
from pneugantry.truth.drive.effects import KNOWN_FORMS, OUTSIDE_FORMS, Drive, DriveSpread
from pneugantry.truth.drive.plant import CHANNELS, PERIOD, SIGMA
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile, FmuSession

HERE = DESCRIPTION.parent
QUIET = np.zeros((ROWS, 3))
PARAMETERS = {  # field of the simulator: parameter of the model
    "resistance": "motor.R",
    "torque_constant": "motor.k_t",
    "motor_coulomb": "motor.T_c",
    "motor_viscous": "motor.d",
    "stiffness": "joint.k",
    "hardening": "joint.k_3",
    "load_inertia": "load.J",
    "load_coulomb": "load.T_c",
    "unbalance": "load.unbalance",
    "gain": "amplifier.gain",
    "lag": "amplifier.lag",
    "delay": "amplifier.delay_time",
    "stribeck": "motor.stribeck",
    "direction": "motor.direction",
}


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> FmuFile:
    built = build_fmu("Drive.Plant", HERE / "Drive.mo", out=tmp_path_factory.mktemp("fmu"))
    return FmuFile.read(built.path)


def replayed(fmu: FmuFile, log: str, parameters: dict[str, float]) -> np.ndarray:
    """The FMU's outputs at each row, shape (ROWS, 3)."""
    out = np.empty((ROWS, 3))
    with FmuSession(fmu, parameters=parameters) as session:
        for row, u in enumerate(commands(log)):
            session.set({"u": u})
            out[row] = [session.get(name) for name in CHANNELS]
            session.step(PERIOD)
    return out


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"stiffness": 1.3, "load_inertia": 1.4e-3, "resistance": 1.5},
        {"hardening": 150.0, "unbalance": 0.02, "lag": 5e-3},
        {"load_coulomb": 0.01, "stribeck": 0.5, "direction": 0.3, "delay": 8e-3},
    ],
    ids=lambda c: "+".join(c) or "nominal",
)
def test_model_and_simulator_agree_below_the_noise(fmu: FmuFile, changed: dict) -> None:
    drive = Drive()
    for name, value in changed.items():
        drive.plant[name] = value
    parameters = {PARAMETERS[name]: value for name, value in changed.items()}
    log = "tones"
    apart = (record(drive, log, QUIET) - replayed(fmu, log, parameters)) / SIGMA
    rms = np.sqrt(np.mean(apart**2, axis=0))
    assert rms[:2].max() < 0.3
    # the angle sums up what a smooth sign differs from a body that stands: 1 in 4000 of the way
    assert rms[2] * SIGMA[2] < 2.5e-4 * np.ptp(record(drive, log, QUIET)[:, 2])


def test_every_known_effect_is_in_the_catalogue_or_a_sensors() -> None:
    catalogue = {path.stem for path in (HERE / "effects").glob("*.toml")}
    assert {form.effect for form in KNOWN_FORMS if not form.channel} == catalogue
    assert not {form.effect for form in OUTSIDE_FORMS} & catalogue


@pytest.mark.parametrize(
    "form", [*KNOWN_FORMS, *OUTSIDE_FORMS], ids=lambda f: f"{f.effect}{f.channel}"
)
def test_an_effect_shows_at_its_largest_size(form) -> None:
    changed, values = form.apply(Drive(), form.high, 3)
    assert list(values) == list(form.fields)
    apart = (record(changed, "swings", QUIET) - record(Drive(), "swings", QUIET)) / SIGMA
    assert np.sqrt(np.mean(apart**2, axis=0)).max() > 1.0


def test_a_case_is_written_with_description_and_truth_and_repeats(tmp_path: Path) -> None:
    out = write_drive_case(tmp_path, 78690)
    truth = json.loads((out / "truth.json").read_text())
    logs, label = draw_drive_case(78690)
    assert truth["kind"] == label["kind"]
    for name in LOGS:
        pd.testing.assert_frame_equal(pd.read_csv(out / f"{name}.csv"), logs[name])
    assert "truth.json" not in (out / "plant.toml").read_text()


def test_a_label_names_what_a_sensor_does_as_a_diagnosis_does() -> None:
    found, _ = described_task(DESCRIPTION)
    own = {k for k, e in found.catalogue.items() if e.outside}
    drawn = DriveSet(mixture={"one": 1.0})
    labels = [draw_drive_case(seed, drawn)[1]["causes"][0] for seed in range(78600, 78620)]
    of_sensors = {c["effect"] for c in labels if c["block"] == "sensors"}
    assert of_sensors
    assert of_sensors <= own


def test_a_drive_without_spread_is_the_nominal_one_under_noise() -> None:
    spread = DriveSpread(0.0, 0.0, 0.0, (1.0, 1.0), 0.0)
    logs, _ = draw_drive_case(78691, DriveSet("exact", {"none": 1.0}, spread))
    apart = (logs["tones"][list(CHANNELS)] - record(Drive(), "tones", QUIET)) / SIGMA
    assert np.std(apart.to_numpy(), axis=0) == pytest.approx(np.ones(3), rel=0.06)


def test_the_stored_data_are_those_of_their_command(tmp_path: Path) -> None:
    stored = json.loads((HERE / "data" / "truth.json").read_text())
    assert main(["--data", str(tmp_path), "--seed", str(stored["seed"])]) == 0
    for name in LOGS:
        again, kept = (pd.read_csv(folder / f"{name}.csv") for folder in (tmp_path, HERE / "data"))
        pd.testing.assert_frame_equal(again, kept)
    assert sum(path.stat().st_size for path in (HERE / "data").iterdir()) < 300_000


def test_an_effect_that_no_slope_shows_is_found_from_the_nominal_plant() -> None:
    """Beside the truth, friction of the load, it is the joint that hardens; tolerance has bent by
    ten spreads to make up for both.
    """
    found, task = described_task(DESCRIPTION)
    fitter = Fitter(task.plant, task.views, task.data.fitted, replace(found.rules, followed=0))
    null = fitter.null()
    forms = main_forms(fitter, list(task.catalogue.values()))
    afar = {f.keys[-1]: f for f in distant(fitter, null, forms, fitter.loud(null))}
    effect = task.catalogue["joint_hardening"]
    near = fitter.explore(Hypothesis().plus(effect, effect.forms[0]), null)
    fitter.close()
    assert afar["joint_hardening"].evidence < near.evidence - 1000
    assert afar["joint_hardening"].values(None)["joint.k_3"] == pytest.approx(73.6, rel=0.1)


@pytest.mark.slow  # 40 s
def test_the_stored_drive_is_told_right() -> None:
    found, task = described_task(DESCRIPTION)
    diagnosis = run(task, found.rules).diagnosis
    truth = json.loads((HERE / "data" / "truth.json").read_text())
    assert diagnosis.verdict == "identified"
    assert set(diagnosis.answer_set[0]) == {c["effect"] for c in truth["causes"]}
    assert diagnosis.gap is not None
    assert diagnosis.gap.augmented < 2


def test_a_scale_that_tolerance_bears_is_found_along_the_valley(tmp_path: Path) -> None:
    """The current sensor reads 14 % too little; ten parameters far off leave hardly more."""
    folder = write_drive_case(tmp_path, 92467)
    read, task = described_task(folder / "plant.toml")
    fitter = Fitter(task.plant, task.views, task.data.fitted, read.rules)
    null = fitter.null()
    effect = task.catalogue["sensor_scale(i)"]
    fit = fitter.again(fitter.explore(null.hypothesis.plus(effect, effect.forms[0]), null))
    fitter.close()
    (cause,) = json.loads((folder / "truth.json").read_text())["causes"]
    (own,) = (c for c in fit.point.coordinates if c.parameter == "sensors.i.scale")
    open_by = fit.sigma(own.name) * own.unit  # the last bits of a processor move it by as much
    assert open_by < 0.03
    assert fit.values(None)[own.parameter] == pytest.approx(
        cause["parameters"]["gain"], abs=3 * open_by
    )
    assert null.evidence - fit.evidence > 60


def test_the_drives_views_are_right_about_its_own_model() -> None:
    """Cut at the current, which moves between its rows, the motor's view left 1.06 noise levels of
    a record of the model itself (decision 0123).
    """
    _, task = described_task(DESCRIPTION)
    (view,) = task.views
    assert view.signals == CHANNELS
    assert view.blocks == ("motor", "motor", "load")
    nominal = Nominal(task.plant, [s.variable for s in task.plant.signals], task.cache)
    for fitted in task.data.fitted:
        own = replace(nominal.record(fitted), name=f"{fitted.name}, nominal")
        left = view.residuals([(own, {})])[0] / np.array(view.sigmas)
        assert np.sqrt(np.mean(left**2, axis=0)).max() < 0.05
