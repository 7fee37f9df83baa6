"""A learnt term as data: for the JSON, the report and the command line."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from pneugantry.engine.answer.result import NORMAL
from pneugantry.engine.answer.result import to_json as diagnosis_json
from pneugantry.engine.plant import Array
from pneugantry.learn.learned import Learned, Tried

__all__ = ["band", "covered", "sentence", "to_json"]

POINTS = 41  # of a curve, at least
OF_A_PERIOD = 24  # of one that repeats, at least
MANY = 2001  # at most
KNOTS = 11  # at which the free curve is told
SHOWN = 90  # characters of the equation
SCREENED = 8  # pairs of equation and variable that are told
STEP = 1e-4  # of a difference quotient, in standard deviations


def covered(learned: Learned, tried: Tried) -> tuple[float, float]:
    """Range of the regressor in the fitted logs, all but one row in two hundred at each end."""
    values = np.concatenate(list(learned.screen.series[tried.term.regressor.plain].values()))
    low, high = np.quantile(values, (0.005, 0.995))
    return float(low), float(high)


def band(tried: Tried, z: Array) -> tuple[Array, Array]:
    """A fitted term over values of its regressor, and its standard deviation."""
    term, fit = tried.term, tried.fit
    names = [c.name for c in fit.point.coordinates]
    index = [names.index(n) for n in term.parameters]
    theta = fit.point.theta[index]
    coordinates = [fit.point.coordinates[i] for i in index]

    def at(moved: Array) -> Array:
        values = [c.value(t) for c, t in zip(coordinates, moved, strict=True)]
        values += [0.0] * bool(term.places)  # a wave from where it starts
        return np.asarray(term.law.law(z, values), dtype=float)

    covariance = fit.covariance[np.ix_(index, index)]
    mean, slopes = at(theta), []
    for k in range(len(index)):
        step = STEP * max(math.sqrt(covariance[k, k]), 1e-12)
        slopes.append((at(theta + step * np.eye(len(index))[k]) - mean) / step)
    j = np.column_stack(slopes)
    return mean, np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", j, covariance, j), 0.0))


def sentence(learned: Learned) -> str:
    """What was learnt, in one line."""
    if learned.best is None:
        return f"missing term: none found; {learned.why}"
    term = learned.best.term
    stands = "learnt" if learned.accepted else "not accepted"
    others = [t.term.formula() for t in learned.answers[1:]]
    told = f" (these logs do not tell it from {', '.join(others)})" if others else ""
    equation = textwrap.shorten(term.point.text, SHOWN, placeholder=" ...")
    said = (
        f"missing term ({stands}): {term.formula()}{told} in {term.block}, added to "
        f"{equation}; {learned.why}"
    )
    return said + (f"; next: {e.what}" if (e := learned.next_experiment) else "")


def to_json(learned: Learned) -> dict[str, Any]:
    """`learned` of gap/1."""
    screen = [
        {"equation": c.point.text, "component": c.point.component, "regressor": c.regressor.label}
        | {"gain": float(c.gain)}
        for c in learned.screen.candidates[:SCREENED]
    ]
    found: dict[str, Any] = {
        "accepted": learned.accepted,
        "why": learned.why,
        "sentence": sentence(learned),
        "screen": screen,
        "term": None,
        "causes": [],
        "answer_set": [],
        "gap": None,
        "next_experiment": None,
    }
    if learned.best is None or learned.after is None:
        return found
    gap = learned.after.gap
    found["term"] = _term(learned, _tempered(learned, learned.best))
    found["causes"] = diagnosis_json(learned.after.diagnosis)["causes"]
    found["answer_set"] = [_short(t) for t in learned.answers]
    if learned.next_experiment is not None:
        found["next_experiment"] = asdict(learned.next_experiment)
    if gap is not None and learned.before.gap is not None:
        found["gap"] = {
            "nominal": float(learned.before.gap.nominal),
            "without": float(learned.before.gap.augmented),
            "with": float(gap.augmented),
            "floor": float(gap.floor),
            "shrink": learned.shrink,
            "log": gap.record,
        }
    return found


def _short(tried: Tried) -> dict[str, Any]:
    term = tried.term
    return {
        "block": term.block,
        "component": term.point.component,
        "equation": term.point.text,
        "regressor": term.regressor.label,
        "form": term.law.name,
        "formula": term.formula(),
        "beside": [k for k in tried.fit.keys if k != term.effect.key],
        "cost": float(tried.cost),
    }


def _term(learned: Learned, tried: Tried) -> dict[str, Any]:
    low, high = covered(learned, tried)
    periods = (high - low) / abs(tried.term.values[1]) if tried.term.law.repeats else 0.0
    z = np.linspace(low, high, min(max(POINTS, math.ceil(OF_A_PERIOD * periods) + 1), MANY))
    if tried.term.law.memory is not None:  # there, back and there again
        z = np.concatenate([z, z[-2::-1], z[1:]])
    value, sigma = band(tried, z)
    return {
        **_short(tried),
        "parameters": _sizes(tried),
        "range": [low, high],
        "units": {"regressor": learned.units[0], "term": learned.units[1]},
        "curve": {
            "at": z.tolist(),
            "value": value.tolist(),
            "low": (value - NORMAL * sigma).tolist(),
            "high": (value + NORMAL * sigma).tolist(),
        },
        "points": _free(learned, tried, (low, high)),
    }


def _free(learned: Learned, tried: Tried, ends: tuple[float, float]) -> dict[str, Any] | None:
    """The free curve that was fitted in the same place, of the same variable and beside the same
    effects; None: there is none. A constant between both curves says nothing and is taken out.
    """
    term = tried.term
    same = [
        t
        for t in learned.tried
        if t.term.law.tables
        and (t.term.point, t.term.regressor) == (term.point, term.regressor)
        and t.fit.keys == tried.fit.keys
    ]
    if not same or term.law.tables:
        return None
    at = np.linspace(*ends, KNOTS)
    value, sigma = band(_tempered(learned, same[0]), at)
    value = value - np.median(value - band(tried, at)[0])
    low, high = value - NORMAL * sigma, value + NORMAL * sigma
    made = {"at": at, "value": value, "low": low, "high": high}
    return {k: v.tolist() for k, v in made.items()}


def _tempered(learned: Learned, tried: Tried) -> Tried:
    """With intervals as an effect's are."""
    return replace(tried, fit=tried.fit.tempered(learned.before.task.chances.temper))


def _sizes(tried: Tried) -> dict[str, Mapping[str, Any]]:
    """Parameters of the term with their 95 % intervals."""
    found: dict[str, Mapping[str, Any]] = {}
    point = tried.fit.point
    known = {c.name: (c, t) for c, t in zip(point.coordinates, point.theta, strict=True)}
    for name in tried.term.parameters:
        c, theta = known[name]
        width = NORMAL * tried.fit.sigma(name)
        ends = sorted((float(c.value(theta - width)), float(c.value(theta + width))))
        found[name] = {"value": float(c.value(theta)), "ci95": ends}
    return found
