"""The force loop of one axis as in Fig. 5.6 and 5.7, taken from the FMU: valve, piston and contact
spring, command in, force out.

Plant [N/V] from the command u_x or u_z to the force that the axis' own controller regulates (Eq.
3-12, 3-14): f_z on z, -f_x on x, both > 0 in contact, so that a positive gain is negative feedback
on both. At angle 0 (z) and 90 degrees (x) it is K (C_c s + K_c) / ((m s^2 + (C_c + C) s + K_c) (tau
s + 1)); between, the contact's share is cos^2 or sin^2 of the angle. Coulomb friction is left out:
while an axis slides one way it is constant and drops out of the linear model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import control

from modelica_fmu.errors import InputError
from pneugantry.analysis.gantry_points import axis_contact
from pneugantry.analysis.linearise import active_part, linearise, sampled, without_lag
from pneugantry.analysis.operating_point import OperatingPoint
from pyfmi_runner.fmu import FmuFile

__all__ = ["ANGLES", "ForceLoop", "force_loop", "lag_seconds"]

ANGLES = {"x": math.pi / 2, "z": 0.0}  # rad, the edge faces the axis
F_N = 30.0  # N, normal force of the thesis' runs


@dataclass(frozen=True)
class ForceLoop:
    """Open force loop of an axis at an operating point of an FMU."""

    file: FmuFile
    axis: str  # "x" or "z"
    lag: float  # s, of the valve; 0: none
    delay: float  # s, transport delay of the command
    point: OperatingPoint
    plant: control.StateSpace  # command [V] -> force [N], continuous, without the delay

    @property
    def command(self) -> str:
        return f"u_{self.axis}"

    @property
    def sign(self) -> float:
        """Force that the loop regulates / the FMU's output f_x or f_z."""
        return -1.0 if self.axis == "x" else 1.0

    @cached_property
    def valve_gain(self) -> float:
        """K [N/V]: steady actuator force per volt, > 0, from the FMU."""
        valve = f"valve_{self.axis}.f_a"
        full = linearise(self.file, self.point, [self.command], ["f_n"])
        i = full.state_labels.index(valve)
        return abs(float(full.B[i, 0] / full.A[i, i]))

    def sampled(self, period: float = 1e-3) -> control.StateSpace:
        """The plant as the sampled controller sees it: zero-order hold of `period` s, and the
        delay.
        """
        return sampled(self.plant, period, self.delay)


def lag_seconds(
    file: FmuFile, lag: str | float, parameters: Mapping[str, float] | None = None
) -> float:
    """Lag [s] from "none", "x" or "z" (the FMU's tau of that valve) or seconds. Raises InputError
    for anything else.
    """
    if lag == "none":
        return 0.0
    if lag in ("x", "z"):
        name = f"valve_{lag}.tau"
        return float((parameters or {}).get(name, file.variables[name].start or 0.0))
    bounds = file.variables["valve_z.tau"]
    hint = f"use none, x, z or seconds within {bounds.min:g}..{bounds.max:g}"
    try:
        seconds = float(lag)
    except ValueError:
        raise InputError(f"{lag!r} is no lag", field="--lag", hint=hint) from None
    if seconds != 0.0 and not bounds.min <= seconds <= bounds.max:
        raise InputError(f"a lag of {lag} s is out of range", field="--lag", hint=hint)
    return seconds


def force_loop(
    file: FmuFile,
    axis: str = "z",
    lag: str | float = "own",
    *,
    delay: float = 0.0,
    angle: float | None = None,
    parameters: Mapping[str, float] | None = None,
) -> ForceLoop:
    """The loop of `axis` ("x" or "z") with the valve's `lag` ("own", "none", "x", "z" or s), in
    contact with F_N.

    The lag is the FMU's parameter tau; "none" holds the valve's state at its steady value K (u -
    u_0), so that K stays and only the pole goes. delay: s, of the command; angle: rad of the edge,
    facing the axis if None.
    """
    seconds = lag_seconds(file, axis if lag == "own" else lag, parameters)
    own = dict(parameters or {})
    if seconds > 0:
        own[f"valve_{axis}.tau"] = seconds
    point = axis_contact(file, axis, ANGLES[axis] if angle is None else angle, F_N, own)
    command, force = f"u_{axis}", f"f_{axis}"
    full = linearise(file, point, [command], [force])
    if seconds == 0:
        full = without_lag(full, f"valve_{axis}.f_a")
    plant = active_part(full, [command], [force])
    if axis == "x":
        labels = {"states": plant.state_labels, "inputs": [command], "outputs": ["-f_x"]}
        plant = control.StateSpace(
            plant.A, plant.B, -plant.C, -plant.D, **labels, remove_useless_states=False
        )
    return ForceLoop(file, axis, seconds, delay, point, plant)
