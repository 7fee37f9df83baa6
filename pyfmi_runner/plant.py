"""How a set-up becomes parameters and inputs of the gantry FMU, by the model's names."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

from modelica_fmu.errors import InputError

if TYPE_CHECKING:
    from pyfmi_runner.fmu_file import FmuFile
    from pyfmi_runner.workpiece import Profile

__all__ = [
    "CLAMPS",
    "COMMANDS",
    "DEFAULT_CLASS",
    "FINISH",
    "MANUAL",
    "OUTPUTS",
    "PROFILE",
    "SHAPES",
    "TASK",
    "PlantSetup",
    "check_gantry",
    "own_profile",
    "plant_parameters",
]

DEFAULT_CLASS = "PneuGantry.Gantry"
COMMANDS = ("u_x", "u_z")  # V
CLAMPS = ("clamp_x", "clamp_z")
MANUAL = ("f_manual_x", "f_manual_z")  # N
PROFILE = ("profile_at", "profile_height", "profile_slope", "profile_curvature")
OUTPUTS = ("x", "z", "v_x", "v_z", "f_x", "f_z", "f_ax", "f_az")  # in the order of the logs
TASK = ("f_n", "v_t", "theta")
SHAPES = {
    "straight": 1.0,
    "incline_7": 2.0,
    "incline_16": 2.0,
    "incline_30": 2.0,
    "curved": 3.0,
}  # Types.EdgeShape
# Medium surface finish: amplitude m, wave length m, phase rad (docs/explanation/plant.md [A])
FINISH = ((0.20e-3, 0.060, 0.3), (0.08e-3, 0.027, 1.1), (0.03e-3, 0.013, 2.0))


class PlantSetup(Protocol):
    """What a `Scenario` and a `LogSetup` have in common."""

    @property
    def start_x(self) -> float: ...
    @property
    def start_z(self) -> float: ...
    @property
    def workpiece(self) -> str: ...
    @property
    def z_0(self) -> float: ...
    @property
    def surface_finish(self) -> bool: ...


def plant_parameters(setup: PlantSetup) -> dict[str, float]:
    """Parameters of the FMU for a start, a workpiece and its stand-off."""
    parameters = {"axis_x.s_start": setup.start_x, "axis_z.s_start": setup.start_z}
    if setup.workpiece == "none":
        return parameters | {"contact.present": 0.0}
    parameters |= {"contact.z_0": setup.z_0, "workpiece.shape": SHAPES.get(setup.workpiece, 1.0)}
    if setup.workpiece.startswith("incline_"):
        parameters["workpiece.incline"] = math.radians(
            float(setup.workpiece.removeprefix("incline_"))
        )
    if setup.surface_finish and own_profile(setup) is None:
        parameters |= {f"workpiece.A[{i}]": a for i, (a, _, _) in enumerate(FINISH, start=1)}
    return parameters


def own_profile(setup: PlantSetup) -> Profile | None:
    """The user's own edge, which the loop feeds to the FMU as inputs; None for the shapes that the
    model holds.
    """
    if setup.workpiece == "none" or setup.workpiece in SHAPES:
        return None
    from pyfmi_runner.workpiece import workpiece  # takes a second to import

    return workpiece(setup.workpiece, surface_finish=setup.surface_finish)


def check_gantry(fmu: FmuFile) -> None:
    """Raise InputError unless an FMU has the gantry's inputs and outputs."""
    for name in (*COMMANDS, *CLAMPS, *MANUAL, *PROFILE, *OUTPUTS, *TASK):
        if name not in fmu.variables:
            message = f"is the FMU of {fmu.description.model}, which has no such variable"
            raise InputError(
                message,
                file=fmu.path,
                field=name,
                hint=f"give an FMU with the interface of {DEFAULT_CLASS}",
            )
