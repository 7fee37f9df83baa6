"""Scores of a run over the scored window: errors against the printed set points f_nd and v_td."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.interface import U_MAX, U_MIN
from pneugantry.analysis.metrics import task_frame
from pyfmi_runner.log import PHASES, Log

__all__ = ["Effort", "Scores", "Trace", "effort_log", "score_log", "trace_log"]

Array = NDArray[np.float64]
SMOOTH = 21  # samples, 20 ms
TOUCHING = 2.0  # N


class Scores(NamedTuple):
    """In the order of the tables' columns."""

    me_fn: float  # N
    me_vt: float  # m/s
    rmse_fn: float  # N
    rmse_vt: float  # m/s


class Effort(NamedTuple):
    """What a controller asks of the valves over the scored window, and how it got there."""

    limits_x: float  # share of the samples with u_x at a limit
    limits_z: float  # the same of u_z
    noise_z: float  # V, RMS of u_z about its own mean over 20 ms
    before: float  # N, largest error of f_n in the contact phase, before the scored window
    peak: float  # N, largest f_n over the same stretch
    moving_z: float  # share of the samples with u_z at a limit once the speed is asked for


class Trace(NamedTuple):
    """What the figures draw, every tenth sample of the contact and contouring phases."""

    time: Array  # s, the thesis': the speed is asked for at 22 s
    x: Array  # m
    z: Array  # m
    f_n: Array  # N
    v_t: Array  # m/s
    theta: Array  # rad, of the edge
    u_x: Array  # V
    u_z: Array  # V
    f_az: Array  # N


def score_log(
    log: Log,
    *,
    quiet: float,
    v_td: float,
    f_nd: float,
    skip: float = 0.0,
    motion: float = math.inf,
) -> Scores:
    """Errors over the window that begins `quiet` seconds before the speed is asked for (or `skip`
    seconds after it) and ends with the contouring phase, or `motion` seconds into it.
    """
    contour = log["phase"] == PHASES.index("contour")
    asked = float(log.time[contour][0])
    window = (log.time >= asked - quiet + skip - 1e-9) & (log.time <= asked + motion)
    window &= log["phase"] <= PHASES.index("contour")
    f_n, v_t, _ = task_frame(log)
    e_f, e_v = (f_nd - f_n)[window], (v_td - v_t)[window]
    return Scores(float(np.abs(e_f).max()), float(np.abs(e_v).max()), _rms(e_f), _rms(e_v))


def effort_log(log: Log, *, quiet: float, f_nd: float) -> Effort:
    """The effort of a run; the window is that of `score_log`."""
    contour = log["phase"] == PHASES.index("contour")
    asked = float(log.time[contour][0])
    begin = asked - quiet
    window = (log.time >= begin - 1e-9) & (log["phase"] <= PHASES.index("contour"))
    u_x, u_z = np.asarray(log["u_x"])[window], np.asarray(log["u_z"])[window]
    calm = np.convolve(u_z, np.ones(SMOOTH) / SMOOTH, mode="valid")
    rest = u_z[SMOOTH // 2 :][: len(calm)] - calm
    f_n = task_frame(log).f_n
    touched = np.cumsum(f_n > TOUCHING) > 0
    early = touched & (log["phase"] == PHASES.index("contact")) & ~window
    before = float(np.abs(f_nd - f_n)[early].max()) if early.any() else 0.0
    peak = float(f_n[early].max()) if early.any() else 0.0
    moving = u_z[log.time[window] >= asked - 1e-9]
    return Effort(
        _limit_share(u_x), _limit_share(u_z), _rms(rest), before, peak, _limit_share(moving)
    )


def _limit_share(u: Array) -> float:
    return float(np.mean((u <= U_MIN) | (u >= U_MAX)))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def trace_log(log: Log, shift: float, every: int = 10) -> Trace:
    """The log from the contact phase on, thinned; shift: s, added to its time."""
    task = task_frame(log)
    rows = np.flatnonzero(log["phase"] >= PHASES.index("contact"))[::every]
    columns = (
        log.time + shift,
        log["x"],
        log["z"],
        task.f_n,
        task.v_t,
        log["theta"],
        log["u_x"],
        log["u_z"],
        log["f_az"],
    )
    return Trace(*(np.asarray(column)[rows] for column in columns))
