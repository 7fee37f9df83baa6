"""Effects of the catalogue in the friction blocks (f_a, f_c -> v, s)."""

from __future__ import annotations

import numpy as np

from pneugantry.truth.form import AXES, Build, Form, Parameters, either, relative
from pneugantry.truth.parameters import DAHL, FORCE, IWAN, LEVEL, LUGRE, Rig


def _factor(name: str) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        factor = relative(rng, size)
        rig.axis[name][i] *= factor
        return {"factor": factor}

    return build


def _coulomb(uneven: bool) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        factor = relative(rng, size)
        ripple, waves = (rng.uniform(0.05, 0.15) if uneven else 0.0), rng.uniform(2.0, 6.0)
        place = np.linspace(0.0, 1.0, rig.profile.shape[2])
        rig.profile[i, LEVEL] *= 1.0 + (factor - 1.0) * (
            1.0 + ripple * np.sin(2 * np.pi * waves * place)
        )
        return {"factor": factor, "ripple": ripple}

    return build


def _stribeck(shape: float | None) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        power = rng.uniform(0.5, 2.0) if shape is None else shape
        rig.axis["stribeck"][i], rig.axis["stribeck_shape"][i] = size, power
        return {"v_s": size, "shape": power}

    return build


def _presliding(law: int, ddfm: bool = False) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        a = rig.axis
        ratio = 1.0 if rng.random() < 0.4 else rng.uniform(0.75, 1.1)
        a["law"][i], a["stiffness"][i], a["limit_ratio"][i] = law, 1.0 / size, ratio
        drawn = {"sigma": 1.0 / size, "beta": a["limit_ratio"][i] * a["dynamic"][i]}
        if law == DAHL:
            drawn["exponent"] = a["dahl_exponent"][i] = 2.0 if ddfm else rng.uniform(0.8, 1.6)
        if law == LUGRE:
            damping = rng.uniform(0.0, 0.4) * np.sqrt(a["mass"][i] / size)
            drawn["sigma_1"] = a["bristle_damping"][i] = damping
            if rng.random() < 0.5 and a["stribeck"][i] == 0.0:
                a["stribeck"][i] = rng.uniform(0.005, 0.03)
            drawn["v_s"] = a["stribeck"][i]
        return drawn

    return build


def _position(shape: str) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        place = np.linspace(0.0, 1.0, rig.profile.shape[2])
        sense, centre, width = either(rng), rng.uniform(0.15, 0.85), rng.uniform(0.06, 0.25)
        if shape == "exponential":
            change = np.exp(sense * size * (place - centre)) - 1.0
        elif shape == "quadratic":
            change = size * (4.0 * (place - 0.5) ** 2 - rng.uniform(0.0, 0.7))
        elif shape == "spot":
            change = (
                sense
                * min(size, 0.8 if sense < 0 else 9.0)
                * np.exp(-(((place - centre) / width) ** 2))
            )
        else:
            waves, phase = rng.uniform(0.7, 3.0), rng.uniform(0.0, 2 * np.pi)
            change = min(size, 0.8) * np.sin(2 * np.pi * waves * place + phase)
        rig.profile[i, LEVEL] *= np.maximum(1.0 + change, 0.1)
        return {
            "sense": sense,
            "centre": centre,
            "width": width,
            "least": 1 + change.min(),
            "most": 1 + change.max(),
        }

    return build


def _direction(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    rig.axis["direction"][i] = either(rng) * size
    return {"asymmetry": rig.axis["direction"][i]}


def _load(low: float, high: float) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        rig.axis["load"][i], rig.axis["load_exponent"][i] = size, rng.uniform(low, high)
        return {"growth_at_10_n": size, "exponent": rig.axis["load_exponent"][i]}

    return build


def _cable(slope: bool) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        change = either(rng) * size
        rig.axis["cable"][i] += change
        part = rng.uniform(-0.3, 0.3) * change if slope else 0.0
        rig.profile[i, FORCE] += part * np.linspace(-0.5, 0.5, rig.profile.shape[2])
        return {"change": change, "along_stroke": part}

    return build


def _coupling(saturates: bool) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        rig.axis["coupling"][i] = either(rng) * size
        rig.axis["coupling_limit"][i] = rng.uniform(3.0, 12.0) if saturates else 0.0
        return {"kappa": rig.axis["coupling"][i], "limit": rig.axis["coupling_limit"][i]}

    return build


def _forms(
    effect: str, low: float, high: float, unit: str, axes: tuple[str, ...] = AXES, **builds: Build
) -> list[Form]:
    return [
        Form(effect, name, "friction", axes, low, high, unit, build)
        for name, build in builds.items()
    ]


FRICTION_FORMS = [
    *_forms("coulomb_level", 0.08, 0.7, "relative", even=_coulomb(False), uneven=_coulomb(True)),
    *_forms("viscous_level", 0.10, 1.2, "relative", factor=_factor("viscous")),
    *_forms(
        "stribeck",
        0.004,
        0.12,
        "m/s",
        exponential=_stribeck(1.0),
        gaussian=_stribeck(2.0),
        stretched=_stribeck(None),
        rational=_stribeck(0.0),
    ),
    *_forms(
        "presliding",
        2e-6,
        5e-5,
        "m/N",
        ddfm=_presliding(DAHL, True),
        dahl=_presliding(DAHL),
        lugre=_presliding(LUGRE),
        iwan=_presliding(IWAN),
    ),
    *_forms(
        "friction_position",
        0.10,
        1.0,
        "relative",
        exponential=_position("exponential"),
        quadratic=_position("quadratic"),
        spot=_position("spot"),
        wave=_position("wave"),
    ),
    *_forms("friction_direction", 0.05, 0.5, "relative", ("z",), factor=_direction),
    *_forms(
        "friction_load",
        0.04,
        0.5,
        "relative",
        linear=_load(1.0, 1.0),
        sublinear=_load(0.5, 0.9),
        superlinear=_load(1.1, 1.6),
    ),
    *_forms("payload_mass", 0.10, 1.0, "relative", factor=_factor("mass")),
    *_forms("cable_force", 0.5, 8.0, "N", constant=_cable(False), coiled=_cable(True)),
    *_forms(
        "axis_coupling",
        0.3,
        5.0,
        "kg",
        ("z",),
        inertial=_coupling(False),
        saturating=_coupling(True),
    ),
]
