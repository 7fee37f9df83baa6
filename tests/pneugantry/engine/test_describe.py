"""Descriptions of plants, from source and of FMUs, and their logs as recorders write them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from modelica_fmu.errors import InputError
from pneugantry.engine.describe import Described, case_of, described, views_of
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.plant import Plant, Record
from pneugantry.engine.signals.records import _column
from pneugantry.engine.signals.tables import conversion, noise_of
from pneugantry.engine.views.foreign import ForeignPlant
from pneugantry.engine.views.synthetic import Nominal
from pyfmi_runner.build import build_fmu
from pyfmi_runner.scenario import Fields

PERIOD = 2e-3
MODEL = 'model = "Toy.mo"\nclass = "Toy.Cart"'
FMU = 'fmu = "cart.fmu"'
BODY = """
[inputs]
u = "voltage"

[outputs.force]
column = "F"
sigma = 0.01
unit = "N"
variable = "f"

[outputs.speed]
column = "V"
sigma = 0.01
unit = "m/s"
variable = "v"

[tolerance]
K = 0.02
m = 0.02

[log.sweep]
file = "sweep.csv"

[log.again]
file = "again.csv"
use = "held out"
"""


@pytest.fixture(scope="module")
def truth(cart: Plant, push: Record, cache: Path) -> dict[str, np.ndarray]:
    record = Nominal(replace(cart, parameters={"K": 2.1}), ["f", "v"], cache).record(push)
    draw = np.random.default_rng(3)
    noise = {n: 0.01 * draw.standard_normal(record.rows) for n in ("F", "V")}
    return {
        "t": PERIOD * np.arange(record.rows),
        "voltage": record.inputs["u"],
        "F": record.signals["force"] + noise["F"],
        "V": record.signals["speed"] + noise["V"],
    }


@pytest.fixture(scope="module")
def fmu(cart: Plant, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_fmu(cart.class_name, cart.model, out=tmp_path_factory.mktemp("fmu")).path


@pytest.fixture
def folder(tmp_path: Path, cart: Plant, fmu: Path, truth: dict[str, np.ndarray]) -> Path:
    (tmp_path / "Toy.mo").write_bytes(cart.model.read_bytes())
    (tmp_path / "cart.fmu").write_bytes(fmu.read_bytes())
    for name in ("sweep", "again"):
        pd.DataFrame(truth).to_csv(tmp_path / f"{name}.csv", index=False)
    return tmp_path


def read(folder: Path, plant: str, cache: Path, body: str = BODY, **given: Any) -> Described:
    more = "\n".join(f"{k} = {v}" for k, v in given.items())
    (folder / "plant.toml").write_text(f"[plant]\n{plant}\n{more}\n{body}", encoding="utf-8")
    return described(folder / "plant.toml", cache)


def test_an_input_may_run_straight_from_row_to_row(folder: Path, cache: Path) -> None:
    """It is interpolated where its log is read at another rate; one that holds is not."""
    straight = BODY.replace('u = "voltage"', 'u = { column = "voltage", between = "straight" }')
    finer = {"time": '"t"', "period": PERIOD / 2}
    held, run = (
        read(folder, MODEL, cache, body, **finer).data.fitted[0] for body in (BODY, straight)
    )
    assert run.straight == {"u"}
    assert not held.straight
    own, mean = run.driving("u")
    np.testing.assert_allclose(mean[:-1], (own[:-1] + own[1:]) / 2)
    assert np.ptp(np.diff(held.inputs["u"])[::2]) == 0.0
    assert np.ptp(np.diff(run.inputs["u"])[::2]) > 0.0
    wrong = straight.replace('"straight"', '"linear"')
    with pytest.raises(InputError, match="between: is 'linear'; write one of held, straight"):
        read(folder, MODEL, cache, wrong, period=PERIOD)


def test_an_input_that_nothing_feeds_is_refused(folder: Path, cache: Path) -> None:
    model = folder / "Toy.mo"
    text = model.read_text(encoding="utf-8")
    assert "input Real u" in text
    more = text.replace("input Real u", "input Real load;\n    input Real u", 1)
    model.write_text(more, encoding="utf-8")
    with pytest.raises(InputError, match=r"inputs\.load: is an input of the model that nothing"):
        read(folder, MODEL, cache, period=PERIOD)


def test_source_and_fmu_are_the_same_plant(folder: Path, cache: Path) -> None:
    """The FMU's view of a signal that alone is measured leaves what the cut leaves."""
    alone = BODY.replace('column = "F"', 'column = "none"')
    cut = read(folder, MODEL, cache, alone, period=PERIOD)
    foreign = read(folder, FMU, cache, alone, period=PERIOD)
    assert isinstance(foreign.plant, ForeignPlant)
    assert (
        [s.name for s in foreign.plant.signals] == [s.name for s in cut.plant.signals] == ["speed"]
    )
    assert "force is taken as not measured" in cut.notes[0]
    residuals = []
    for found in (cut, foreign):
        (view,), notes = views_of(found)
        assert not notes
        assert view.depends_on("K")  # it reaches further than the force that is missing
        record = found.data.fitted[0]
        residuals.append(view.residuals([(record, {}), (record, {"m": 1.1})]))
    assert np.ptp(residuals[0]) > 0.1
    np.testing.assert_allclose(residuals[1], residuals[0], rtol=0, atol=1e-6)
    assert foreign.data.held_out is not None
    assert foreign.data.held_out.name == "again"


def test_a_null_fit_of_an_fmu_comes_to_the_noise(folder: Path, cache: Path) -> None:
    found = read(folder, FMU, cache, period=PERIOD)
    fitter = Fitter(found.plant, views_of(found)[0], found.data.fitted, found.rules)
    try:
        fit = fitter.null()
    finally:
        fitter.close()
    assert fit.values(None)["K"] / fit.values(None)["m"] == pytest.approx(2.1, rel=0.03)
    for (name, _), whiteners in fit.noise.items():
        sigmas = fitter.simulation.views[name].sigmas
        for whitener, sigma in zip(whiteners, sigmas, strict=True):
            assert whitener.sigma == pytest.approx(sigma, rel=0.15)


@pytest.mark.parametrize("rate", [50.0, 1000.0, 10_000.0])
def test_logs_of_other_rates_are_read_at_theirs(
    folder: Path, cache: Path, truth: dict[str, np.ndarray], rate: float
) -> None:
    time = np.arange(round(2 * rate)) / rate
    own = {k: np.interp(time, truth["t"], v) for k, v in truth.items()} | {"t": time}
    for name in ("sweep", "again"):
        pd.DataFrame(own).to_csv(folder / f"{name}.csv", index=False)
    found = read(folder, FMU, cache, time='"t"')
    (record,) = found.data.fitted
    assert record.period == pytest.approx(1 / rate, rel=1e-9)
    assert record.rows == len(time)
    assert not found.notes
    (view,), _ = views_of(found)
    assert view.residuals([(record, {})])[0].shape == (len(time), 2)


def test_uneven_stamps_are_resampled_and_said(
    folder: Path, cache: Path, truth: dict[str, np.ndarray]
) -> None:
    draw = np.random.default_rng(4)
    shaken = truth["t"] + 0.3 * PERIOD * draw.uniform(-1, 1, len(truth["t"]))
    own = {k: np.interp(shaken, truth["t"], v) for k, v in truth.items()}
    pd.DataFrame({**own, "t": 1e3 * shaken}).to_csv(folder / "sweep.csv", index=False)
    even = pd.DataFrame({**truth, "t": 1e3 * truth["t"]})
    even.to_csv(folder / "again.csv", index=False)
    time = '{ column = "t", recorded = "ms" }'
    found = read(folder, FMU, cache, time=time, period=PERIOD).data.fitted[0]
    assert found.period == PERIOD
    said = [n for n in read(folder, FMU, cache, time=time, period=PERIOD).notes if "sweep" in n]
    assert re.search(r"stamps uneven by up to \d+ %: resampled to 500 Hz", said[0])
    first = round((found.rows - len(truth["t"])) / 2)
    at = slice(10, 1900)
    expected = np.interp(PERIOD * np.arange(found.rows) + shaken[0], truth["t"], truth["V"])
    assert first in (0, -1)
    np.testing.assert_allclose(found.signals["speed"][at], expected[at], atol=0.04)


def test_every_log_is_read_by_its_own_stamps(
    folder: Path, cache: Path, truth: dict[str, np.ndarray]
) -> None:
    """Twice as slow as the first, and brought to its rate."""
    stamped = pd.DataFrame(truth).rename(columns={"t": "time"})
    stamped.to_csv(folder / "sweep.csv", index=False)
    stamped[::2].to_csv(folder / "again.csv", index=False)
    found = read(folder, FMU, cache)
    first, second = found.records
    assert first.period == second.period == PERIOD
    assert second.rows == pytest.approx(first.rows, abs=1)
    (said,) = [n for n in found.notes if "again.csv" in n]
    assert "recorded at 250 Hz: resampled to 500 Hz" in said
    odd = second.signals["speed"][1::2]
    np.testing.assert_allclose(odd[:100], truth["V"][1:200:2], rtol=0, atol=0.1)


def test_a_rate_that_nothing_tells_is_one_clear_line(folder: Path, cache: Path) -> None:
    said = r"sweep\.csv: plant\.period: nothing tells how far its rows are apart; write period"
    with pytest.raises(InputError, match=said):
        read(folder, FMU, cache)


@pytest.mark.parametrize("kind", ["parquet", "mat"])
def test_names_units_and_kinds_of_file_follow_the_description(
    folder: Path, cache: Path, truth: dict[str, np.ndarray], kind: str
) -> None:
    raw = {"U_mV": 1e3 * truth["voltage"], "Kraft": truth["F"] / 1e3, "V": truth["V"] - 0.5}
    if kind == "mat":
        savemat(folder / "sweep.mat", {**raw, "setting": 3.0})
    else:
        pd.DataFrame(raw).to_parquet(folder / "sweep.parquet")
    body = (
        BODY.replace('u = "voltage"', 'u = { column = "U_mV", unit = "V", recorded = "mV" }')
        .replace('column = "F"', 'column = "Kraft"\nrecorded = "kN"')
        .replace('column = "V"', 'column = "V"\noffset = 0.5')
        .replace('"sweep.csv"', f'"sweep.{kind}"')
        .split("[log.again]")[0]
    )
    (record,) = read(folder, FMU, cache, body, period=PERIOD).data.fitted
    np.testing.assert_allclose(record.inputs["u"], truth["voltage"], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(record.signals["force"], truth["F"], rtol=1e-12)
    np.testing.assert_allclose(record.signals["speed"], truth["V"], rtol=0, atol=1e-12)


def test_noise_that_is_not_given_is_estimated_and_said(folder: Path, cache: Path) -> None:
    body = BODY.replace('sigma = 0.01\nunit = "N"', 'unit = "N"')
    found = read(folder, FMU, cache, body, period=PERIOD)
    assert found.plant.signals[0].sigma == pytest.approx(0.01, rel=0.1)
    assert "noise of force estimated from the logs" in found.notes[0]


def test_an_encoder_is_seen_said_and_counted(
    folder: Path, cache: Path, truth: dict[str, np.ndarray]
) -> None:
    for name in ("sweep", "again"):
        coarse = {**truth, "V": 0.05 * np.round(truth["V"] / 0.05)}
        pd.DataFrame(coarse).to_csv(folder / f"{name}.csv", index=False)
    found = read(folder, MODEL, cache, period=PERIOD)
    force, speed = found.plant.signals
    assert (force.step, force.sigma) == (0.0, 0.01)
    assert speed.step == pytest.approx(0.05)
    assert speed.sigma == pytest.approx(np.hypot(0.01, 0.05 / np.sqrt(12)))
    assert found.notes[-1] == "speed is read on a grid of 0.05 m/s: its noise counts as 0.0176 m/s"


def test_the_noise_of_a_coarse_converter_is_that_of_its_step() -> None:
    slow = np.round(np.linspace(0, 1, 2000) / 0.01) * 0.01
    assert noise_of([slow]) == pytest.approx(0.01 / np.sqrt(12), rel=1e-6)
    assert noise_of([np.zeros(3)]) == 0.0


@pytest.mark.parametrize(
    ("recorded", "wanted", "scale", "offset"),
    [
        ("mm", "m", 1e-3, 0.0),
        ("rpm", "rad/s", np.pi / 30, 0.0),
        ("km/h", "m/s", 1 / 3.6, 0.0),
        ("mN.m", "N.m", 1e-3, 0.0),
        ("g_0", "m/s2", 9.80665, 0.0),
        ("degC", "K", 1.0, 273.15),
        ("%", "1", 0.01, 0.0),
        ("furlong of the works", "furlong of the works", 1.0, 0.0),
    ],
)
def test_units_of_one_quantity_are_converted(
    recorded: str, wanted: str, scale: float, offset: float
) -> None:
    assert conversion(recorded, wanted) == pytest.approx((scale, offset))


def test_a_scale_is_of_what_was_recorded_not_of_the_unit_s_own_zero() -> None:
    """Tenths of degC: 215 is 21.5 degC."""
    table = {"column": "t", "unit": "K", "recorded": "degC", "scale": 0.1, "offset": 0.5}
    column = _column(Fields(table, tuple(table)), "T")
    assert column.scale * 215 + column.offset == pytest.approx(273.15 + 21.5 + 0.5)


@pytest.mark.parametrize(("recorded", "wanted"), [("mm", "s"), ("V", "1"), ("wibble", "m/s")])
def test_other_units_are_not_known(recorded: str, wanted: str) -> None:
    assert conversion(recorded, wanted) is None


HALF = """
[[fmu]]
file = "cart.fmu"
block = "drive"
outputs = { f = "force" }

[[fmu]]
file = "cart.fmu"
block = "mass"
outputs = { v = "speed" }
"""


def test_several_tables_are_several_views(folder: Path, cache: Path) -> None:
    views, notes = views_of(read(folder, 'name = "two"', cache, HALF + BODY, period=PERIOD))
    assert not notes
    assert {v.signals: v.blocks for v in views} == {("force",): ("drive",), ("speed",): ("mass",)}


def test_what_differs_from_log_to_log_is_a_nuisance_of_each(folder: Path, cache: Path) -> None:
    per_log = BODY + "\n[per_log]\nc = 0.1\n[parameters]\nc = 0.5\n"
    found = read(folder, FMU, cache, per_log, period=PERIOD)
    fitter = Fitter(found.plant, views_of(found)[0], found.records, found.rules)
    try:
        names = {c.name for c in fitter.coordinates.nuisances()}
    finally:
        fitter.close()
    assert {"c@sweep", "c@again", "K", "sensors.force.bias"} <= names


def test_what_is_off_by_nothing_is_known(folder: Path, cache: Path) -> None:
    body = BODY.replace("K = 0.02", "K = 0\nspring = 0") + "\n[per_log]\nc = 0\n"
    found = read(folder, FMU, cache, body, period=PERIOD)
    assert [n.parameter for n in found.plant.nuisances if "." not in n.parameter] == ["m"]
    assert all(n.sigma > 0 for n in found.plant.nuisances)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('u = "voltage"', 'w = "voltage"', r"inputs\.w: no such variable in the model"),
        ('u = "voltage"', 'u = "volts"', r"volts: no such column; did you mean 'voltage'"),
        ("K = 0.02", "k_t = 0.02", r"tolerance\.k_t: no such variable in the model"),
        (
            "m = 0.02",
            "mm = 0.02",
            r"tolerance\.mm: no such variable in the model; did you mean m\?",
        ),
        ("K = 0.02", "K = 2", r"tolerance\.K: is 2, expected 0\.\.1; give a share of the value"),
        ('"V"', '"VV"', r"outputs\.speed: no log has a column 'VV'; did you mean 'V'\?"),
        ("K = 0.02", '"der(f)" = 0.02', r"tolerance\.der\(f\): cannot be set before the start"),
        ('unit = "N"', 'unit = "N"\nrecorded = "mm"', r"recorded: 'mm' is not known in 'N'"),
        ('variable = "f"', 'variable = "thrust"', r"outputs\.force: no such variable"),
        ("sweep.csv", "swep.csv", r"swep\.csv: no such file; did you mean"),
        ("sigma = 0.01", "sigma = 0.0", r"sigma: must be > 0"),
        ("K = 0.02", "spring = 0.02", r"tolerance\.spring: is a share of a value that is 0; write"),
        (
            "K = 0.02",
            '"sensors.force.bias" = 0.1',
            r"tolerance\.sensors\.force\.bias: is a share of a value that is 0",
        ),
        ("[inputs]", "[per_log]\nc = [1]\n[inputs]", r"per_log\.c: is \[1\], expected a number"),
        ("[log.again]", "[per_log]\nc = -0.1\n[log.again]", r"per_log\.c: is -0\.1, expected >= 0"),
    ],
)
def test_what_cannot_be_is_one_clear_line(
    folder: Path, cache: Path, old: str, new: str, said: str
) -> None:
    assert old in BODY
    with pytest.raises(InputError, match=said):
        read(folder, FMU, cache, BODY.replace(old, new, 1), period=PERIOD)


@pytest.mark.parametrize(
    ("rows", "given", "said"),
    [
        (12, {}, r"sweep\.csv: has 12 rows that are judged \(of 12, decimate = 1, skip = 0 s\)"),
        (200, {"decimate": 25}, r"sweep\.csv: has 8 rows .*expected > 12; record a longer log"),
        (200, {"skip": 1.0}, r"sweep\.csv: has 0 rows .*, skip = 1 s"),
    ],
)
def test_a_log_of_which_little_is_left_is_one_clear_line(
    folder: Path, cache: Path, rows: int, given: dict[str, Any], said: str
) -> None:
    table = pd.read_csv(folder / "sweep.csv")
    table[:rows].to_csv(folder / "sweep.csv", index=False)
    with pytest.raises(InputError, match=said):
        read(folder, FMU, cache, period=PERIOD, **given)


@pytest.mark.parametrize("share", [0.0, -1.0, 30.0])
def test_an_effort_that_is_none_is_one_clear_line(folder: Path, cache: Path, share: float) -> None:
    with pytest.raises(InputError, match=r"plant\.effort: is .*, expected 0\.05\.\.20"):
        read(folder, FMU, cache, period=PERIOD, effort=share)


def test_a_search_may_be_given_less_effort(folder: Path, cache: Path) -> None:
    usual, less = (read(folder, FMU, cache, period=PERIOD, effort=k) for k in (1.0, 0.2))
    assert less.rules.effort == pytest.approx(0.2 * usual.rules.effort)
    assert replace(less.rules, effort=usual.rules.effort) == usual.rules


def test_stamps_in_another_unit_are_one_clear_line(
    folder: Path, cache: Path, truth: dict[str, np.ndarray]
) -> None:
    pd.DataFrame({**truth, "t": 1e3 * truth["t"]}).to_csv(folder / "sweep.csv", index=False)
    with pytest.raises(InputError, match=r"time: rows are 2 s apart, the period is 0\.002 s"):
        read(folder, FMU, cache, time='"t"', period=PERIOD)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('f = "force"', 'f = "speed"', r"outputs\.force: is neither made nor read by any FMU"),
        ('u = "voltage"', 'w = "voltage"', r"inputs\.w: is read by no FMU"),
        ('f = "force"', 'thrust = "force"', r"thrust: is no output of the FMU"),
        ('file = "cart.fmu"', 'file = "car.fmu"', r"car\.fmu: no such file"),
    ],
)
def test_tables_that_do_not_fit_are_one_clear_line(
    folder: Path, cache: Path, old: str, new: str, said: str
) -> None:
    assert old in HALF + BODY
    with pytest.raises(InputError, match=said):
        views_of(read(folder, "", cache, (HALF + BODY).replace(old, new, 1), period=PERIOD))


def test_a_plan_refuses_an_fmu(folder: Path, cache: Path) -> None:
    read(folder, FMU, cache, period=PERIOD)
    with pytest.raises(InputError, match="plan needs the Modelica source"):
        case_of(folder / "plant.toml", cache)


def test_what_a_right_model_leaves_is_read(folder: Path, cache: Path) -> None:
    quoted = BODY.replace("sigma = 0.01", "sigma = 0.01\nerror = 0.2\nlasting = 0.3", 1)
    found = read(folder, MODEL, cache, quoted, period=PERIOD)
    force, speed = found.plant.signals
    assert (force.error, force.lasting) == (0.2, 0.3)
    assert speed.error == 0.0
    with pytest.raises(InputError, match="must be > 0 s"):
        read(folder, MODEL, cache, quoted.replace("lasting = 0.3", "lasting = 0"), period=PERIOD)
