"""Tables and sentences of the page, from a diagnosis as it was made."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from hashlib import sha256
from importlib.metadata import version
from typing import Any

from pneugantry.engine.answer.decide import UNKNOWN
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.run import Found
from pneugantry.engine.views.foreign import ForeignPlant
from pneugantry.report.headline import (
    cause_name,
    chance,
    confirmed,
    interval,
    leaves,
    number,
)

__all__ = [
    "Deviation",
    "Left",
    "Ranked",
    "label",
    "left_over",
    "made",
    "next_steps",
    "parameter_rows",
    "rivals",
    "runner_up",
    "summaries",
    "tolerance",
]

NOTHING = "no effect (tolerance and noise alone)"
OUTSIDE = "something that the catalogue lacks"
MOST = 10  # hypotheses that are listed
LEAST = 0.005  # probability from which on one is
UNUSUAL = 3.0  # standard deviations of tolerance that are worth a mark


def label(keys: Sequence[str]) -> str:
    """A hypothesis in words."""
    return " + ".join(OUTSIDE if k == UNKNOWN else k for k in keys) or NOTHING


def summaries(found: Found) -> dict[str, str]:
    """What the effects of the answer are, in words, by their keys."""
    catalogue = found.task.catalogue
    return {k: catalogue[k].summary for k in found.final.decision.chosen if k in catalogue}


# ---------------------------------------------------------------- which


@dataclass(frozen=True)
class Ranked:
    """A hypothesis as the page lists it."""

    text: str
    probability: float
    gain: float | None  # evidence over tolerance alone


def rivals(found: Found) -> list[Ranked]:
    """Hypotheses that are worth a line, the likeliest first."""
    kept = [a for i, a in enumerate(found.decision.answers) if a.probability >= LEAST or i == 0]
    return [
        Ranked(label(a.keys), a.probability, None if a.fit is None else gain_of(found, a.fit))
        for a in kept[:MOST]
    ]


def gain_of(found: Found, fit: Fit) -> float:
    """Fall of -2 log evidence over the fitted records, against tolerance alone."""
    return found.search.null.evidence - fit.evidence


def runner_up(found: Found) -> str:
    """The second set of effects, and how far behind it is."""
    ranked: dict[tuple[str, ...], tuple[float, Fit]] = {}
    for answer in found.decision.answers:
        keys = tuple(k for k in answer.keys if k != UNKNOWN)
        if answer.fit is not None:
            total, _ = ranked.get(keys, (0.0, answer.fit))
            ranked[keys] = (total + answer.probability, answer.fit)
    first, *others = sorted(ranked.items(), key=lambda item: -item[1][0])
    if not others:
        return ""
    keys, (probability, fit) = others[0]
    behind = gain_of(found, first[1][1]) - gain_of(found, fit)
    text = f"Runner-up: {label(keys)}, probability {chance(probability)}; over the fitted logs "
    gains = f"{number(gain_of(found, fit), 4)} against {number(gain_of(found, first[1][1]), 4)}"
    if behind > 0:
        return f"{text}its evidence is {gains}, {number(behind)} less."
    return f"{text}its evidence is {gains}; but a further effect must bring more than it does."


def parameter_rows(
    causes: Sequence[Mapping[str, Any]], chosen: Sequence[str]
) -> list[dict[str, Any]]:
    """Fitted parameters of the causes of a result's JSON, with digits that tell the ends of their
    intervals apart.
    """
    rows = []
    for cause in causes:
        key = cause_name(cause)
        for name, entry in cause["parameters"].items():
            low, high = (math.nan if e is None else e for e in entry["ci95"])
            value = math.nan if entry["value"] is None else entry["value"]
            wide = not math.isfinite(high - low) or high - low > max(abs(value), 1e-300)
            told = dict(zip(("value", "low", "high"), interval(value, low, high), strict=True))
            unit = "" if entry["unit"] == "1" else entry["unit"]
            form = entry.get("form", "")
            rows.append(
                {"effect": key, "name": name, "chosen": key in chosen, "wide": wide, "unit": unit}
                | {"form": form, **told}
            )
    return rows


# ---------------------------------------------------------------- what every rig has somewhat off


@dataclass(frozen=True)
class Deviation:
    """A nuisance as it was fitted."""

    name: str
    record: str  # empty: of all records
    nominal: float
    value: float
    deviations: float  # in standard deviations of its prior

    @property
    def off(self) -> float:
        """Share of the nominal value; NaN where that is 0."""
        return self.value / self.nominal - 1.0 if self.nominal else math.nan

    @property
    def unusual(self) -> bool:
        return abs(self.deviations) > UNUSUAL


def tolerance(found: Found) -> list[Deviation]:
    """Nuisances of the answer's fit, those that stand out most first."""
    point = found.decision.best.point
    rows = [
        Deviation(c.parameter, c.record or "", c.centre, c.value(t), float(t / c.spread))
        for c, t in zip(point.coordinates, point.theta, strict=True)
        if not c.effect
    ]
    return sorted(rows, key=lambda d: -abs(d.deviations))


@dataclass(frozen=True)
class Left:
    """What the answer leaves in one signal of one view."""

    block: str
    signal: str
    ratio: float  # size over that of the sensors' noise, brought through the view
    usual: float  # of a sound rig
    record: str  # that holds most of it
    worst: float  # ratio there
    stands_out: bool


def left_over(found: Found) -> list[Left]:
    """By view and signal, the largest first."""
    excess, chances = found.excess, found.task.chances
    blocks = {
        (v.name, s): b for v in found.task.views for s, b in zip(v.signals, v.blocks, strict=True)
    }
    usual = chances.usual or {}
    rows = []
    for channel in excess.whole:
        size = excess.usual(channel)
        own = {r: s / size for (c, r), s in excess.by_record.items() if c == channel}
        record = max(own, key=lambda r: own[r], default="")
        ratio = excess.ratio(channel)
        expected = usual.get(channel, 1.0)
        out = math.log(max(ratio, 1e-9) / expected) > chances.unknown_at
        rows.append(
            Left(
                blocks.get(channel, channel[0]),
                channel[1],
                ratio,
                expected,
                record,
                own.get(record, math.nan),
                out,
            )
        )
    return sorted(rows, key=lambda r: -r.ratio)


# ---------------------------------------------------------------- what to do, and how it was made


def next_steps(facts: dict[str, Any], learned: Mapping[str, Any] | None, source: str) -> list[str]:
    """What to do with the answer `facts`, of schema gap/1. learned: the missing term, where it was
    looked for; source: what `pneugantry diagnose` was given.
    """
    verdict = facts["verdict"]
    if confirmed(facts) is False:
        return [
            "Record the held-out experiment once more, and diagnose again.",
            "Look at the signals below where the augmented plant leaves the measured ones.",
        ]
    command = f"pneugantry diagnose {source}" if source else "The same command with"
    plan = f"pneugantry plan {source}" if source else "pneugantry plan"
    augmented = f"{command} --augmented out/ writes the plant with the"
    if learned is not None and learned["accepted"]:
        return [f"{augmented} learnt term, as Modelica and FMU: simulate with that one."]
    look = "Look in the strip and the signals below where and when the residual is large."
    return {
        "none": ["Use the model as it is; its fitted tolerance stands below."],
        "identified": [
            f"{augmented} effect, as Modelica and FMU: simulate with that one.",
            *([look] if leaves(facts) else []),
            "Fix the cause on the rig if it can be fixed, record again: the verdict should be "
            "none.",
        ],
        "ambiguous": [
            "Run the next experiment below and add its log."
            if facts.get("next_experiment")
            else f"{plan} tells which effects these logs tell apart: record what it lacks."
        ],
        "unknown": [
            look,
            "Describe the effect in a catalogue of your own (--catalogue) and diagnose again.",
        ],
    }.get(verdict, [])


def made(found: Found) -> str:
    """Date, version and the model's hash, by which a page can be made again."""
    plant = found.task.plant
    files = [f.file.path for f in plant.fmus] if isinstance(plant, ForeignPlant) else [plant.model]
    told = ", ".join(
        f"{p.name} sha256 {sha256(p.read_bytes()).hexdigest()[:16]}" for p in files if p.is_file()
    )
    now = f"{datetime.now().astimezone():%Y-%m-%d %H:%M}"
    return f"{now} by pneugantry {version('pneugantry')}{f', {told}' if told else ''}"
