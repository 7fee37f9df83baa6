"""Discrepancies that are random functions of random signals of a random block: "unknown" without a
name that anything could have learnt.
"""

from __future__ import annotations

import numpy as np

from pneugantry.truth.form import AXES, Build, Form, Parameters
from pneugantry.truth.parameters import SIGMA, Rig
from pneugantry.truth.random_term import random_row
from pneugantry.truth.sensors import FORCE_BESIDE, PARTNER

# middle and half range of each signal on the seven logs of the nominal rig
VALVE = np.array(
    [[[60, 60], [45, 45], [0.5, 0.5], [0, 0.3]], [[45, 45], [45, 45], [0.05, 0.05], [0, 0.2]]]
)
FRICTION = np.array(
    [[[0.5, 0.5], [0, 0.4], [25, 25], [20, 20]], [[0.05, 0.05], [0, 0.2], [40, 40], [20, 20]]]
)
CONTACT = np.array([[3e-3, 3e-3], [0, 0.1], [0.7, 0.3], [0, 0.1]])
READING = {0: [0.5, 0.5], 1: [0.05, 0.05], 2: [0, 0.3], 3: [0, 0.2], 4: [0, 15], 5: [25, 25]}
READING |= {6: [-25, 25], 7: [45, 45]}
TIME = [8, 8]  # s


def _places(row: np.ndarray, alone: bool) -> Parameters:
    """Which signals the term is a function of."""
    return {"p": float(row[1])} if alone else {"p": float(row[1]), "q": float(row[4])}


def _block(first: int, ranges: np.ndarray) -> Build:
    """Build of a term in row `first` + axis."""

    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        alone = bool(rng.random() < 0.5)
        rig.terms[first + i] = random_row(rng, size, ranges[i], alone)
        return _places(rig.terms[first + i], alone)

    return build


def _reading(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    channel = int(rng.integers(8))
    ranges = np.array(
        [
            READING[channel],
            READING[int(PARTNER[channel])],
            TIME,
            READING[int(FORCE_BESIDE[channel])],
        ]
    )
    alone = bool(rng.random() < 0.5)
    rig.terms[5 + channel] = random_row(rng, size * SIGMA[channel], ranges, alone)
    return {"channel": float(channel), **_places(rig.terms[5 + channel], alone)}


RANDOM_FORMS = [
    Form(effect, "random", part, axes, low, high, unit, build, known=False, regressors=regressors)
    for effect, part, axes, low, high, unit, build, regressors in (
        (
            "random_valve",
            "valve",
            AXES,
            1.0,
            10.0,
            "N",
            _block(0, VALVE),
            ("u_{axis}", "f_a{axis}", "{axis}", "v_{axis}"),
        ),
        (
            "random_friction",
            "friction",
            AXES,
            1.0,
            8.0,
            "N",
            _block(2, FRICTION),
            ("{axis}", "v_{axis}", "f_a{axis}", "f_n"),
        ),
        (
            "random_contact",
            "contact",
            ("",),
            1.0,
            10.0,
            "N",
            _block(4, CONTACT[None]),
            ("depth", "depth_rate", "x", "v_t"),
        ),
        (
            "random_reading",
            "sensors",
            ("",),
            5.0,
            50.0,
            "sigma",
            _reading,
            ("{own}", "{partner}", "time", "{force}"),
        ),
    )
]
