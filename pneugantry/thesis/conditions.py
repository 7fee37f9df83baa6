"""The conditions of the thesis' runs, and the values that it does not print, chosen once for all
tables (docs/results/thesis.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from pneugantry.thesis.random_finish import edge_with_finish
from pyfmi_runner.scenario import Scenario, thesis_phases
from pyfmi_runner.sensors import SensorParams
from pyfmi_runner.timing import LoopTiming
from pyfmi_runner.workpiece import STANDOFF

__all__ = [
    "CHOICE",
    "DDFM",
    "NO_FRICTION",
    "NO_LAG",
    "SOFT",
    "Choice",
    "Finish",
    "Run",
    "scenario_of",
]

NONE, VDFM, DDFM = 1.0, 2.0, 3.0  # Types.FrictionLaw
NO_LAG = (("valve_x.tau", 1e-3), ("valve_z.tau", 1e-3))  # s, the model's smallest
NO_FRICTION = (("axis_x.friction.law", NONE), ("axis_z.friction.law", NONE))
APPROACH, CONTACT = (
    3.0,
    4.5,
)  # s: as long as the open-loop approach and the settling need; the thesis prints neither
MOTION_START = 22.0  # s, when the thesis asks for the speed: the figures' time
TIME_SHIFT = MOTION_START - APPROACH - CONTACT  # s


class Finish(NamedTuple):
    """Surface finish: a sum of three waves of the edge's height."""

    amplitude: tuple[float, float, float]  # m
    length: tuple[float, float, float]  # m
    phase: tuple[float, float, float]  # rad

    @property
    def largest_angle(self) -> float:
        """Bound of |theta| [rad]."""
        return math.atan(
            sum(2 * math.pi * a / w for a, w in zip(self.amplitude, self.length, strict=True))
        )

    def slid(self, distance: float) -> Finish:
        """The same waves, moved by `distance` [m] towards -x."""
        turns = (2 * math.pi * distance / w for w in self.length)
        moved = (math.remainder(p + t, 2 * math.pi) for p, t in zip(self.phase, turns, strict=True))
        return self._replace(phase=tuple(moved))  # type: ignore[arg-type]

    def parameters(self) -> dict[str, float]:
        """Parameters of the FMU."""
        named = (("A", self.amplitude), ("lambda", self.length), ("phi", self.phase))
        return {
            f"workpiece.{name}[{i}]": value
            for name, values in named
            for i, value in enumerate(values, start=1)
        }


MODELLED = Finish(
    (43.7e-6, 1.9e-6, 323.7e-6), (0.0658, 0.0037, 0.0452), (1.61, 2.73, -1.11)
)  # artificial theta, §4.1.5
MEASURED = Finish(
    (0.0e-6, 5.4e-6, 212.4e-6), (0.0088, 0.0030, 0.0324), (-3.14, 2.17, -2.50)
)  # experimental theta, §4.2.5


@dataclass(frozen=True)
class Choice:
    """The values that the thesis does not print. `quiet` is the stretch of the scored window before
    the speed is asked for.
    """

    contact_stiffness: float = 5.0e4  # N/m
    contact_damping: float = 150.0  # N s/m
    ddfm_limit: float = 14.0  # N, beta
    ddfm_stiffness: float = 1e5  # N/m, sigma
    cable_x: float = 5.0  # N
    cable_z: float = 5.0  # N
    quiet: float = 3.32  # s
    motion: float = 6.50  # s, or what the z stroke allows
    modelled: Finish = MODELLED
    measured: Finish = MEASURED

    def plant(self) -> dict[str, float]:
        """Parameters of the FMU: DDFM on z, VDFM on x."""
        return {
            "contact.K_c": self.contact_stiffness,
            "contact.C_c": self.contact_damping,
            "axis_z.friction.law": DDFM,
            "axis_x.friction.law": VDFM,
            "axis_z.friction.beta": self.ddfm_limit,
            "axis_z.friction.sigma": self.ddfm_stiffness,
            "axis_x.F_w": self.cable_x,
            "axis_z.F_w": self.cable_z,
        }


CHOICE = Choice()
# K_c and C_c of Fig. 5.7's poles and zero, beta as in `docs/explanation/plant.md`
SOFT = Choice(contact_stiffness=1.0e4, contact_damping=30.0, ddfm_limit=12.0)


@dataclass(frozen=True)
class Run:
    """One run of the study; hashable, so that tables share it."""

    workpiece: str = "straight"
    controller: str = "pi_fv"
    gains: str = ""  # a gain table's name; empty: the controller's own
    options: tuple[tuple[str, Any], ...] = ()  # further options of the controller
    finish: str = "measured"  # "modelled", "measured" (waves), "random" (§4.1.5), "none"
    draw: int = 0  # of the random finish
    slide: float = 0.0  # m, by which the waves are moved along x
    v_td: float = -0.06  # m/s
    noise: bool = True
    plant: tuple[tuple[str, float], ...] = ()  # parameters that differ from the choice's
    sensors: tuple[tuple[str, Any], ...] = ()  # fields of SensorParams that differ
    delay: float = 0.0  # s, from sample to action
    angle_error: float = 0.0  # rad, of the theta that PI FV works with
    seed: int = 0
    choice: Choice = field(default=CHOICE, repr=False)

    def changed(self, **changes: object) -> Run:
        return replace(self, **changes)  # type: ignore[arg-type]


def scenario_of(run: Run) -> Scenario:
    """The scenario up to the end of the contouring phase, with short phases before it; the retreat
    is never scored and left out.
    """
    choice = run.choice
    plant = choice.plant()
    waves = {"modelled": choice.modelled, "measured": choice.measured}.get(run.finish)
    if waves is not None:
        plant |= waves.slid(run.slide).parameters()
    start, (printed_start, printed_end) = (
        APPROACH + CONTACT,
        thesis_phases(run.workpiece)["contour"],
    )
    end = start + min(printed_end - printed_start, choice.motion)
    phases = {"approach": (0.0, APPROACH), "contact": (APPROACH, start), "contour": (start, end)}
    sensors = SensorParams(noise=run.noise)._replace(**dict(run.sensors))
    return Scenario(
        name=f"{run.workpiece} {run.controller}",
        workpiece=_edge(run),
        standoff=STANDOFF.get(run.workpiece),
        surface_finish=waves is not None,
        v_td=run.v_td,
        phases=phases,
        plant=plant | dict(run.plant),
        sensors=sensors,
        timing=LoopTiming(delay=run.delay),
        seed=run.seed,
    )


def _edge(run: Run) -> str:
    """The workpiece's name, or the table of a named one with the random finish."""
    if run.finish != "random":
        return run.workpiece
    return edge_with_finish(run.workpiece, run.draw)
