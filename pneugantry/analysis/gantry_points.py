"""Operating points of the gantry that the thesis' questions ask for: in contact (sliding, stuck,
without Coulomb friction) and free.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from pneugantry.analysis.operating_point import OperatingPoint, solve
from pyfmi_runner.fmu import FmuFile

__all__ = ["POINTS", "axis_contact", "contact_sliding", "contact_stuck", "free_sliding"]

NO_FRICTION = 1.0  # Types.FrictionLaw.none
OPEN = 1.0  # V, first guess of a command: the valve is open there
CENTRE = {"x": 0.5, "z": 0.05}  # m, mid-stroke, where tau of the x valve is its nominal one
STUCK_PUSH = -15.0  # N
EDGE_X = 0.8  # m, where the inclined edge is tracked
Parameters = Mapping[str, float]


def _value(file: FmuFile, parameters: Parameters, name: str) -> float:
    """A parameter's value, the model's own where it is not given."""
    return float(parameters.get(name, file.variables[name].start or 0.0))


def axis_contact(
    file: FmuFile,
    axis: str = "z",
    angle: float = 0.0,
    f_n: float = 30.0,
    parameters: Parameters | None = None,
) -> OperatingPoint:
    """One axis at rest in contact with f_n [N] on an edge at `angle` [rad], no Coulomb friction,
    the other axis clamped.

    The plant of Fig. 5.6 and 5.7: without Coulomb friction, or while an axis slides one way, the
    friction force is constant and drops out of the linear model. The edge is a plane through the
    FMU's own-profile inputs; at 90 degrees it faces the x axis.
    """
    own = {
        "contact.z_0": CENTRE["z"],
        **(parameters or {}),
        f"axis_{axis}.friction.law": NO_FRICTION,
    }
    other = "x" if axis == "z" else "z"
    inputs = {
        "profile_at": CENTRE["x"],
        "profile_slope": math.tan(angle),
        "profile_height": CENTRE["z"] - own["contact.z_0"],
    }
    inputs |= {f"clamp_{other}": 1.0, f"u_{axis}": OPEN}
    deflection = f_n / _value(file, own, "contact.K_c")
    states = {"axis_x.s": CENTRE["x"], "axis_z.s": CENTRE["z"]}
    states[f"axis_{axis}.s"] += (
        deflection / math.cos(angle) if axis == "z" else -deflection / math.sin(angle)
    )
    guess = OperatingPoint(states, inputs, own)
    wanted = {"contact.f_n": f_n, f"der(axis_{axis}.v)": 0.0, f"der(valve_{axis}.f_a)": 0.0}
    return solve(file, guess, [f"axis_{axis}.s", f"valve_{axis}.f_a", f"u_{axis}"], wanted)


def contact_stuck(
    file: FmuFile, f_n: float = 30.0, parameters: Parameters | None = None
) -> OperatingPoint:
    """Both axes at rest in contact with f_n [N] on a straight edge, held in the stick band.

    On z friction carries nothing; on x it holds STUCK_PUSH newtons, because the x valve can only
    push towards -x and is to stay open.
    """
    own = dict(parameters or {})
    z = _value(file, own, "contact.z_0") + f_n / _value(file, own, "contact.K_c")
    guess = OperatingPoint(
        {"axis_x.s": CENTRE["x"], "axis_z.s": z}, {"u_x": OPEN, "u_z": OPEN}, own
    )
    wanted = {"contact.f_n": f_n, "axis_z.friction.f_net": 0.0, "axis_x.friction.f_net": STUCK_PUSH}
    wanted |= {"der(valve_z.f_a)": 0.0, "der(valve_x.f_a)": 0.0}
    return solve(file, guess, ["axis_z.s", "valve_z.f_a", "u_z", "valve_x.f_a", "u_x"], wanted)


def contact_sliding(
    file: FmuFile,
    f_n: float = 30.0,
    v_t: float = -0.06,
    angle: float = math.radians(16.0),
    parameters: Parameters | None = None,
) -> OperatingPoint:
    """Steady tracking of an inclined edge: f_n [N], v_t [m/s], edge at `angle` [rad]; both axes
    slide where |v| > v_th on each.
    """
    own = {
        "contact.z_0": 0.092,
        "workpiece.shape": 2.0,
        **(parameters or {}),
        "workpiece.incline": angle,
    }
    height = math.tan(angle) * (EDGE_X - _value(file, own, "workpiece.x_0"))
    deflection = f_n / _value(file, own, "contact.K_c") / math.cos(angle)
    states = {"axis_x.s": EDGE_X, "axis_z.s": own["contact.z_0"] + height + deflection}
    states |= {"axis_x.v": v_t * math.cos(angle), "axis_z.v": v_t * math.sin(angle)}
    guess = OperatingPoint(states, {"u_x": OPEN, "u_z": OPEN}, own)
    unknowns = ["axis_z.s", "axis_x.v", "axis_z.v", "valve_x.f_a", "valve_z.f_a", "u_x", "u_z"]
    wanted = {"contact.f_n": f_n, "v_t": v_t, "contact.v_n": 0.0}
    wanted |= {
        f"der({name})": 0.0 for name in ("axis_x.v", "axis_z.v", "valve_x.f_a", "valve_z.f_a")
    }
    return solve(file, guess, unknowns, wanted)


def free_sliding(
    file: FmuFile, v_x: float = -0.06, v_z: float = 0.03, parameters: Parameters | None = None
) -> OperatingPoint:
    """Both axes sliding evenly at v_x, v_z [m/s] clear of the edge."""
    own = {"contact.z_0": 0.092, **(parameters or {})}
    states = {"axis_x.s": CENTRE["x"], "axis_z.s": CENTRE["z"], "axis_x.v": v_x, "axis_z.v": v_z}
    guess = OperatingPoint(states, {"u_x": OPEN, "u_z": OPEN}, own)
    names = ("axis_x.v", "axis_z.v", "valve_x.f_a", "valve_z.f_a")
    return solve(
        file,
        guess,
        ["valve_x.f_a", "valve_z.f_a", "u_x", "u_z"],
        {f"der({name})": 0.0 for name in names},
    )


POINTS: dict[str, Callable[..., OperatingPoint]] = {
    "axis_contact": axis_contact,
    "contact_stuck": contact_stuck,
    "contact_sliding": contact_sliding,
    "free_sliding": free_sliding,
}
