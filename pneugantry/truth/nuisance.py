"""How far an ordinary rig is off, everywhere at once, with nothing wrong: tolerance and nuisances.

Spreads as measured rigs show them: parameters 3 % RMS, u_0 1 %, v_th 5 %, scales of the sensors
0.3 %, force offsets 0.1 N, actuator force offsets 0.3 N, stand-off 0.4 mm off what the campaign
says, noise 0.7 to 1.4 times the quoted, one factor for all channels. Positions are read exactly:
a campaign's start is what the transducers show.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pneugantry.truth.form import Form
from pneugantry.truth.parameters import CHANNELS, Rig, nominal
from pneugantry.truth.tolerance import with_tolerance

SCALED = ("v_x", "v_z", "f_x", "f_z", "f_ax", "f_az")  # channels whose scale is off
CLEAR = 3.5  # an effect is at least this many spreads of the tolerance that looks like it


@dataclass(frozen=True)
class RigDraw:
    """Spreads of a rig without effects; all zero but `parameters`: a rig of the first campaigns."""

    parameters: float = 0.03  # RMS, relative, of every parameter
    dead_point: float = 0.01  # RMS, relative, of u_0
    band: float = 0.05  # RMS, relative, of v_th
    sensor_gain: float = 0.003  # RMS, relative, of speeds and forces
    force_bias: float = 0.1  # RMS [N] of f_x, f_z
    actuator_bias: float = 0.3  # RMS [N] of f_ax, f_az
    standoff: float = 4e-4  # RMS [m], one error for all workpieces of a rig
    noise: tuple[float, float] = (0.7, 1.4)  # times the quoted noise, log-uniform


PLAIN = RigDraw(0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, (1.0, 1.0))
NUISANCE = RigDraw()


@dataclass(frozen=True, eq=False)
class DrawnRig:
    """A rig, how far its stand-off is off what the campaign says [m], and all that was drawn."""

    rig: Rig
    standoff: float
    off: dict[str, float]  # factors; offsets in the channels' units; stand-off [m]


def draw_rig(rng: np.random.Generator, seed: int, draw: RigDraw) -> DrawnRig:
    """Parameters off by draws of `rng`; everything else from a stream of its own, so that the same
    seed has the same parameters and effects with and without nuisances.
    """
    rig, off = with_tolerance(nominal(), rng, draw.parameters)
    if draw == PLAIN:
        return DrawnRig(rig, 0.0, off)
    own = np.random.default_rng([seed, 4])
    for name, spread in (("offset", draw.dead_point), ("band", draw.band)):
        for i, axis in enumerate("xz"):
            off[f"{name}_{axis}"] = 1.0 + spread * float(own.standard_normal())
            rig.axis[name][i] *= off[f"{name}_{axis}"]
    for name in SCALED:
        off[f"scale_{name}"] = 1.0 + draw.sensor_gain * float(own.standard_normal())
        rig.sensor["gain"][CHANNELS.index(name)] *= off[f"scale_{name}"]
    for name in ("f_x", "f_z", "f_ax", "f_az"):
        spread = draw.actuator_bias if name.startswith("f_a") else draw.force_bias
        off[f"bias_{name}"] = spread * float(own.standard_normal())
        rig.sensor["bias"][CHANNELS.index(name)] += off[f"bias_{name}"]
    off["standoff"] = draw.standoff * float(own.standard_normal())
    off["noise"] = float(np.exp(own.uniform(*np.log(draw.noise))))
    rig.sensor["noise"] *= off["noise"]
    return DrawnRig(rig, off["standoff"], off)


def tolerated_size(form: Form, draw: RigDraw) -> float:
    """Size below which an effect would be tolerance: CLEAR spreads of what changes the same
    quantity; 0 where nothing does.
    """
    relative = dict.fromkeys(
        (
            "valve_lag",
            "valve_gain",
            "coulomb_level",
            "viscous_level",
            "payload_mass",
            "contact_stiffness",
        ),
        draw.parameters,
    )
    spreads = {
        **relative,
        "cable_force": 5.0 * draw.parameters,  # N, of F_w = 5 N
        "valve_offset": 0.7 * draw.dead_point,  # V, of u_0 about 0.7 V
        "force_bias": draw.force_bias,
        "force_gain": draw.sensor_gain,
        "pressure_gain": draw.sensor_gain,
        "excess_noise": 2.0 * (draw.noise[1] / draw.noise[0] - 1.0) / CLEAR,
    }
    return CLEAR * spreads.get(form.effect, 0.0)
