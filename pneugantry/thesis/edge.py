"""The edge of Fig. 4.30: downhill, then uphill in z, for the valves that push one way only
(§4.3.1).
"""

from __future__ import annotations

import atexit
import math
import shutil
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from pneugantry.thesis.conditions import Run
from pneugantry.thesis.scores import Trace

__all__ = ["UPHILL", "valve_runs"]

DOWN, UP = (
    math.radians(15.0),
    math.radians(-25.0),
)  # f_n sin(theta) + F_w beyond F_d + C v, 20 degrees: the x valve would have to pull
RIDGE, BLEND, LAST = (
    0.83,
    0.06,
    0.67,
)  # m: where theta changes sign, over which length; where the z stroke ends
BIDIRECTIONAL = (("valve_x.bidirectional", 1.0), ("valve_z.bidirectional", 1.0))


@dataclass(frozen=True)
class Stretch:
    """The part of a run whose edge has theta below a bound."""

    theta: float  # rad

    def errors(self, trace: Trace, run: Run, f_nd: float = 30.0) -> tuple[float, float]:
        """RMSE of f_n [N] and v_t [m/s] there."""
        rows = (trace.theta < self.theta) & (trace.x > LAST + 0.01)
        e_f, e_v = f_nd - trace.f_n[rows], run.v_td - trace.v_t[rows]
        return float(np.sqrt(np.mean(e_f**2))), float(np.sqrt(np.mean(e_v**2)))


UPHILL = Stretch(0.5 * UP)


@cache
def edge_file() -> str:
    """The edge as a table; theta goes from one angle to the other in a straight ramp about the
    ridge.
    """
    x = np.linspace(LAST, 1.0, 331)
    theta = np.interp(x, [RIDGE - 0.5 * BLEND, RIDGE + 0.5 * BLEND], [UP, DOWN])
    z = np.concatenate(
        [[0.0], np.cumsum(0.5 * (np.tan(theta[1:]) + np.tan(theta[:-1])) * np.diff(x))]
    )
    folder = tempfile.mkdtemp(prefix="pneugantry_")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    path = Path(folder) / "fig_4_30.csv"
    lines = [f"{a:.4f},{b:.7f}" for a, b in zip(x, z, strict=True)]
    path.write_text("x,z_w\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


def valve_runs() -> tuple[Run, Run]:
    """One-directional and bidirectional valves on that edge."""
    run = Run(edge_file(), finish="none")
    return run, run.changed(plant=BIDIRECTIONAL)
