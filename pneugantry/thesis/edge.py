"""Conclusion 8, the edge of Fig. 4.30: downhill, then uphill in z, for the valves that push one way
only (§4.3.1). The figure's own edge is not printed, so a ladder of uphill angles is run.
"""

from __future__ import annotations

import atexit
import math
import shutil
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from pneugantry.thesis.conclusions import SIGNIFICANT, Conclusion, improvement
from pneugantry.thesis.conditions import Choice, Run
from pneugantry.thesis.leaderboard import PARAMETERS
from pneugantry.thesis.runner import Results
from pneugantry.thesis.scores import Trace

__all__ = [
    "UP_ANGLES",
    "before_stroke_end",
    "ladder_conclusion",
    "ladder_cuts",
    "ladder_runs",
    "steepest_pushed",
    "valve_runs",
]

DOWN = math.radians(15.0)
UP_FIGURE = -25.0  # degrees, of the figure's run: f_n sin(theta) + F_w is beyond F_d + C v
UP_ANGLES = (-5.0, -10.0, -15.0, -20.0, -25.0)  # degrees, of the ladder
JUDGED = -10.0  # degrees: Fig. 3.23 ran it, and the curved edge dips to it
TOLERANCE = {  # of the x axis: what a rig's plant may have instead
    "axis_x.F_w": (2.0, 8.0),  # N, not printed
    "axis_x.friction.F_d": (9.0, 13.0),  # N
    "axis_x.C": (60.0, 90.0),  # N s/m
}
RIDGE, BLEND, LAST = (
    0.83,
    0.06,
    0.67,
)  # m: where theta changes sign, over which length; where the z stroke ends
BIDIRECTIONAL = (("valve_x.bidirectional", 1.0), ("valve_z.bidirectional", 1.0))


def uphill_errors(trace: Trace, run: Run, angle: float, f_nd: float = 30.0) -> tuple[float, float]:
    """RMSE of f_n [N] and v_t [m/s] where the edge is steeper than half of `angle` [degrees, < 0].

    A carriage that stands before the ridge never gets there: then both count over the run's last
    second.
    """
    rows = (trace.theta < 0.5 * math.radians(angle)) & (trace.x > LAST + 0.01)
    if not rows.any():
        rows = trace.time > trace.time[-1] - 1.0
    e_f, e_v = f_nd - trace.f_n[rows], run.v_td - trace.v_t[rows]
    return float(np.sqrt(np.mean(e_f**2))), float(np.sqrt(np.mean(e_v**2)))


@cache
def edge_file(angle: float = UP_FIGURE) -> str:
    """The edge as a table, downhill then `angle` [degrees, < 0] uphill; theta goes from one to the
    other in a straight ramp about the ridge.
    """
    x = np.linspace(LAST, 1.0, 331)
    theta = np.interp(x, [RIDGE - 0.5 * BLEND, RIDGE + 0.5 * BLEND], [math.radians(angle), DOWN])
    z = np.concatenate(
        [[0.0], np.cumsum(0.5 * (np.tan(theta[1:]) + np.tan(theta[:-1])) * np.diff(x))]
    )
    path = Path(_folder()) / f"fig_4_30_{abs(angle):g}.csv"
    lines = [f"{a:.4f},{b:.7f}" for a, b in zip(x, z, strict=True)]
    path.write_text("x,z_w\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


@cache
def _folder() -> str:
    folder = tempfile.mkdtemp(prefix="pneugantry_")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def valve_runs() -> tuple[Run, Run]:
    """One-directional and bidirectional valves on the figure's edge."""
    run = Run(edge_file(), finish="none")
    return run, run.changed(plant=BIDIRECTIONAL)


def ladder_runs(choice: Choice, draw: int) -> dict[float, tuple[Run, Run]]:
    """The pair of runs at each uphill angle; draw 0 is the nominal x axis, others lie within its
    tolerance.
    """
    rng = np.random.default_rng((430, draw))
    drawn = tuple((name, float(rng.uniform(*span))) for name, span in TOLERANCE.items())
    plant = drawn if draw else ()
    pairs = {}
    for angle in UP_ANGLES:
        run = Run(edge_file(angle), finish="none", choice=choice, plant=plant)
        pairs[angle] = (run, run.changed(plant=plant + BIDIRECTIONAL))
    return pairs


def before_stroke_end(trace: Trace) -> Trace:
    """The part that `uphill_errors` scores: beyond it the z piston has no stroke left."""
    rows = trace.x > LAST + 0.01
    return Trace(*(values[rows] for values in trace))


def ladder_cuts(results: Results, pair: tuple[Run, Run], angle: float) -> tuple[float, float]:
    """Shares by which the errors of f_n and of v_t fall when the valves also pull."""
    one, both = (uphill_errors(results.trace(run), run, angle) for run in pair)
    return improvement(one[0], both[0]), improvement(one[1], both[1])


def steepest_pushed(run: Run, f_nd: float = 30.0) -> float:
    """Uphill angle [degrees, < 0] down to which the x valve need not pull at the speed asked for:
    f_n sin(theta) + F_w = F_d + C v.
    """
    plant = PARAMETERS | run.choice.plant() | dict(run.plant)
    friction = plant["axis_x.friction.F_d"] + plant["axis_x.C"] * abs(run.v_td)
    return -math.degrees(math.asin(min((friction - plant["axis_x.F_w"]) / f_nd, 1.0)))


def ladder_conclusion(results: Results, choice: Choice, draw: int) -> Conclusion:
    """Conclusion 8 on one x axis."""
    pairs = ladder_runs(choice, draw)
    cuts = {angle: ladder_cuts(results, pair, angle) for angle, pair in pairs.items()}
    numbers = {f"cut of f_n at {angle:g} deg": f for angle, (f, _) in cuts.items()}
    numbers |= {f"cut of v_t at {angle:g} deg": v for angle, (_, v) in cuts.items()}
    numbers["steepest angle without a pull [deg]"] = steepest_pushed(pairs[JUDGED][0])
    text = "where theta < 0 one-directional valves lose f_n and v_t, bidirectional ones hold them"
    return Conclusion(8, text, min(cuts[JUDGED]) > SIGNIFICANT, numbers)
