"""Weights of the decision from diagnosed rigs whose truth is known.

What a rig's diagnosis weighed (`gap/1`: weighed, stands_out) is enough: nothing is fitted again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from pneugantry.engine.decide import UNKNOWN, Chances, Weighed, shares, unknown_probability
from pneugantry.engine.plant import Array

__all__ = ["FITTED", "Known", "fitted", "known_case", "log_score"]

LEAST = 0.01  # probability that a truth has at least: one rig must not decide
FITTED = ("temper", "entry", "unknown_at", "unknown_per")
# Their logarithms have a spread of 1 about the present ones: a few cases move them little.


@dataclass(frozen=True)
class Known:
    """A diagnosed rig and its truth."""

    effects: frozenset[str]  # of the catalogue
    unknown: bool  # whether it has something else besides
    weighed: tuple[Weighed, ...]
    stands_out: float


def known_case(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> Known:
    """truth: kind and causes (effect, axis, known); answer: `gap/1`."""
    causes = truth["causes"]
    known = [c for c in causes if c.get("known", truth["kind"] != "unknown")]
    keys = {f"{c['effect']}/{c['axis']}" if c.get("axis") else str(c["effect"]) for c in known}
    weighed = tuple((tuple(w["effects"]), float(w["cost"])) for w in answer["weighed"])
    return Known(
        frozenset(keys),
        truth["kind"] in ("unknown", "both"),
        weighed,
        float(answer["stands_out"]),
    )


def log_score(cases: Iterable[Known], chances: Chances) -> float:
    """Mean log probability of the truths."""
    return float(np.mean([_of(case, chances) for case in cases]))


def _of(case: Known, chances: Chances) -> float:
    among = shares(case.weighed, chances)
    right = sum(
        float(p)
        for p, (keys, _) in zip(among, case.weighed, strict=True)
        if frozenset(keys) - {UNKNOWN} == case.effects
    )
    odd = unknown_probability(case.stands_out, chances)
    return math.log(max(right, LEAST)) + math.log(max(odd if case.unknown else 1 - odd, LEAST))


def fitted(cases: Sequence[Known], start: Chances) -> Chances:
    """The weights of the largest log probability, near those to start from."""
    logs = np.log([getattr(start, n) for n in FITTED])

    def chances(step: Array) -> Chances:
        temper, entry, at, per = (float(v) for v in np.exp(logs + step))
        return replace(start, temper=temper, entry=entry, unknown_at=at, unknown_per=per)

    def cost(step: Array) -> float:
        return float(step @ step) / 2 - len(cases) * log_score(cases, chances(step))

    simplex = np.vstack([np.zeros(len(FITTED)), 0.3 * np.eye(len(FITTED))])
    found = minimize(
        cost,
        np.zeros(len(FITTED)),
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxiter": 2000, "xatol": 1e-3, "fatol": 1e-4},
    )
    return chances(found.x)
