"""Panels of a tracking run: normal force, tangential speed, angle of the edge, and the path."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pneugantry.analysis.plots_thesis import Panel
from pneugantry.thesis.conditions import MOTION_START
from pneugantry.thesis.scores import Trace

__all__ = ["F_ND", "TIME", "V_TD", "close_up", "smooth", "tracking_panels"]

F_ND, V_TD = 30.0, -0.06  # N, m/s
TIME = "time [s]"


def tracking_panels(traces: dict[str, Trace], v_td: float = V_TD) -> list[Panel]:
    """f_n, v_t, theta, and z over x."""
    any_trace = next(iter(traces.values()))
    span = (float(any_trace.time[0]), float(any_trace.time[-1]))
    wanted_v = np.where(any_trace.time >= MOTION_START, v_td, 0.0)
    return [
        Panel(
            TIME,
            "f_n [N]",
            {n: (t.time, t.f_n) for n, t in traces.items()}
            | {"wanted": (np.array(span), np.array([F_ND, F_ND]))},
        ),
        Panel(
            TIME,
            "v_t [m/s]",
            {n: (t.time, t.v_t) for n, t in traces.items()}
            | {"wanted": (any_trace.time, wanted_v)},
        ),
        Panel(TIME, "theta [deg]", {n: (t.time, np.degrees(t.theta)) for n, t in traces.items()}),
        Panel(
            "x [mm]",
            "z [mm]",
            {n: (1e3 * smooth(t.x), 1e3 * smooth(t.z)) for n, t in traces.items()},
        ),
    ]


def close_up(traces: dict[str, Trace], begin: float, end: float) -> Panel:
    """f_n from `begin` to `end` [s]."""
    curves = {}
    for name, trace in traces.items():
        rows = (trace.time >= begin) & (trace.time <= end)
        curves[name] = (trace.time[rows], trace.f_n[rows])
    level = (np.array([begin, end]), np.array([F_ND, F_ND]))
    return Panel(
        TIME, "f_n [N]", {**curves, "wanted": level}, x_range=(begin, end), note="close up"
    )


def smooth(values: NDArray[np.float64], window: int = 15) -> NDArray[np.float64]:
    """Moving mean over `window` samples of 10 ms, the ends held: the noise of the positions, 0.1
    and 0.3 mm, hides the finish.
    """
    padded = np.pad(values, window // 2, mode="edge")
    return np.convolve(padded, np.ones(window) / window, mode="valid")
