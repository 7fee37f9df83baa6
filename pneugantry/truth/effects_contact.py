"""Effects of the catalogue in the contact block (s, v -> f): contact and workpiece."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pneugantry.truth.form import Build, Form, Parameters, either, relative
from pneugantry.truth.parameters import Rig

REACH = 3e-3  # m, deflection at the usual 30 N


@dataclass(frozen=True)
class Waviness:
    """Edge height [m] as a sum of sines of x: amplitude [m], wavelength [m], phase [rad]."""

    amplitude: np.ndarray
    wavelength: np.ndarray
    phase: np.ndarray

    def __call__(self, x: np.ndarray) -> np.ndarray:
        out = np.zeros_like(x)
        for a, wave, phase in zip(self.amplitude, self.wavelength, self.phase, strict=True):
            out += a * np.sin(2 * np.pi * x / wave + phase)
        return out


def _stiffness(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    factor = relative(rng, size)
    rig.contact["stiffness"] *= factor
    return {"factor": factor}


def _stiffness_and_damping(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    factor = relative(rng, size)
    rig.contact["stiffness"] *= factor
    rig.contact["damping"] *= np.sqrt(factor)  # the same damping ratio
    return {"factor": factor}


def _hardening(low: float, high: float) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        power = rng.uniform(low, high)
        rig.contact["harden_power"], rig.contact["harden_at"] = power, REACH / size ** (1.0 / power)
        return {"growth_at_3_mm": size, "power": power}

    return build


def _drag(stribeck: bool) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        rig.contact["drag"], rig.contact["drag_speed"] = size, 10 ** rng.uniform(-3.0, -2.0)
        rig.contact["drag_stribeck"] = rng.uniform(0.2, 1.0) if stribeck else 0.0
        return {
            "mu": size,
            "speed": rig.contact["drag_speed"][0],
            "extra": rig.contact["drag_stribeck"][0],
        }

    return build


def _waviness(kind: str) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        if kind == "sines":
            count = int(rng.integers(1, 6))
            wavelength = np.exp(rng.uniform(np.log(0.015), np.log(0.2), count))
            amplitude = rng.uniform(0.2, 1.0, count) * wavelength**0.5
        elif kind == "band_noise":
            wavelength = 1.0 / np.linspace(1 / 0.15, 1 / 0.012, 60)
            amplitude = rng.rayleigh(size=60) * wavelength
        else:  # facets: a triangular wave without its sharpest corners
            order = np.arange(1, 12, 2)
            wavelength = rng.uniform(0.06, 0.25) / order
            amplitude = 1.0 / order**2
        phase = rng.uniform(0, 2 * np.pi, len(wavelength))
        if kind == "facets":
            phase = phase[0] / wavelength * wavelength[0] + np.where(
                np.arange(len(phase)) % 2 == 0, 0.0, np.pi
            )
        amplitude = amplitude * size * np.sqrt(2.0) / np.sqrt(np.sum(amplitude**2))
        rig.edge = Waviness(amplitude, wavelength, phase)
        return {
            "rms": size,
            "longest": wavelength.max(),
            "shortest": wavelength.min(),
            "count": len(wavelength),
        }

    return build


def _angle(kind: str) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        sense = either(rng)
        # a larger negative angle leaves the stroke of z
        angle = np.radians(sense * min(size, 1.5) if sense < 0 else size)
        rig.contact["tilt"] = angle
        rig.contact["pivot"] = 0.95 + (rng.uniform(-0.02, 0.02) if kind == "pivot" else 0.0)
        rig.contact["tilt_bow"] = rng.uniform(-0.5, 0.5) if kind == "bow" else 0.0
        return {"angle": angle, "pivot": rig.contact["pivot"][0], "bow": rig.contact["tilt_bow"][0]}

    return build


def _forms(effect: str, low: float, high: float, unit: str, **builds: Build) -> list[Form]:
    return [
        Form(effect, name, "contact", ("",), low, high, unit, build)
        for name, build in builds.items()
    ]


CONTACT_FORMS = [
    *_forms(
        "contact_stiffness",
        0.08,
        1.2,
        "relative",
        spring=_stiffness,
        with_damping=_stiffness_and_damping,
    ),
    *_forms(
        "contact_hardening",
        0.04,
        1.5,
        "relative at 3 mm",
        root=_hardening(0.5, 0.9),
        power=_hardening(1.1, 2.5),
    ),
    *_forms("bearing_drag", 0.01, 0.3, "mu", tanh=_drag(False), stribeck=_drag(True)),
    *_forms(
        "surface_waviness",
        3e-5,
        6e-4,
        "m RMS",
        sines=_waviness("sines"),
        band_noise=_waviness("band_noise"),
        facets=_waviness("facets"),
    ),
    *_forms(
        "workpiece_angle",
        0.15,
        4.0,
        "deg",
        datum=_angle("datum"),
        pivot=_angle("pivot"),
        bow=_angle("bow"),
    ),
]
