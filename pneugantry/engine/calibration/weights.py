"""Weights of the decision from diagnosed rigs whose truth is known, and how well probabilities
under them say how often they are right.

What a rig's diagnosis weighed (`gap/1`: weighed, stands_out, stood_out, doubtful) is enough:
nothing is fitted again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pneugantry.engine.answer.decide import Belief, Outstanding, Weighed, beliefs
from pneugantry.engine.chances import Chances
from pneugantry.engine.plant import Array

__all__ = [
    "FITTED",
    "Bin",
    "Calibration",
    "Known",
    "calibrated",
    "error",
    "fitted",
    "known_case",
    "left_out",
    "log_score",
    "reliability",
]

PARTS = 5  # of the rigs, each left out in turn
BINS = 5  # of probability, of a table of reliability
LEAST = 0.01  # probability that a truth has at least: one rig must not decide
FITTED = ("temper", "entry", "unknown_at", "unknown_per", "unknown_left", "beside", "imitated")
SHARES = ("unknown_left", "beside", "imitated")  # of these, shares of 1
# Their logarithms (of a share: of its odds) have a spread of 1 about the present ones: a few cases
# move them little.


@dataclass(frozen=True)
class Known:
    """A diagnosed rig and its truth."""

    effects: frozenset[str]  # of the catalogue
    unknown: bool  # whether it has something else besides
    weighed: tuple[Weighed, ...]
    stands_out: float
    doubtful: frozenset[str]  # effects weighed that may only look like what stands out
    stood_out: float | None = None


@dataclass(frozen=True)
class Calibration:
    """Weights fitted to rigs, and what they are worth on rigs that they have not seen."""

    chances: Chances
    rigs: int
    score: float  # mean log probability of the truth, each rig left out of the fit
    before: float  # the same under the weights to start from
    reliability: tuple[Bin, ...]


@dataclass(frozen=True)
class Bin:
    """Claims of like probability. what: "effect", "none" or "unknown"."""

    what: str
    claims: int
    said: float  # mean probability
    right: float  # share that was true


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
        frozenset(answer.get("doubtful", (k for own, _ in weighed for k in own))),
        answer.get("stood_out"),
    )


def log_score(cases: Iterable[Known], chances: Chances) -> float:
    """Mean log probability of the truths."""
    return float(np.mean([_of(case, chances) for case in cases]))


def _of(case: Known, chances: Chances) -> float:
    believed = _believed(case, chances)
    return math.log(max(believed.get((case.effects, case.unknown), 0.0), LEAST))


def _believed(case: Known, chances: Chances) -> dict[Belief, float]:
    left = Outstanding(case.stands_out, before=case.stood_out)
    return beliefs(case.weighed, left, case.doubtful, chances)


def fitted(cases: Sequence[Known], start: Chances) -> Chances:
    """The weights of the largest log probability, near those to start from."""
    now = np.array([getattr(start, n) for n in FITTED])
    share = np.array([n in SHARES for n in FITTED])
    logs = np.log(np.where(share, now / (1 - now), now))

    def chances(step: Array) -> Chances:
        found = np.exp(logs + step)
        values = np.where(share, found / (1 + found), found)
        return replace(start, **dict(zip(FITTED, map(float, values), strict=True)))  # type: ignore[arg-type]

    def cost(step: Array) -> float:
        return float(step @ step) / 2 - len(cases) * log_score(cases, chances(step))

    simplex = np.vstack([np.zeros(len(FITTED)), 0.3 * np.eye(len(FITTED))])
    from scipy.optimize import minimize

    found = minimize(
        cost,
        np.zeros(len(FITTED)),
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxiter": 2000, "xatol": 1e-3, "fatol": 1e-4},
    )
    return chances(found.x)


def left_out(cases: Sequence[Known], start: Chances) -> list[Chances]:
    """For each rig the weights that the rigs of other parts fit."""
    parts = [
        fitted([c for i, c in enumerate(cases) if i % PARTS != k], start) for k in range(PARTS)
    ]
    return [parts[i % PARTS] for i in range(len(cases))]


def calibrated(cases: Sequence[Known], start: Chances) -> Calibration:
    """Weights from all rigs; what they are worth, each rig under weights that have not seen it."""
    unseen = left_out(cases, start)
    scores = [log_score([c], w) for c, w in zip(cases, unseen, strict=True)]
    return Calibration(
        fitted(cases, start),
        len(cases),
        float(np.mean(scores)),
        log_score(cases, start),
        reliability(cases, unseen),
    )


def reliability(cases: Sequence[Known], weights: Sequence[Chances]) -> tuple[Bin, ...]:
    """How often claims are true, by kind and probability; weights: one for each rig."""
    claims: dict[str, list[tuple[float, bool]]] = {"effect": [], "none": [], "unknown": []}
    for case, chances in zip(cases, weights, strict=True):
        believed = _believed(case, chances)
        odd = sum(p for (_, unknown), p in believed.items() if unknown)
        claims["unknown"].append((odd, case.unknown))
        nothing = believed.get((frozenset(), False), 0.0)
        claims["none"].append((nothing, not case.effects and not case.unknown))
        for key in {k for keys, _ in believed for k in keys}:
            told = sum(p for (keys, _), p in believed.items() if key in keys)
            if told > LEAST:
                claims["effect"].append((told, key in case.effects))
    return tuple(b for what, of in claims.items() for b in _bins(what, of))


def _bins(what: str, claims: Sequence[tuple[float, bool]]) -> list[Bin]:
    found = []
    for k in range(BINS):
        own = [c for c in claims if k <= c[0] * BINS < k + 1 or (c[0] == 1 and k == BINS - 1)]
        if own:
            said, right = (float(np.mean([c[i] for c in own])) for i in (0, 1))
            found.append(Bin(what, len(own), said, right))
    return found


def error(table: Sequence[Bin]) -> float:
    """Expected calibration error: mean distance of said and true shares, by claims."""
    total = sum(b.claims for b in table)
    return sum(b.claims * abs(b.said - b.right) for b in table) / max(total, 1)
