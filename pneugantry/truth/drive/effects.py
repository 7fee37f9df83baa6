"""What may be wrong with the drive: effects that its catalogue or every sensor has, and kinds that
no catalogue has.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field

import numpy as np

from pneugantry.truth.drive.plant import CHANNELS, SIGMA, drive_record, sensor_record
from pneugantry.truth.form import either, relative


@dataclass
class Drive:
    """One drive: its numbers and its sensors."""

    plant: np.ndarray = field(default_factory=drive_record)
    sensor: np.ndarray = field(default_factory=sensor_record)

    def copy(self) -> Drive:
        """A drive that shares nothing with this one."""
        return deepcopy(self)


@dataclass(frozen=True)
class DriveForm:
    """One effect. way: how its size acts on `fields`: "factor" (1 + size or its inverse), "add"
    (size times `unit_size`, of either sign), "set" (size), "change" (add of one sign).
    """

    effect: str
    block: str
    low: float
    high: float
    unit: str
    fields: tuple[str, ...]
    way: str = "set"
    channel: str = ""  # of a sensor's effect
    known: bool = True
    regressors: tuple[str, ...] = ()
    formula: str = ""

    def apply(self, drive: Drive, size: float, seed: int) -> tuple[Drive, dict[str, float]]:
        """(a changed copy, the values that the fields got)."""
        out, rng = drive.copy(), np.random.default_rng(seed)
        record = out.plant if not self.channel else out.sensor
        place = 0 if not self.channel else CHANNELS.index(self.channel)
        factor, sense = relative(rng, size), either(rng)
        for name in self.fields:
            if self.way == "factor":
                record[name][place] *= factor
            elif self.way == "add":
                record[name][place] += sense * size
            else:
                record[name][place] = size
        self._beside(record, place, rng)
        return out, {name: float(record[name][place]) for name in self.fields}

    def _beside(self, record: np.ndarray, place: int, rng: np.random.Generator) -> None:
        """Shape parameters that a size alone does not give."""
        spans = {
            "stribeck": ("stribeck_speed", 2.0, 15.0),
            "cogging": ("cogging_count", 4.0, 12.0),
            "heat": ("heat_work", 20.0, 120.0),
            "warm": ("warm_work", 0.5, 6.0),
        }
        for name in self.fields:
            if name in spans:
                beside, low, high = spans[name]
                value = rng.uniform(low, high)
                record[beside][place] = round(value) if name == "cogging" else value


def _known(
    effect: str, block: str, span: tuple[float, float, str], name: str, way: str
) -> DriveForm:
    return DriveForm(effect, block, *span, (name,), way)


def _sensor(
    effect: str, channel: str, span: tuple[float, float, str], name: str, way: str
) -> DriveForm:
    return DriveForm(effect, "sensors", *span, (name,), way, channel)


def _outside(
    effect: str,
    block: str,
    span: tuple[float, float, str],
    name: str,
    *term: str,
    channel: str = "",
) -> DriveForm:
    return DriveForm(effect, block, *span, (name,), "set", channel, False, (term[0],), term[1])


RELATIVE = (0.12, 0.8, "relative")
KNOWN_FORMS = [
    _known("amplifier_gain", "amplifier", (0.12, 0.4, "relative"), "gain", "factor"),
    _known("amplifier_lag", "amplifier", (2e-3, 2e-2, "s"), "lag", "set"),
    _known("amplifier_delay", "amplifier", (2e-3, 2e-2, "s"), "delay", "set"),
    _known("coulomb_level", "motor", RELATIVE, "motor_coulomb", "factor"),
    _known("viscous_level", "motor", (0.3, 3.0, "relative"), "motor_viscous", "factor"),
    _known("stribeck", "motor", (0.15, 1.0, "relative"), "stribeck", "set"),
    _known("friction_direction", "motor", (0.1, 0.5, "relative"), "direction", "add"),
    _known("torque_constant", "motor", (0.12, 0.4, "relative"), "torque_constant", "factor"),
    _known("resistance", "motor", RELATIVE, "resistance", "factor"),
    _known("joint_stiffness", "joint", RELATIVE, "stiffness", "factor"),
    _known("joint_hardening", "joint", (20.0, 400.0, "N m/rad^3"), "hardening", "set"),
    _known("load_inertia", "load", RELATIVE, "load_inertia", "factor"),
    _known("load_friction", "load", (2e-3, 2e-2, "N m"), "load_coulomb", "set"),
    _known("unbalance", "load", (2e-3, 3e-2, "N m"), "unbalance", "set"),
    _sensor("bias", "i", (0.04, 0.5, "A"), "bias", "add"),
    _sensor("scale", "i", (0.03, 0.3, "relative"), "gain", "factor"),
    _sensor("scale", "omega", (0.03, 0.3, "relative"), "gain", "factor"),
    _sensor("delay", "omega", (3e-3, 3e-2, "s"), "lag", "set"),
]
OUTSIDE_FORMS = [
    _outside("dead_zone", "amplifier", (0.3, 2.0, "V"), "dead_zone", "u", "dead zone"),
    _outside("supply_sag", "amplifier", (0.01, 0.1, "1/A"), "sag", "i", "|r|"),
    _outside("cogging", "motor", (3e-3, 2e-2, "N m"), "cogging", "q_m", "sin"),
    _outside("warm_winding", "motor", (0.12, 0.8, "relative"), "heat", "copper_loss", "1-exp(-r)"),
    _outside("warm_friction", "motor", (0.2, 0.7, "fraction"), "warm", "work", "1-exp(-r)"),
    _outside("backlash", "joint", (0.02, 0.3, "rad"), "backlash", "twist", "dead zone"),
    _outside("fan_drag", "load", (1e-6, 2e-5, "N m s^2"), "fan", "omega_l", "r|r|"),
    _outside(
        "tacho_ripple", "sensors", (0.01, 0.1, "relative"), "ripple", "q_m", "sin", channel="omega"
    ),
]
TOLERANT = (
    "resistance",
    "inductance",
    "torque_constant",
    "motor_inertia",
    "motor_viscous",
    "motor_coulomb",
    "stiffness",
    "damping",
    "load_inertia",
    "load_viscous",
)


@dataclass(frozen=True)
class DriveSpread:
    """How far an ordinary drive is off: RMS, relative where no unit is given."""

    parameters: float = 0.03
    sensor_gain: float = 0.003  # of i and omega; the encoder counts
    bias: float = 0.5  # of i and omega, in units of the quoted noise
    noise: tuple[float, float] = (0.7, 1.4)
    colour: float = 0.5  # largest coefficient of the tachometer's noise


def draw_drive(rng: np.random.Generator, spread: DriveSpread) -> tuple[Drive, dict[str, float]]:
    """(a drive without effects, what is off)."""
    drive, off = Drive(), {}
    for name in TOLERANT:
        off[name] = 1.0 + spread.parameters * float(rng.standard_normal())
        drive.plant[name] *= off[name]
    for j, name in enumerate(CHANNELS[:2]):
        off[f"scale_{name}"] = 1.0 + spread.sensor_gain * float(rng.standard_normal())
        off[f"bias_{name}"] = spread.bias * float(SIGMA[j] * rng.standard_normal())
        drive.sensor["gain"][j] *= off[f"scale_{name}"]
        drive.sensor["bias"][j] += off[f"bias_{name}"]
    off["noise"] = float(np.exp(rng.uniform(*np.log(spread.noise))))
    drive.sensor["noise"] *= off["noise"]
    off["colour_omega"] = spread.colour * float(rng.random())
    drive.sensor["colour"][1] = off["colour_omega"]
    return drive, off
