"""Scores of a run against figures worked out by hand."""

import math

import numpy as np
import pandas as pd
import pytest

from modelica_fmu.errors import InputError
from pneugantry.analysis.metrics import task_frame, tracking_metrics
from pyfmi_runner.log import MEASURED, Log


def log_of(**columns: list[float]) -> Log:
    """A log whose other channels are 0."""
    n = len(next(iter(columns.values())))
    table = pd.DataFrame(
        {
            name: np.zeros(n)
            for name in ("time", "u_x", "u_z", *MEASURED, "f_nd", "v_td", "theta", "phase")
        }
    )
    for name, values in columns.items():
        table[name] = np.asarray(values, dtype=float)
    return Log(table)


def test_the_task_frame_turns_forces_and_speeds_by_the_edges_angle() -> None:
    """30 N on a 3-4-5 edge: sin = 0.6, cos = 0.8; Eq. 3-7 to 3-9."""
    task = task_frame(log_of(f_x=[-18.0], f_z=[24.0], v_x=[-0.05], v_z=[0.01]))
    assert task.theta[0] == pytest.approx(math.atan2(0.6, 0.8))
    assert task.f_n[0] == pytest.approx(30.0)
    assert task.v_t[0] == pytest.approx(-0.05 * 0.8 + 0.01 * 0.6)


def test_without_contact_the_angle_is_zero() -> None:
    """Below 2 N: a force of (-1.0, 1.0) N has 1.41 N."""
    task = task_frame(log_of(f_x=[-1.0, -1.5], f_z=[1.0, 1.5], v_x=[0.3, 0.3], v_z=[0.1, 0.1]))
    assert task.theta.tolist() == [0.0, pytest.approx(math.pi / 4)]
    assert task.f_n.tolist() == [1.0, pytest.approx(math.hypot(1.5, 1.5))]
    assert task.v_t.tolist() == [0.3, pytest.approx(0.4 / math.sqrt(2))]


def test_scores_are_taken_over_the_contouring_phase_alone() -> None:
    """Errors of f_n: +3, -4 N, of v_t: 0.01, -0.02 m/s; what the other phases do does not count."""
    log = log_of(
        f_z=[500.0, 27.0, 34.0, 500.0],
        f_nd=[30.0] * 4,
        v_x=[9.0, -0.07, -0.04, 9.0],
        v_td=[-0.06] * 4,
        phase=[1.0, 2.0, 2.0, 3.0],
    )
    scores = tracking_metrics(log)
    assert scores.rmse_fn == pytest.approx(math.sqrt((9 + 16) / 2))
    assert scores.me_fn == pytest.approx(4.0)
    assert scores.rmse_vt == pytest.approx(math.sqrt((1e-4 + 4e-4) / 2))
    assert scores.me_vt == pytest.approx(0.02)


def test_a_log_without_references_or_contouring_is_refused() -> None:
    log = log_of(phase=[0.0, 1.0])
    with pytest.raises(
        InputError, match="phase: has no contouring phase; run past the contact phase"
    ):
        tracking_metrics(log)
    with pytest.raises(InputError, match="f_nd: column is missing; give a closed-loop log"):
        tracking_metrics(Log(log.table.drop(columns="f_nd")))
