"""Twelve missing terms that neither the catalogue nor a rough form of the diagnosis names; each has
a regressor, and a formula where nature gives it one.
"""

from __future__ import annotations

import numpy as np

from pneugantry.truth.form import AXES, Build, Form, Parameters, either
from pneugantry.truth.parameters import SIGMA, Rig

NO_AXIS = ("",)


def _axis(name: str, signed: bool = False) -> Build:
    """Build that puts the size into one field of the axis."""

    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        rig.axis[name][i] = value = (either(rng) if signed else 1.0) * size
        return {"coefficient": value}

    return build


def _quadratic(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    # A piston is not driven by its own drag: a negative one only as far as viscous friction reaches
    lowest = -0.5 * rig.axis["viscous"][i] / 0.5
    rig.axis["quadratic"][i] = value = max(either(rng) * size, lowest)
    return {"coefficient": value}


def _lag_pressure(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    rig.axis["lag_pressure"][i] = size
    return {"coefficient": size / 100.0}  # 1/N


def _seal(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    rig.axis["seal"][i] = size
    return {"coefficient": size / 100.0}  # 1/N


def _cycling(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    drawn = {
        "cycle": size,
        "cycle_time": rng.uniform(1.2, 5.0),
        "cycle_phase": rng.uniform(0.0, 1.0),
        "cycle_fill": rng.uniform(0.15, 0.5),
    }
    for name, value in drawn.items():
        rig.axis[name] = value  # one supply for both valves
    return {"coefficient": size, "frequency": 1.0 / drawn["cycle_time"], **drawn}


def _thinning(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    rig.axis["thin"][i], rig.axis["thin_work"][i] = size, rng.uniform(0.3, 3.0)
    return {"coefficient": size, "work": rig.axis["thin_work"][i]}


def _shaken(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    frequency, phase = rng.uniform(4.0, 14.0), rng.uniform(0.0, 2 * np.pi)
    rig.axis["shake"][i], rig.axis["shake_hz"][i] = size, frequency
    rig.axis["shake_phase"][i] = phase
    return {"coefficient": size, "frequency": frequency, "phase": phase}


def _base(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    frequency, damping = rng.uniform(6.0, 10.0), rng.uniform(0.02, 0.08)
    rig.axis["base_ratio"][i], rig.axis["base_zeta"][i] = size, damping
    rig.axis["base_omega"][i] = 2 * np.pi * frequency
    return {"coefficient": size, "frequency": frequency, "damping": damping}


def _gradient(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    rig.contact["gradient"] = value = either(rng) * size
    return {"coefficient": value}


def _rate_damping(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    rig.contact["rate_square"] = size
    return {"coefficient": size}


def _cyclic(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    pitch = (0.04, 0.008)[i] * rng.uniform(0.6, 1.6)  # m, of a drum or a scale
    rig.sensor["cyclic"][i], rig.sensor["cyclic_pitch"][i] = size * SIGMA[i], pitch
    return {"coefficient": size * SIGMA[i], "pitch": pitch}


def _cell(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    channel = 4 + i
    rig.sensor["play"][channel] = rng.uniform(2.0, 8.0)
    rig.sensor["play_share"][channel] = size
    return {"coefficient": size, "half_width": rig.sensor["play"][channel]}


def _form(
    effect: str,
    place: tuple[str, tuple[str, ...]],
    sizes: tuple[float, float, str],
    term: tuple[str, str],
    build: Build,
) -> Form:
    """place: part, axes; sizes: least, largest, unit; term: regressor, formula in r."""
    (part, axes), (low, high, unit), (regressor, formula) = place, sizes, term
    return Form(
        effect, "missing_term", part, axes, low, high, unit, build, False, (regressor,), formula
    )


VALVE, FRICTION = ("valve", AXES), ("friction", AXES)
MISSING_FORMS = [
    _form("valve_curvature", VALVE, (0.06, 0.6, "1/V"), ("u_{axis}", "r^2"), _axis("curvature")),
    _form("lag_pressure", VALVE, (0.15, 2.0, "at 100 N"), ("f_a{axis}", "|r|"), _lag_pressure),
    _form(
        "supply_cycling",
        ("valve", NO_AXIS),
        (0.02, 0.25, "fraction"),
        ("time", "periodic"),
        _cycling,
    ),
    _form("quadratic_drag", FRICTION, (25.0, 500.0, "N s^2/m^2"), ("v_{axis}", "r|r|"), _quadratic),
    _form("seal_pressure", FRICTION, (0.1, 1.5, "at 100 N"), ("f_a{axis}", "|r|"), _seal),
    _form(
        "thinning_grease",
        FRICTION,
        (0.15, 0.8, "fraction"),
        ("work_{axis}", "1-exp(-r)"),
        _thinning,
    ),
    _form("vibration", FRICTION, (0.3, 5.0, "N"), ("time", "sin"), _shaken),
    _form("base_resonance", FRICTION, (0.03, 0.4, "mass ratio"), ("a_{axis}", "resonance"), _base),
    _form("stiffness_gradient", ("contact", NO_AXIS), (0.15, 1.5, "1/m"), ("x", "r"), _gradient),
    _form(
        "rate_damping",
        ("contact", NO_AXIS),
        (100.0, 3000.0, "N s^2/m^2"),
        ("depth_rate", "r|r|"),
        _rate_damping,
    ),
    _form("cyclic_error", ("sensors", AXES), (2.0, 20.0, "sigma"), ("{axis}", "sin"), _cyclic),
    _form("cell_hysteresis", ("sensors", AXES), (0.03, 0.4, "share"), ("f_{axis}", "play"), _cell),
]
