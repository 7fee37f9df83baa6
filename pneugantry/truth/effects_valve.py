"""Effects of the catalogue in the valve blocks (u -> f_a)."""

from __future__ import annotations

import numpy as np

from pneugantry.truth.form import AXES, Build, Form, Parameters, either, relative
from pneugantry.truth.parameters import LAG, Rig


def _lag_single(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    rig.axis["lag"][i] *= relative(rng, size)
    return {"tau": rig.axis["lag"][i]}


def _lag_two_stage(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    share, tau = rng.uniform(0.1, 0.3), rig.axis["lag"][i]
    rig.axis["second_lag"][i] = share * size * tau
    rig.axis["lag"][i] = tau * (1.0 + (1.0 - share) * size)
    return {"tau": tau * (1.0 + size), "second_stage": rig.axis["second_lag"][i]}


def _lag_along(shape: str) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        place = np.linspace(0.0, 1.0, rig.profile.shape[2])
        sense, centre = either(rng), rng.uniform(0.3, 0.7)
        if shape == "exponential":
            factor = np.exp(sense * size * (place - centre))
        elif shape == "quadratic":
            bowl = ((place - centre) / max(centre, 1.0 - centre)) ** 2
            factor = 1.0 + size * (bowl if sense > 0 else 1.0 - place**2)
        else:
            factor = np.exp(sense * size * 0.5 * np.tanh(4.0 * (place - centre)))
        rig.profile[i, LAG] *= factor
        return {
            "sense": sense,
            "centre": centre,
            "factor_at_0": factor[0],
            "factor_at_end": factor[-1],
        }

    return build


def _lag_asymmetry(blend: bool) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        factor = relative(rng, size)
        lean = rng.uniform(0.3, 0.7)
        rig.axis["lag_rise"][i] = factor**lean
        rig.axis["lag_fall"][i] = factor ** (lean - 1.0)
        rig.axis["lag_blend"][i] = rng.uniform(0.5, 4.0) if blend else 0.0
        return {
            "rise": factor**lean,
            "fall": factor ** (lean - 1.0),
            "blend": rig.axis["lag_blend"][i],
        }

    return build


def _delay(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    rig.axis["delay"][i] = size
    return {"delay": size}


def _play(elements: bool) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        rig.axis["play"][i] = size
        rig.axis["play_elements"][i] = rng.integers(3, 9) if elements else 1
        return {"width": size, "elements": rig.axis["play_elements"][i]}

    return build


def _gain(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    factor = relative(rng, size)
    rig.axis["gain"][i] *= factor
    return {"factor": factor}


def _offset(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    shift = either(rng) * size
    rig.axis["offset"][i] += shift
    return {"shift": shift}


def _sag(exponent: tuple[float, float]) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        drawn = {
            "sag": size,
            "sag_exponent": rng.uniform(*exponent),
            "sag_time": rng.uniform(0.1, 1.0),
            "recover_time": rng.uniform(2.0, 8.0),
        }
        for name, value in drawn.items():
            rig.axis[name][i] = value
        return drawn

    return build


def _reservoir(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    flow, pace = size, rng.uniform(1.5, 8.0)
    rig.axis["sag_flow"][i] = flow
    rig.axis["sag"][i] = rng.uniform(0.1, 0.4) * size
    rig.axis["sag_time"][i] = rig.axis["recover_time"][i] = pace
    return {"flow": flow, "steady": rig.axis["sag"][i], "recover_time": pace}


def _forms(effect: str, low: float, high: float, unit: str, **builds: Build) -> list[Form]:
    return [
        Form(effect, name, "valve", AXES, low, high, unit, build) for name, build in builds.items()
    ]


VALVE_FORMS = [
    *_forms("valve_lag", 0.08, 1.0, "relative", single=_lag_single, two_stage=_lag_two_stage),
    *_forms(
        "valve_lag_position",
        0.15,
        1.8,
        "log span",
        exponential=_lag_along("exponential"),
        quadratic=_lag_along("quadratic"),
        sigmoid=_lag_along("sigmoid"),
    ),
    *_forms(
        "valve_lag_asymmetry",
        0.08,
        1.2,
        "relative",
        abrupt=_lag_asymmetry(False),
        blend=_lag_asymmetry(True),
    ),
    *_forms("valve_delay", 0.002, 0.06, "s", transport=_delay),
    *_forms("valve_hysteresis", 0.008, 0.15, "V", play=_play(False), graded=_play(True)),
    *_forms("valve_gain", 0.07, 0.45, "relative", factor=_gain),
    *_forms("valve_offset", 0.006, 0.12, "V", shift=_offset),
    *_forms(
        "supply_droop",
        0.06,
        0.6,
        "fraction",
        proportional=_sag((0.8, 1.2)),
        progressive=_sag((1.5, 2.2)),
        reservoir=_reservoir,
    ),
]
