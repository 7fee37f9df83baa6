"""The servo pendulum: its FMU against another integration, its raw files, planted errors."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from examples.bam.__main__ import RAW, README_LOGS, README_TABLE, REFITTED, main
from examples.bam.convert import (
    EARLIER,
    FULL,
    PARAMETER,
    PLANT,
    Planted,
    aligned,
    planted_errors,
    read_raw,
    write_planted,
)
from examples.bam.planted import COLUMNS, OF_MODEL, accuracy, counted, tally, within
from examples.bam.servo import (
    FIELDS,
    PERIOD,
    RUNGS,
    error,
    log_names,
    positions,
    published,
    refitted,
    setting,
)
from modelica_fmu.errors import InputError
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile, FmuSession

recorded = pytest.mark.skipif(not RAW.is_dir(), reason="../shared/real is not on this machine")
RIGHT = tomllib.loads(REFITTED.read_text())["parameters"]
VALUES = {field: float(RIGHT.get(OF_MODEL.get(field, ""), 0.0)) for field in FIELDS}


def made_up(gain: int, start: float = 0.1) -> pd.DataFrame:
    """A log's goals without a recording: a swing that saturates the duty, and a drop at the end."""
    time = np.arange(400) * PERIOD
    return pd.DataFrame(
        {
            "time": time,
            "position": np.full(400, start),
            "goal_position": 1.2 * np.sin(4.0 * time),
            "torque_enable": (time < 1.7).astype(int),
            "load": np.zeros(400),
            "input_volts": np.full(400, 7.3),
        }
    )


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> FmuFile:
    folder = tmp_path_factory.mktemp("fmu")
    return FmuFile.read(build_fmu("Servo.Plant", PLANT.parent / "Servo.mo", out=folder).path)


@pytest.mark.parametrize("gain", [100, 800])
def test_the_model_moves_as_the_integration_apart_from_it(fmu: FmuFile, gain: int) -> None:
    log = made_up(gain)
    parameters = {**RIGHT, "firmware.kp": float(gain), "q_start": 0.1}
    out = np.empty(len(log))
    with FmuSession(fmu, parameters=parameters) as session:
        for row, (goal, enable) in enumerate(
            zip(log["goal_position"], log["torque_enable"], strict=True)
        ):
            session.set({"goal": float(goal), "enable": float(enable)})
            out[row] = session.get("q")
            session.step(PERIOD)
    apart = out - positions(VALUES, f"made_up_kp{gain}", log, 50)
    assert np.sqrt(np.mean(apart**2)) < 2e-3
    assert np.ptp(out) > 0.5


def test_a_pendulum_without_friction_swings_as_the_closed_form_says() -> None:
    free = {**dict.fromkeys(FIELDS, 0.0), "R": 1.0, "m": 0.49, "l": 0.1, "w_s": 1.0, "alpha": 1.0}
    log = made_up(0, start=0.02).assign(torque_enable=0)
    got = positions(free, "free_kp0", log, 200)
    want = 0.02 * np.cos(np.sqrt(9.80665 / 0.1) * log["time"])
    assert np.abs(got - want).max() < 1e-3


def test_a_refit_finds_the_parameters_that_made_a_log() -> None:
    log = made_up(400)
    log["position"] = positions(VALUES, "made_up_kp400", log, 5)
    start = {**VALUES, "k_t": 0.9 * VALUES["k_t"], "load_motor": 0.2}
    found = refitted(start, ("k_t", "load_motor"), {"made_up_kp400": log})
    assert found["k_t"] == pytest.approx(VALUES["k_t"], rel=1e-3)
    assert found["load_motor"] == pytest.approx(VALUES["load_motor"], rel=1e-2)


def test_the_wrapped_load_is_read_back(tmp_path: Path) -> None:
    log = made_up(100).assign(load=[*[-100 % 65536] * 200, 51679.4, *[70.0] * 199])
    log.to_csv(tmp_path / "sin_sin_kp100.csv", index=False)
    load = read_raw(tmp_path, "sin_sin_kp100")["load"]
    assert set(load) == {-100.0, 70.0}
    assert load.abs().max() <= FULL


def test_24_planted_errors_one_and_two_at_a_time(tmp_path: Path) -> None:
    cases = planted_errors()
    assert len({case.name for case in cases}) == len(cases) == 24
    assert [len(case.factors) for case in cases].count(2) == 10
    raw = tmp_path / "raw"
    raw.mkdir()
    for name in log_names():
        made_up(int(setting(name))).to_csv(raw / f"{name}.csv", index=False)
    folders = write_planted(raw, tmp_path / "out", RIGHT)
    for case, folder in zip(cases, folders, strict=True):
        described = tomllib.loads((folder / "plant.toml").read_text())
        truth = json.loads((folder / "truth.json").read_text())
        assert {c["effect"]: 1 / c["factor"] for c in truth["causes"]} == pytest.approx(
            dict(case.factors)
        )
        for effect, factor in case.factors.items():
            name = PARAMETER[effect]
            assert described["parameters"][name] == pytest.approx(RIGHT[name] * factor)
        assert (folder / described["log"]["sin_sin_kp100"]["file"]).is_file()
        assert (folder / described["plant"]["model"]).is_file()
    assert described["log"]["sin_sin_kp200"]["use"] == "held out"


def test_the_description_says_what_the_right_plant_leaves(tmp_path: Path) -> None:
    raw = tmp_path / "raw"
    raw.mkdir()
    for name in log_names():
        log = made_up(int(setting(name)))
        log["position"] = positions(VALUES, name, log) + 0.02 * np.sin(log["time"] / 0.2)
        log.to_csv(raw / f"{name}.csv", index=False)
    left = accuracy(raw, RIGHT)
    assert left["q"].rms == pytest.approx(0.02 / np.sqrt(2), rel=0.4)  # the arm moves meanwhile
    assert left["q"].lasting == pytest.approx(0.2 * np.arccos(np.exp(-1)), rel=0.4)
    assert left["volts"].rms == pytest.approx(0.1, rel=0.01)
    (folder,) = write_planted(raw, tmp_path / "out", RIGHT, left, [Planted({"mass": 1.2})])
    outputs = tomllib.loads((folder / "plant.toml").read_text())["outputs"]
    assert set(outputs) == {"q", "load", "volts"}
    for name, own in left.items():
        assert (outputs[name]["error"], outputs[name]["lasting"]) == (own.rms, own.lasting)


def test_a_right_description_is_off_by_its_tolerance() -> None:
    tolerance = tomllib.loads(PLANT.read_text())["tolerance"]
    drawn = [within(RIGHT, k) for k in range(200)]
    for name, value in RIGHT.items():
        spread = np.std([np.log(own[name] / value) for own in drawn]) if value else 0.0
        assert spread == pytest.approx(tolerance.get(name, 0.0), rel=0.2)


def test_position_and_duty_of_a_row_are_of_one_instant() -> None:
    log = made_up(100).assign(position=np.arange(400) * PERIOD)
    assert aligned(log)["position"].to_numpy()[:-1] == pytest.approx(log["time"][:-1] + EARLIER)


def answered(verdict: str, **causes: float) -> dict:
    return {
        "verdict": verdict,
        "where": [],
        "causes": [{"effect": k, "axis": "", "probability": p} for k, p in causes.items()],
        "answer_set": [sorted(causes)],
        "gap": None,
        "seconds": 1.0,
    }


def truth_of(*effects: str) -> dict:
    kind = {1: "one", 2: "two"}[len(effects)]
    causes = [{"effect": e, "axis": "", "block": "b", "factor": 0.8} for e in effects]
    return {"kind": kind, "causes": causes}


@pytest.mark.parametrize(
    ("planted", "answer", "counts"),
    [
        (("mass",), answered("identified", mass=0.9), "right named first alike held"),
        (("mass",), answered("unknown", mass=0.9), "named first alike held unknown"),
        (("mass",), answered("identified", arm_length=0.9), "alike wrong"),
        (("mass",), answered("ambiguous", mass=0.6, stribeck=0.6), "first ambiguous"),
        (("mass",), answered("none"), "none"),
        (("mass", "supply_level"), answered("identified", mass=0.9, firmware_gain=0.8),
         "first alike wrong"),
        (("mass", "supply_level"), answered("identified", mass=0.9), "first"),
    ],
)  # fmt: skip
def test_what_counts_as_named(planted: tuple[str, ...], answer: dict, counts: str) -> None:
    row = counted("case", truth_of(*planted), answer)
    assert {name for name, so in row["counts"].items() if so} == set(counts.split())
    group = {1: "one", 2: "two"}[len(planted)]
    table = tally([row, row])
    assert table[group] == table["all"]
    assert {c for c in COLUMNS if table["all"][c] == 2} == set(counts.split())


def test_every_planted_effect_is_in_the_catalogue() -> None:
    for effect, name in PARAMETER.items():
        entry = tomllib.loads((PLANT.parent / "effects" / f"{effect}.toml").read_text())
        assert name in entry["form"][0]["parameters"]


def test_a_missing_log_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InputError, match="no such log"):
        read_raw(tmp_path, "sin_sin_kp100")
    assert main(["convert", "--raw", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@recorded
def test_the_published_rungs_give_the_errors_of_the_readme() -> None:
    for rung, errors in README_TABLE.items():
        values = published(RAW, rung)
        got = [error(values, name, read_raw(RAW, name)) for name in README_LOGS]
        assert got == pytest.approx(list(errors), rel=0.03, abs=0.001), rung


@recorded
def test_the_refitted_rung_halves_what_the_published_one_leaves() -> None:
    logs = {name: read_raw(RAW, name) for name in log_names((200, 800))}
    held = {
        "published": [error(published(RAW, "m6"), name, log) for name, log in logs.items()],
        "refitted": [error(VALUES, name, log) for name, log in logs.items()],
    }
    rms = {key: float(np.sqrt(np.mean(np.square(values)))) for key, values in held.items()}
    assert rms["refitted"] < 0.5 * rms["published"]


@recorded
@pytest.mark.slow
def test_a_refit_of_the_richest_rung_gives_the_stored_parameters() -> None:
    logs = {name: read_raw(RAW, name) for name in log_names((100, 400))}
    found = refitted(published(RAW, "m6"), RUNGS["m6"], logs)
    left = [np.mean([error(v, n, log) for n, log in logs.items()]) for v in (found, VALUES)]
    assert left[0] == pytest.approx(left[1], rel=0.02)
