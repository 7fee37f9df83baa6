"""The servo pendulum integrated apart from its FMU, and the friction ladder of its authors on it.

Friction holds the arm while it can (the torque that would stop it within a step), as a gearbox
does; no smooth sign. Source: github.com/Rhoban/bam (Apache-2.0), equations after the README beside
the data.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numba import njit
from scipy.optimize import least_squares

GRAVITY = 9.80665  # m/s^2
PERIOD = 5e-3  # s, of a log
GAIN_UNIT = (4096 / (2 * math.pi)) / (256 * 885)  # duty per gain setting and radian
FIELDS = {  # name here: name in the authors' files, value where they have none
    "k_t": ("kt", 0.0),
    "R": ("R", 1.0),
    "armature": ("armature", 0.0),
    "q_offset": ("q_offset", 0.0),
    "T_c": ("friction_base", 0.0),
    "d": ("friction_viscous", 0.0),
    "m": ("", 0.49),
    "l": ("", 0.1),
    "V": ("", 7.4),
    "load": ("load_friction_base", 0.0),
    "load_rest": ("load_friction_stribeck", 0.0),
    "T_s": ("friction_stribeck", 0.0),
    "w_s": ("dtheta_stribeck", 1.0),
    "alpha": ("alpha", 1.0),
    "load_motor": ("load_friction_motor", 0.0),
    "load_external": ("load_friction_external", 0.0),
    "load_motor_rest": ("load_friction_motor_stribeck", 0.0),
    "load_external_rest": ("load_friction_external_stribeck", 0.0),
    "load_motor_square": ("load_friction_motor_quad", 0.0),
    "load_external_square": ("load_friction_external_quad", 0.0),
    "gain": ("", 1.0),
}
BASIC = ("k_t", "R", "armature", "q_offset", "T_c", "d")
RUNGS = {  # free parameters of a rung when it is refitted
    "m1": BASIC,
    "m3": (*BASIC, "load"),
    "m6": (
        *BASIC,
        *("T_s", "w_s", "load_motor", "load_external", "load_external_rest"),
        *("load_motor_square", "load_external_square"),
    ),
}
TRAJECTORIES = ("sin_sin", "sin_time_square", "up_and_down", "lift_and_drop")
FITTED_GAINS, HELD_GAINS = (100, 400), (200, 800)


def published(folder: Path, rung: str) -> dict[str, float]:
    """Parameters of a rung as its authors fitted them."""
    given = json.loads((folder / "params" / f"{rung}.json").read_text())
    return {name: float(given.get(key, value)) for name, (key, value) in FIELDS.items()}


def log_names(gains: Sequence[int] = (*FITTED_GAINS, *HELD_GAINS)) -> list[str]:
    """Logs recorded at these gains."""
    return [f"{trajectory}_kp{gain}" for trajectory in TRAJECTORIES for gain in gains]


def setting(name: str) -> float:
    """Gain setting of a log, from its name."""
    return float(name.rpartition("kp")[2])


@njit
def _friction(p: np.ndarray, motor: float, external: float, w: float) -> float:
    """Largest friction torque [N m] at two torques and a speed; order of `FIELDS`."""
    rest = math.exp(-(abs(w / p[12]) ** p[13]))
    between = abs(external - motor)
    level = p[4] + p[9] * between + p[14] * abs(motor) + p[15] * abs(external)
    level += rest * (p[11] + p[10] * between + p[16] * abs(motor) + p[17] * abs(external))
    return level + p[18] * motor**2 + p[19] * external**2 + p[5] * abs(w)


@njit
def _positions(
    p: np.ndarray, goal: np.ndarray, enable: np.ndarray, scale: float, start: float, parts: int
) -> np.ndarray:
    out, q, w, dt = np.empty(len(goal)), start, 0.0, PERIOD / parts
    inertia = p[6] * p[7] ** 2 + p[2]
    for row in range(len(goal)):
        out[row] = q
        for _ in range(parts):
            duty = min(max(scale * (goal[row] - q), -1.0), 1.0)
            motor = p[0] * (duty * p[8] - p[0] * w) / p[1] if enable[row] > 0.5 else 0.0
            external = -p[6] * GRAVITY * p[7] * math.sin(q + p[3])
            halt = inertia / dt * w + motor + external
            against = min(abs(halt), _friction(p, motor, external, w))
            w += (motor + external - math.copysign(against, halt)) / inertia * dt
            q += w * dt
    return out


def positions(
    values: Mapping[str, float], name: str, log: pd.DataFrame, parts: int = 10
) -> np.ndarray:
    """Position [rad] at each row of a log, from its goals alone; `parts`: steps of a period."""
    p = np.array([values[field] for field in FIELDS])
    scale = values["gain"] * setting(name) * GAIN_UNIT
    goal, enable = (log[c].to_numpy(float) for c in ("goal_position", "torque_enable"))
    return _positions(p, goal, enable, scale, float(log["position"].iloc[0]), parts)


def duties(values: Mapping[str, float], name: str, log: pd.DataFrame) -> np.ndarray:
    """Duty [1] at each row of a log, by the law of the firmware from its goals and positions."""
    apart = (log["goal_position"] - log["position"]).to_numpy()
    duty = np.clip(values["gain"] * setting(name) * GAIN_UNIT * apart, -1.0, 1.0)
    return np.where(log["torque_enable"] > 0.5, duty, 0.0)


def error(values: Mapping[str, float], name: str, log: pd.DataFrame) -> float:
    """RMS position error [rad] of a log."""
    difference = positions(values, name, log) - log["position"].to_numpy()
    return float(np.sqrt(np.mean(difference**2)))


def refitted(
    start: Mapping[str, float], free: Sequence[str], logs: Mapping[str, pd.DataFrame]
) -> dict[str, float]:
    """Least squares on the positions of the logs, from `start`, over the `free` parameters."""
    shares = [n for n in free if n.startswith("load") or n == "T_s"]
    scales = {n: max(abs(start[n]), 0.02 if n in shares else 1e-3) for n in free}

    def put(x: np.ndarray) -> dict[str, float]:
        return {**start, **{n: float(v) * scales[n] for n, v in zip(free, x, strict=True)}}

    def residual(x: np.ndarray) -> np.ndarray:
        values = put(x)
        return np.concatenate(
            [positions(values, n, log, 5) - log["position"].to_numpy() for n, log in logs.items()]
        )

    first = np.array([start[n] / scales[n] for n in free])
    least = [-50.0 if n == "q_offset" else 0.01 * (n in ("k_t", "R", "w_s")) for n in free]
    return put(least_squares(residual, first, bounds=(least, 50.0), diff_step=1e-3, max_nfev=40).x)
