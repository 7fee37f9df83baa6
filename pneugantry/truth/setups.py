"""The seven logs of a campaign: what is clamped, where it starts, the command programme, the
references.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import accumulate

import numpy as np

from pneugantry.truth.controller import GAINS
from pneugantry.truth.loop import NEVER

Leg = tuple[float, float, float]  # duration [s], command at its start, at its end [V]
STEP_SECONDS = 1.5


@dataclass(frozen=True)
class Setup:
    """One log. `release`: time at which x, z are let go [s], inf: never. `phases`: name -> (from,
    to) [s], closed loop only. `programme`: legs of u_x and of u_z, repeated until the log ends.
    """

    name: str
    seconds: float
    start: tuple[float, float]
    programme: tuple[tuple[Leg, ...], tuple[Leg, ...]]
    release: tuple[float, float] = (0.0, 0.0)
    workpiece: str = "none"
    standoff: float = 0.0
    loop: str = "open"
    phases: dict[str, tuple[float, float]] = field(default_factory=dict)
    f_nd: float = 30.0  # N
    v_td: float = -0.06  # m/s
    gains: dict[str, float] = field(default_factory=lambda: dict(GAINS))

    @property
    def rows(self) -> int:
        """Samples of the log."""
        return round(1000 * self.seconds)

    @property
    def contact_row(self) -> int:
        """First sample at which the controller acts."""
        return round(1000 * self.phases["contact"][0]) if self.loop == "closed" else NEVER

    def release_rows(self) -> np.ndarray:
        """Sample at which each axis is let go."""
        return np.array(
            [NEVER if np.isinf(t) else round(1000 * t) for t in self.release], dtype=np.int64
        )

    def commands(self) -> np.ndarray:
        """Programmed u_x, u_z [V], shape (rows, 2)."""
        return np.column_stack([programme(legs, self.rows) for legs in self.programme])

    def references(self) -> np.ndarray:
        """f_nd [N] and v_td [m/s], shape (rows, 2)."""
        out = np.zeros((self.rows, 2))
        if self.loop == "closed":
            out[:, 0] = self.f_nd
            out[round(1000 * self.phases["contour"][0]) :, 1] = self.v_td
        return out


def programme(legs: tuple[Leg, ...], rows: int) -> np.ndarray:
    """Samples [V] of a periodic chain of ramps and dwells."""
    ends = list(accumulate(leg[0] for leg in legs))
    time = (np.arange(rows) + 1e-6) / 1000.0 % ends[-1]
    out = np.empty(rows)
    for (duration, first, last), end in zip(legs, ends, strict=True):
        inside = (time >= end - duration) & (time < end)
        out[inside] = first + (last - first) * (time[inside] - (end - duration)) / duration
    return out


def stairs(levels: list[float], seconds: float) -> tuple[Leg, ...]:
    """Equal steps through the levels [V]."""
    return tuple((seconds, level, level) for level in levels)


def _there_and_back(levels: list[float]) -> list[float]:
    return levels + levels[-2::-1]


def _valve_steps(name: str, x: float, z: float) -> Setup:
    u_x = stairs(_there_and_back([0.65, 0.90, 1.15, 1.35]), STEP_SECONDS)
    u_z = stairs(_there_and_back([0.85, 1.10, 1.35, 1.60]), STEP_SECONDS)
    return Setup(name, 10.5, (x, z), (u_x, u_z), (np.inf, np.inf))


def _contour(name: str, workpiece: str, standoff: float) -> Setup:
    approach = ((1.0, 0.0, 0.0),), ((1.0, 1.05, 1.05),)
    phases = {"approach": (0.0, 3.0), "contact": (3.0, 7.0), "contour": (7.0, 16.0)}
    return Setup(
        name, 16.0, (0.95, 0.0), approach, (7.0, 0.0), workpiece, standoff, "closed", phases
    )


def campaign_setups() -> dict[str, Setup]:
    """The seven logs of a campaign by name."""
    ramps_x = ((2.0, 0.635, 0.935), (0.4, 0.935, 0.635), (1.1, 0.635, 0.635))
    ramps_z = ((2.0, 0.735, 1.135), (0.3, 1.135, 0.735), (1.2, 0.735, 0.735))
    levels = [1.05, *_there_and_back([round(0.8 + 0.1 * i, 1) for i in range(9)])]
    pushes = ((1.0, 0.0, 0.0),), stairs(levels, 1.0)
    setups = [
        _valve_steps("valve_steps_1000", 0.95, 0.095),
        _valve_steps("valve_steps_500", 0.5, 0.05),
        _valve_steps("valve_steps_0", 0.05, 0.005),
        Setup("free_motion", 14.0, (0.95, 0.0), (ramps_x, ramps_z)),
        Setup("contact_steps", 18.0, (0.95, 0.0), pushes, (np.inf, 0.0), "straight", 0.04),
        _contour("contour_straight", "straight", 0.04),
        _contour("contour_curved", "curved", 0.09),
    ]
    return {setup.name: setup for setup in setups}
