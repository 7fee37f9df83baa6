"""Scores of a run over the scored window: errors against the printed set points f_nd and v_td."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.metrics import task_frame
from pyfmi_runner.log import PHASES, Log

__all__ = ["Scores", "Trace", "score_log", "trace_log"]

Array = NDArray[np.float64]


class Scores(NamedTuple):
    """In the order of the tables' columns."""

    me_fn: float  # N
    me_vt: float  # m/s
    rmse_fn: float  # N
    rmse_vt: float  # m/s


class Trace(NamedTuple):
    """What the figures draw, every tenth sample of the contact and contouring phases."""

    time: Array  # s
    x: Array  # m
    z: Array  # m
    f_n: Array  # N
    v_t: Array  # m/s
    theta: Array  # rad, of the edge
    u_x: Array  # V
    u_z: Array  # V
    f_az: Array  # N


def score_log(log: Log, *, quiet: float, v_td: float, f_nd: float, true_angle: bool = False) -> Scores:
    """Errors over the window that begins `quiet` seconds before the speed is asked for and ends with the contouring phase.

    true_angle: the forces as they are and the speed along the edge's own angle, where the controller's angle is wrong.
    """
    contour = log["phase"] == PHASES.index("contour")
    begin = float(log.time[contour][0]) - quiet
    window = (log.time >= begin - 1e-9) & (log["phase"] <= PHASES.index("contour"))
    f_n, v_t, _ = task_frame(log)
    if true_angle:
        f_n = np.hypot(log["f_x"], log["f_z"])
        v_t = log["v_x"] * np.cos(log["theta"]) + log["v_z"] * np.sin(log["theta"])
    e_f, e_v = (f_nd - f_n)[window], (v_td - v_t)[window]
    return Scores(float(np.abs(e_f).max()), float(np.abs(e_v).max()), _rms(e_f), _rms(e_v))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def trace_log(log: Log, every: int = 10) -> Trace:
    """The log from the contact phase on, thinned."""
    task = task_frame(log)
    rows = np.flatnonzero(log["phase"] >= PHASES.index("contact"))[::every]
    columns = (log.time, log["x"], log["z"], task.f_n, task.v_t, log["theta"], log["u_x"], log["u_z"], log["f_az"])
    return Trace(*(np.asarray(column)[rows] for column in columns))
