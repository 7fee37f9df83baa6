"""The drive as a stick-slip system, compiled: amplifier, motor, elastic joint, load, three sensors.

L di/dt = v - R i - k_t w_m;  J_m dw_m/dt = k_t i - d_m w_m - T_f - t_j;
J_l dw_l/dt = t_j - d_l w_l - T_l;  t_j = k (q_m - q_l) + c (w_m - w_l).
Coulomb friction holds a body that stands as long as it can (stuck flags, no smoothing); Runge-Kutta
of order 4 at 50 us, so that position is converged to half a sigma after 80 rad.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from pneugantry.truth.kept import kept

Record = Any
CHANNELS = ("i", "omega", "q")
SIGMA = np.array([0.02, 0.3, 2e-3])  # A, rad/s, rad; RMS, quoted
ROUNDING = np.array([5e-3, 0.05, 5e-4])  # grid of a logged channel, about sigma / 5
PERIOD = 2e-3  # s
SUBSTEPS = 40  # of a period
LAGS = 64  # periods of command that the amplifier remembers

_FIELDS = [  # name, nominal, meaning [unit]
    ("resistance", 1.2, "R of the winding [ohm]"),
    ("inductance", 2.5e-3, "L of the winding [H]"),
    ("torque_constant", 0.06, "k_t [N m/A], also of the back EMF [V s]"),
    ("motor_inertia", 2.0e-4, "J_m [kg m^2]"),
    ("motor_viscous", 3.0e-4, "d_m [N m s]"),
    ("motor_coulomb", 0.015, "T_c [N m]"),
    ("stiffness", 2.0, "k of the joint [N m/rad]"),
    ("damping", 2.0e-3, "c of the joint [N m s]"),
    ("load_inertia", 1.0e-3, "J_l [kg m^2]"),
    ("load_viscous", 2.0e-4, "d_l [N m s]"),
    # effects, neutral here
    ("gain", 1.0, "scale of the amplifier"),
    ("lag", 0.0, "lag of the amplifier [s]"),
    ("delay", 0.0, "delay of the amplifier [s]"),
    ("stribeck", 0.0, "share by which Coulomb friction is higher at rest"),
    ("stribeck_speed", 5.0, "speed at which that share is a third [rad/s]"),
    ("direction", 0.0, "share by which Coulomb friction is higher for w > 0, lower for w < 0"),
    ("hardening", 0.0, "cubic stiffness of the joint [N m/rad^3]"),
    ("load_coulomb", 0.0, "Coulomb friction of the load [N m]"),
    ("unbalance", 0.0, "m g r of the load [N m], 0 hangs down"),
    # unknown to any catalogue
    ("dead_zone", 0.0, "command around 0 that the amplifier does not pass, width [V]"),
    ("sag", 0.0, "share of the voltage lost per ampere drawn [1/A]"),
    ("cogging", 0.0, "amplitude of a torque that repeats with the rotor [N m]"),
    ("cogging_count", 7.0, "how often it does in a turn"),
    ("heat", 0.0, "growth of R when the winding is warm"),
    ("heat_work", 100.0, "copper loss that warms it to 63 % [J]"),
    ("warm", 0.0, "share of the motor's Coulomb friction lost when warm"),
    ("warm_work", 5.0, "work of friction that warms it to 63 % [J]"),
    ("backlash", 0.0, "full width of the joint's play [rad]"),
    ("fan", 0.0, "quadratic drag of the load [N m s^2]"),
]
_SENSOR = [  # one entry per channel
    ("gain", 1.0, "scale"),
    ("bias", 0.0, "offset [its unit]"),
    ("lag", 0.0, "first-order lag [s]"),
    ("noise", 1.0, "factor on the quoted noise"),
    ("colour", 0.0, "coefficient of the noise's first-order autoregression"),
    ("ripple", 0.0, "relative ripple, twice a turn of the rotor"),
]
STATES = 9  # i, w_m, q_m, w_l, q_l, amplifier, copper loss, work of friction, unused


def drive_record() -> np.ndarray:
    """The nominal drive."""
    out = np.zeros(1, dtype=[(name, "f8") for name, _, _ in _FIELDS])
    for name, value, _ in _FIELDS:
        out[name] = value
    return out


def sensor_record() -> np.ndarray:
    """Three sensors without fault."""
    out = np.zeros(len(CHANNELS), dtype=[(name, "f8") for name, _, _ in _SENSOR])
    for name, value, _ in _SENSOR:
        out[name] = value
    return out


class Held(NamedTuple):
    """Which bodies stand: motor, load."""

    motor: bool
    load: bool


@njit
def coulomb(p: Record, speed: float, sense: float, work: float) -> float:
    """Size of the motor's Coulomb friction [N m] at a speed and a sense of motion (or of drive)."""
    level = p.motor_coulomb * (1.0 + p.direction * sense)
    level *= 1.0 + p.stribeck * math.exp(-abs(speed) / p.stribeck_speed)
    return level * (1.0 - p.warm * (1.0 - math.exp(-work / p.warm_work)))


@njit
def joint_torque(p: Record, y: np.ndarray) -> float:
    """Torque on the load [N m]; nothing while the joint is inside its play."""
    twist = y[2] - y[4]
    if p.backlash > 0.0:
        half = 0.5 * p.backlash
        if abs(twist) < half:
            return 0.0
        twist -= math.copysign(half, twist)
    return p.stiffness * twist + p.hardening * twist**3 + p.damping * (y[1] - y[3])


@njit
def drives(p: Record, y: np.ndarray) -> tuple[float, float]:
    """Torques on motor and load [N m] without Coulomb friction."""
    joint = joint_torque(p, y)
    motor = p.torque_constant * y[0] - p.motor_viscous * y[1] - joint
    if p.cogging != 0.0:
        motor -= p.cogging * math.sin(p.cogging_count * y[2])
    load = joint - p.load_viscous * y[3] - p.fan * y[3] * abs(y[3])
    return motor, load - p.unbalance * math.sin(y[4])


@njit
def rates(p: Record, y: np.ndarray, u: float, held: Held, out: np.ndarray) -> None:
    """dy/dt with the stuck flags frozen."""
    motor, load = drives(p, y)
    volts = y[5] if p.lag > 0.0 else u
    volts *= 1.0 - p.sag * abs(y[0])
    ohms = p.resistance * (1.0 + p.heat * (1.0 - math.exp(-y[6] / p.heat_work)))
    out[0] = (volts - ohms * y[0] - p.torque_constant * y[1]) / p.inductance
    sense = math.copysign(1.0, y[1] if y[1] != 0.0 else motor)
    friction = coulomb(p, y[1], sense, y[7])
    out[1] = 0.0 if held.motor else (motor - sense * friction) / p.motor_inertia
    out[2] = y[1]
    against = math.copysign(p.load_coulomb, y[3] if y[3] != 0.0 else load)
    out[3] = 0.0 if held.load else (load - against) / p.load_inertia
    out[4] = y[3]
    out[5] = (u - y[5]) / p.lag if p.lag > 0.0 else 0.0
    out[6] = ohms * y[0] * y[0]
    out[7] = 0.0 if held.motor else friction * abs(y[1])
    out[8] = 0.0


@njit
def stuck(p: Record, y: np.ndarray) -> Held:
    """Bodies that stand and that their drive cannot move."""
    motor, load = drives(p, y)
    sense = math.copysign(1.0, motor)
    holds = y[1] == 0.0 and abs(motor) <= coulomb(p, 0.0, sense, y[7])
    return Held(holds, p.load_coulomb > 0.0 and y[3] == 0.0 and abs(load) <= p.load_coulomb)


@njit
def step(p: Record, y: np.ndarray, u: float, h: float, k: np.ndarray) -> None:
    """One step of Runge-Kutta; a body whose speed changes sign stands at its end."""
    held = stuck(p, y)
    before_m, before_l = y[1], y[3]
    rates(p, y, u, held, k[0])
    rates(p, y + 0.5 * h * k[0], u, held, k[1])
    rates(p, y + 0.5 * h * k[1], u, held, k[2])
    rates(p, y + h * k[2], u, held, k[3])
    y += h / 6.0 * (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3])
    if before_m * y[1] < 0.0:
        y[1] = 0.0
    if p.load_coulomb > 0.0 and before_l * y[3] < 0.0:
        y[3] = 0.0


@kept
def simulate(p: Record, commands: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """True (i, omega, q) at each row, shape (n, 3), and the rotor's angle [rad], shape (n,); row k
    is read before command k acts for one period.
    """
    n = len(commands)
    true, rotor = np.empty((n, 3)), np.empty(n)
    y, k = np.zeros(STATES), np.zeros((4, STATES))
    h = PERIOD / SUBSTEPS
    for row in range(n):
        true[row, 0], true[row, 1], true[row, 2] = y[0], y[1], y[4]
        rotor[row] = y[2]
        for part in range(SUBSTEPS):
            late = row - (p.delay / PERIOD - (part + 0.5) / SUBSTEPS)
            u = commands[math.floor(late)] if late >= 0.0 else 0.0
            if p.dead_zone > 0.0:
                u = math.copysign(max(abs(u) - 0.5 * p.dead_zone, 0.0), u)
            step(p, y, p.gain * u, h, k)
    return true, rotor


@kept
def read(sensor: np.ndarray, true: np.ndarray, rotor: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Readings, shape (n, 3); `noise`: standard normal, shape (n, 3)."""
    n = len(true)
    out = np.empty((n, 3))
    for j in range(3):
        s = sensor[j]
        behind, past = true[0, j], 0.0
        fade = math.exp(-PERIOD / s.lag) if s.lag > 0.0 else 0.0
        for row in range(n):
            behind = fade * behind + (1.0 - fade) * true[row, j]
            past = s.colour * past + math.sqrt(1.0 - s.colour**2) * noise[row, j]
            value = behind * s.gain * (1.0 + s.ripple * math.sin(2.0 * rotor[row]))
            out[row, j] = value + s.bias + s.noise * SIGMA[j] * past
    return out
