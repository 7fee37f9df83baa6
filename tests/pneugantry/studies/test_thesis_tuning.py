"""The tuning series and angles, short."""

import math

import numpy as np
import pytest

from controllers.gains import TABLE_3_5, PidGains
from pneugantry.thesis.axis_loops import AxisLoop, drive_loops
from pneugantry.thesis.conditions import CHOICE
from pneugantry.thesis.plant_tests import Hysteresis
from pneugantry.thesis.tuning import (
    HOLD,
    PLANTS,
    SERIES,
    STEP,
    Response,
    Series,
    Tuning,
    step_response,
    tracks,
)
from pneugantry.thesis.tuning_report import draw_tuning, tuning_lines, tuning_report
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile


@pytest.fixture(scope="module")
def fmu() -> FmuFile:
    return FmuFile.read(build_fmu().path)


@pytest.fixture(scope="module")
def force_series(fmu) -> dict[float, Response]:
    """Fig. E.4 by K_p."""
    series = next(s for s in SERIES if s.figure == "E.4")._replace(seconds=3.0)
    return {
        g.k_p: Response(series, g, 1.0, step_response(fmu, series, g, 1.0)) for g in series.gains
    }


def test_series_hold_the_gains_that_the_thesis_kept():
    for series in SERIES:
        if series.judged:
            kept = getattr(TABLE_3_5, series.loop)
            assert series.gains[0][:2] == kept[:2]
            assert len(set(series.gains)) == 3
    assert [s.gains[0].k_d for s in SERIES if s.figure == "E.13"] == [0.05]


def test_more_gain_on_the_z_force_is_faster_and_overshoots(force_series):
    """What Fig. E.4 was judged by."""
    low, kept, high = (force_series[k] for k in (0.04, 0.08, 0.16))
    assert high.rise < kept.rise < low.rise
    assert high.overshoot > kept.overshoot + 0.2
    assert not any(r.beats(kept) for r in (low, high))


def test_a_loop_that_is_off_or_absent_commands_nothing(fmu):
    loop = AxisLoop("f_z", PidGains(0.08, 0.1), 10.0, start=0.2)
    run = drive_loops(fmu, CHOICE.plant() | PLANTS["f_z"], [loop], 0.4, "x")
    assert (run.of("u_x") == 0.0).all()
    assert (run.of("u_z")[:200] == 0.0).all()
    assert (run.of("u_z")[200:] > 0.0).all()
    assert np.ptp(run.of("x")) < 5e-3  # clamped: what moves is noise


def test_a_rival_must_be_clearly_faster_and_calmer(force_series):
    kept = force_series[0.08]
    assert not kept.beats(kept)
    assert not force_series[0.16].beats(kept)  # faster alone


def test_a_response_that_never_arrives_has_no_rise(force_series):
    kept = force_series[0.08]
    assert math.isinf(Response(kept.series, kept.gains, 10.0, kept.run).rise)
    assert Response(kept.series, kept.gains, 10.0, kept.run).overshoot == 0.0


def test_an_edge_nearly_upright_is_followed_upwards(fmu):
    (track,) = tracks(fmu, ["3.24"])
    assert track.rmse(moving=False) < 0.5
    assert track.rmse() > 2.0  # "the performance degrades as theta increases", §3.5.2
    z = track.run.of("z")
    assert z[-1] - z[round(1e3 * HOLD)] > 0.02


def test_report_names_what_beats_the_kept_gains(force_series, tmp_path, fmu, monkeypatch):
    series = Series("E.4", "f_z", tuple(PidGains(k, 0.1) for k in force_series), 10.0, 3.0)
    responses = [
        Response(series, r.gains, scale, r.run)
        for scale in (1.0, 0.5, 2.0)
        for r in force_series.values()
    ]
    monkeypatch.setattr("pneugantry.thesis.tuning_report.SERIES", (series,))
    monkeypatch.setattr("pneugantry.thesis.tuning_report.TRACKS", ())
    flat = np.zeros(4)
    tuning = Tuning(responses, [], Hysteresis(flat, flat, flat, flat, flat + 2.0, flat, flat))
    report = tuning_report(tuning)
    assert report["beaten"] == {"E.4": 0}
    assert [r["kept"] for r in report["responses"]] == [True, False, False] * 3
    assert any("faster and calmer than the kept: 10 N: none" in s for s in tuning_lines(tuning))
    assert all(path.stat().st_size > 10_000 for path in draw_tuning(tuning, tmp_path))
    assert STEP < 1.0
