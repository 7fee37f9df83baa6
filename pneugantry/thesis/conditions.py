"""The conditions of the thesis' runs, and the values that it does not print, chosen once for all
tables (docs/thesis.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from pyfmi_runner.scenario import Scenario, thesis_phases
from pyfmi_runner.sensors import SensorParams

__all__ = ["CHOICE", "DDFM", "NO_FRICTION", "NO_LAG", "Choice", "Finish", "Run", "scenario_of"]

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


@dataclass(frozen=True)
class Run:
    """One run of the study; hashable, so that tables share it."""

    workpiece: str = "straight"
    controller: str = "pi_fv"
    gains: str = ""  # a gain table's name; empty: the controller's own
    finish: str = "measured"  # "modelled", "measured", "none"
    v_td: float = -0.06  # m/s
    noise: bool = True
    plant: tuple[tuple[str, float], ...] = ()  # parameters that differ from the choice's
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
    if run.finish != "none":
        plant |= (choice.modelled if run.finish == "modelled" else choice.measured).parameters()
    start, (printed_start, printed_end) = (
        APPROACH + CONTACT,
        thesis_phases(run.workpiece)["contour"],
    )
    end = start + min(printed_end - printed_start, choice.motion)
    phases = {"approach": (0.0, APPROACH), "contact": (APPROACH, start), "contour": (start, end)}
    sensors = SensorParams(noise=run.noise)
    return Scenario(
        name=f"{run.workpiece} {run.controller}",
        workpiece=run.workpiece,
        surface_finish=run.finish != "none",
        v_td=run.v_td,
        phases=phases,
        plant=plant | dict(run.plant),
        sensors=sensors,
        seed=run.seed,
    )
