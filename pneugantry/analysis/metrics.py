"""How well a run tracks: RMSE (Eq.

3-2) and maximum error of f_n and v_t over the contouring phase.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modelica_fmu.errors import InputError
from pyfmi_runner.log import PHASES, Log

__all__ = ["Metrics", "Task", "task_frame", "tracking_metrics"]

Array = NDArray[np.float64]
F_CONTACT = 2.0  # N, below it the edge's angle is not estimated (docs/explanation/plant.md)


class Task(NamedTuple):
    """Measured signals in the task frame; shape (N,) each."""

    f_n: Array  # N, > 0 presses into the workpiece
    v_t: Array  # m/s, < 0 tracks towards -x
    theta: Array  # rad, estimated from the measured forces


class Metrics(NamedTuple):
    """Over the contouring phase."""

    rmse_fn: float  # N
    me_fn: float  # N, largest absolute error
    rmse_vt: float  # m/s
    me_vt: float  # m/s, largest absolute error


def task_frame(log: Log) -> Task:
    """Eq. 3-7 to 3-9 on the measured signals: theta = atan2(-f_x, f_z), 0 without contact."""
    f_x, f_z = log["f_x"], log["f_z"]
    theta = np.where(np.hypot(f_x, f_z) < F_CONTACT, 0.0, np.arctan2(-f_x, f_z))
    return Task(
        -f_x * np.sin(theta) + f_z * np.cos(theta),
        log["v_x"] * np.cos(theta) + log["v_z"] * np.sin(theta),
        theta,
    )


def tracking_metrics(log: Log) -> Metrics:
    """RMSE and ME over the rows whose phase is contour. Raises InputError where the log has no
    references or no such phase.
    """
    for column in ("phase", "f_nd", "v_td"):
        if column not in log:
            raise InputError(
                "column is missing",
                file=log.name,
                field=column,
                hint="give a closed-loop log with references and phase",
            )
    rows = log["phase"] == PHASES.index("contour")
    if not rows.any():
        raise InputError(
            "has no contouring phase",
            file=log.name,
            field="phase",
            hint="run past the contact phase",
        )
    task = task_frame(log)
    e_f = (log["f_nd"] - task.f_n)[rows]
    e_v = (log["v_td"] - task.v_t)[rows]
    return Metrics(_rms(e_f), float(np.abs(e_f).max()), _rms(e_v), float(np.abs(e_v).max()))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
