"""The edge of Fig. 4.30: downhill, then uphill in z, for the valves that push one way only (§4.3.1)."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from studies.thesis.conditions import Run
from studies.thesis.scores import Trace

__all__ = ["DOWNHILL", "valve_runs"]

ANGLE = math.radians(20.0)  # of both flanks, Fig. 4.30
RIDGE, BLEND, LAST = 0.78, 0.04, 0.56  # m: where theta changes sign, over which length; where the z stroke ends
BIDIRECTIONAL = (("valve_x.bidirectional", 1.0), ("valve_z.bidirectional", 1.0))


@dataclass(frozen=True)
class Stretch:
    """The part of a run whose edge has theta below a bound."""

    theta: float  # rad

    def errors(self, trace: Trace, run: Run, f_nd: float = 30.0) -> tuple[float, float]:
        """RMSE of f_n [N] and v_t [m/s] there."""
        rows = (trace.theta < self.theta) & (trace.x < RIDGE) & (trace.x > LAST)
        e_f, e_v = f_nd - trace.f_n[rows], run.v_td - trace.v_t[rows]
        return float(np.sqrt(np.mean(e_f**2))), float(np.sqrt(np.mean(e_v**2)))


DOWNHILL = Stretch(-0.5 * ANGLE)


@cache
def edge_file() -> str:
    """The edge as a table; theta goes from +20 to -20 degrees in a straight ramp about the ridge."""
    x = np.linspace(LAST, 1.0, 441)
    theta = ANGLE * np.clip((x - RIDGE) / (0.5 * BLEND), -1.0, 1.0)
    z = np.concatenate([[0.0], np.cumsum(0.5 * (np.tan(theta[1:]) + np.tan(theta[:-1])) * np.diff(x))])
    path = Path(tempfile.gettempdir()) / "pneugantry_fig_4_30.csv"
    lines = [f"{a:.4f},{b:.7f}" for a, b in zip(x, z, strict=True)]
    path.write_text("x,z_w\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


def valve_runs() -> tuple[Run, Run]:
    """One-directional and bidirectional valves on that edge."""
    run = Run(edge_file(), finish="none")
    return run, run.changed(plant=BIDIRECTIONAL)
