"""The gap on the thesis' tests of the parts: the stationary z force (Fig. 4.14) by friction law,
the step tests (Tables 4.1-4.5) by what tau depends on. Scores are log likelihoods, as in `gap`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from pneugantry.thesis.conditions import CHOICE, SOFT, Choice
from pneugantry.thesis.lag_readings import READINGS
from pneugantry.thesis.plant_tests import READ_OFF_SPAN, hysteresis
from pneugantry.thesis.structures import LAWS
from pyfmi_runner.fmu import FmuFile

__all__ = ["PartTest", "part_tests", "span_rivals", "tau_likelihood"]

READING, TOLERANCE, FREEDOM = 1.0, 0.10, 4.0  # N, of the figure; of a prediction; of Student's t
STEPS = 0.01  # s, of the printed readings


class Reading(NamedTuple):
    """One step test."""

    axis: str
    where: float  # m
    way: str  # "filling" or "exhausting"
    tau: float  # s


class PartTest(NamedTuple):
    """One rival explanation of a test."""

    test: str
    name: str
    measured: float | None  # N; None: many readings
    predicted: float | None
    gain: float  # log units, 0: the best of its test


def part_tests(fmu: FmuFile) -> list[PartTest]:
    """Every test's rivals, best first."""
    spans = span_rivals(fmu)
    worth = {name: _span_likelihood(span) for name, span in spans.items()}
    found = [
        PartTest("Fig. 4.14, span of F_z", name, READ_OFF_SPAN, spans[name], gain)
        for name, gain in _gains(worth)
    ]
    for axis in ("x", "z"):
        rivals = {name: tau_likelihood(axis, same) for name, same in TAU_RIVALS.items()}
        found += [
            PartTest(f"Tables 4.1-4.5, tau_{axis}", name, None, None, gain)
            for name, gain in _gains(rivals)
        ]
    return found


def _gains(worth: dict[str, float]) -> list[tuple[str, float]]:
    best = max(worth.values())
    return sorted(((name, value - best) for name, value in worth.items()), key=lambda one: -one[1])


def span_rivals(fmu: FmuFile) -> dict[str, float]:
    """Span of F_z [N] in the constrained open-loop test, by friction law on z."""
    rivals: dict[str, tuple[str, Choice]] = {
        f"DDFM, beta {CHOICE.ddfm_limit:g} N (the choice)": ("DDFM", CHOICE),
        f"DDFM, beta {SOFT.ddfm_limit:g} N, K_c 1e4": ("DDFM", SOFT),
        "VDFM": ("VDFM", CHOICE),
        "Stribeck": ("Stribeck", CHOICE),
        "LuGre": ("LuGre", CHOICE),
        "no friction": ("none", CHOICE),
    }
    return {name: hysteresis(fmu, LAWS[law], choice).span for name, (law, choice) in rivals.items()}


def _span_likelihood(span: float) -> float:
    sd = math.hypot(READING, TOLERANCE * span)
    return float(student.logpdf(READ_OFF_SPAN, FREEDOM, span, sd))


TAU_RIVALS: dict[str, Callable[[Reading, Reading], bool]] = {
    "constant": lambda a, b: True,
    "by position": lambda a, b: a.where == b.where,
    "by filling or exhausting": lambda a, b: a.way == b.way,
}


def tau_likelihood(axis: str, same: Callable[[Reading, Reading], bool]) -> float:
    """Log likelihood of an axis' readings of tau, each predicted by the mean and scatter of the
    others that are `same`: a finer rival has fewer readings to go by.
    """
    readings = list(_readings(axis))
    total = 0.0
    for one in readings:
        others = [r.tau for r in readings if r is not one and same(one, r)]
        spread = float(np.var(others, ddof=1)) * (1.0 + 1.0 / len(others))
        sd = math.sqrt(spread + STEPS**2 / 12.0)
        total += float(student.logpdf(one.tau, len(others) - 1, float(np.mean(others)), sd))
    return total


def _readings(axis: str) -> Iterator[Reading]:
    for where, ways in READINGS[axis].items():
        for way, values in zip(("filling", "exhausting"), ways, strict=True):
            for tau in values:
                yield Reading(axis, where, way, tau)
