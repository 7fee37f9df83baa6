"""The answer to a campaign: what is wrong, where, how sure, and how far the gap shrinks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pneugantry.engine.answer.confirm import Gap
from pneugantry.engine.answer.location import Place
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.hypotheses.catalogue import Effect
from pneugantry.engine.plant import Epoch
from pneugantry.engine.selection.trail import Step

__all__ = [
    "NORMAL",
    "Answer",
    "Cause",
    "Change",
    "Changes",
    "Diagnosis",
    "Moved",
    "Size",
    "answer_set",
    "causes_of",
    "to_json",
]

HELD = 0.95  # probability that an answer set holds
RARE = 0.005  # probability below which a hypothesis is not listed
NORMAL = 1.96  # standard deviations of a 95 % interval


@dataclass(frozen=True)
class Size:
    """A fitted parameter of an effect, with its 95 % interval."""

    value: float
    low: float
    high: float
    unit: str
    form: str


@dataclass(frozen=True)
class Cause:
    """An effect, with the probability of all hypotheses that name it."""

    effect: str
    axis: str
    probability: float
    parameters: Mapping[str, Size]
    epoch: str = ""  # the campaign that alone has it, where there are two

    @property
    def key(self) -> str:
        """As `Effect.key`."""
        name = f"{self.effect}/{self.axis}" if self.axis else self.effect
        return f"{name}@{self.epoch}" if self.epoch else name


@dataclass(frozen=True)
class Moved:
    """A parameter in two campaigns: before, after, and the change with its 95 % interval."""

    before: float
    after: float
    change: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Change:
    """What became of an effect between two campaigns. probabilities: of "came", "went", "stayed",
    "changed" (there in both, of another size) and "absent"; they sum to 1.
    """

    effect: str
    axis: str
    what: str  # the likeliest of them, "absent" aside
    probabilities: Mapping[str, float]
    parameters: Mapping[str, Moved]  # of the likeliest hypothesis, where it has the effect


@dataclass(frozen=True)
class Changes:
    """Between two campaigns of one rig; gaps: of each campaign's record that no fit saw."""

    effects: tuple[Change, ...]
    gaps: tuple[Gap, ...] = ()


@dataclass(frozen=True, eq=False)
class Answer:
    """A hypothesis with its probability. Empty: no effect; ("unknown",) stands beside others."""

    keys: tuple[str, ...]
    probability: float
    fit: Fit | None = None  # tells its parameters


@dataclass(frozen=True)
class Diagnosis:
    """Everything that a report is made of."""

    verdict: str  # "identified", "ambiguous", "unknown", "none"
    where: tuple[Place, ...]  # the largest share first
    causes: tuple[Cause, ...]  # those of the answer first
    answer_set: tuple[tuple[str, ...], ...]
    gap: Gap | None = None  # None: nothing could be replayed
    closed_loop: Mapping[str, float] | None = None  # nominal, augmented, floor, shrink
    next_experiment: Mapping[str, Any] | None = None  # "what", ..., where the answer is ambiguous
    notes: tuple[str, ...] = ()
    limits: tuple[str, ...] = ()  # what the records cannot show
    seconds: float = 0.0
    steps: tuple[Step, ...] = ()  # of the search
    probabilities: Mapping[str, float] = field(default_factory=dict)  # of "none" and "unknown"
    stages: Mapping[str, float] = field(default_factory=dict)  # s, by name
    weighed: tuple[tuple[tuple[str, ...], float], ...] = ()  # effects and cost, as decided upon
    stands_out: float = 0.0  # what the answer leaves beyond the noise, see `outstanding`
    stood_out: float | None = None  # the same channel's beside no effect; None: the answer has none
    doubtful: tuple[str, ...] = ()  # effects weighed that may only look like it
    changes: Changes | None = None  # where there are two campaigns


def causes_of(
    answers: Sequence[Answer],
    catalogue: Mapping[str, Effect],
    chosen: Sequence[str],
    temper: float,
) -> tuple[Cause, ...]:
    """Every effect that some hypothesis names; those `chosen` by the verdict come first. temper: as
    of `Chances`.
    """
    total: dict[str, float] = {}
    carrier: dict[str, Answer] = {}
    for answer in sorted(answers, key=lambda a: -a.probability):
        for key in answer.keys:
            if key in catalogue:
                total[key] = total.get(key, 0.0) + answer.probability
                carrier.setdefault(key, answer)
    ranked = sorted(total, key=lambda k: (k not in chosen, -total[k]))
    return tuple(
        Cause(
            catalogue[k].name,
            catalogue[k].axis,
            min(total[k], 1.0),
            _sizes(k, carrier[k].fit, temper),
            catalogue[k].epoch,
        )
        for k in ranked
        if k in chosen or total[k] >= RARE
    )


def _sizes(key: str, fit: Fit | None, temper: float) -> dict[str, Size]:
    """Parameters of an effect as a fit has them."""
    if fit is None:
        return {}
    form = next((f for e, f in fit.hypothesis.effects if e.key == key), None)
    if form is None:
        return {}
    fit = fit.tempered(temper)
    at = {c.name: (c, t) for c, t in zip(fit.point.coordinates, fit.point.theta, strict=True)}
    found = {}
    for p in form.parameters:
        c, theta = at[p.name]
        width = NORMAL * fit.sigma(p.name)
        ends = c.value(theta - width), c.value(theta + width)
        found[Epoch.bare(p.name)] = Size(c.value(theta), min(ends), max(ends), p.unit, form.name)
    return found


def answer_set(answers: Sequence[Answer]) -> tuple[tuple[str, ...], ...]:
    """The smallest set of hypotheses that hold 95 % together."""
    chosen: list[tuple[str, ...]] = []
    held = 0.0
    for answer in sorted(answers, key=lambda a: -a.probability):
        if held >= HELD or (chosen and answer.probability < RARE):
            break
        chosen.append(answer.keys)
        held += answer.probability
    return tuple(chosen)


def to_json(d: Diagnosis) -> dict[str, Any]:
    """The JSON of docs/reference/gap.md."""
    notes = [*d.notes, *_replay_notes(d.gap), *d.limits]
    return {
        "schema": "gap/1",
        "verdict": d.verdict,
        "where": [_place(p) for p in d.where],
        "causes": [_cause(c) for c in d.causes],
        "answer_set": [list(keys) for keys in d.answer_set],
        "gap": None if d.gap is None else _gap(d.gap),
        "closed_loop": d.closed_loop and {k: _number(v) for k, v in d.closed_loop.items()},
        "next_experiment": None if d.next_experiment is None else dict(d.next_experiment),
        "notes": notes,
        "unknown_probability": d.probabilities.get("unknown"),
        "probabilities": dict(d.probabilities),
        "steps": [
            {"effect": s.effect, "gain": _number(s.gain), "dropped": s.dropped} for s in d.steps
        ],
        "weighed": [{"effects": list(k), "cost": _number(c)} for k, c in d.weighed],
        "stands_out": _number(d.stands_out),
        "stood_out": None if d.stood_out is None else _number(d.stood_out),
        "doubtful": list(d.doubtful),
        "stages": dict(d.stages),
        "seconds": d.seconds,
        **({} if d.changes is None else {"changes": _changes(d.changes)}),
    }


def _number(value: float) -> float | None:
    """None for what JSON has no word for."""
    return float(value) if math.isfinite(value) else None


def _place(p: Place) -> dict[str, Any]:
    return {
        "block": p.block,
        "share": float(p.share),
        "logs": list(p.records),
        "regime": p.regime,
    }


def _changes(changes: Changes) -> dict[str, Any]:
    return {
        "effects": [
            {
                "effect": c.effect,
                "axis": c.axis,
                "what": c.what,
                "probabilities": dict(c.probabilities),
                "parameters": {n: _moved(m) for n, m in c.parameters.items()},
            }
            for c in changes.effects
        ],
        "gaps": [_gap(g) for g in changes.gaps],
    }


def _moved(m: Moved) -> dict[str, Any]:
    return {
        "before": _number(m.before),
        "after": _number(m.after),
        "change": _number(m.change),
        "ci95": [_number(m.low), _number(m.high)],
        "unit": m.unit,
    }


def _cause(c: Cause) -> dict[str, Any]:
    return {
        "effect": c.effect,
        "axis": c.axis,
        **({"campaign": c.epoch} if c.epoch else {}),
        "probability": float(c.probability),
        "parameters": {
            name: {
                "value": _number(s.value),
                "ci95": [_number(s.low), _number(s.high)],
                "unit": s.unit,
                "form": s.form,
            }
            for name, s in c.parameters.items()
        },
    }


def _gap(g: Gap) -> dict[str, Any]:
    early = None if g.early is None or g.parted is None else (g.parted, g.early)
    until = {} if early is None else {"until": {"t": _number(early[0]), **_gap(early[1])}}
    return {
        **until,
        "nominal": _number(g.nominal),
        "augmented": _number(g.augmented),
        "floor": _number(g.floor),
        "shrink": _number(g.shrink),
        "ci95": [_number(e) for e in g.ci95],
        "log": g.record,
    }


def _replay_notes(g: Gap | None) -> list[str]:
    """What a reader of the gap must know beside its figures."""
    if g is None:
        return []
    said = []
    if g.parted is not None:
        said.append(
            f"{g.record}: from {g.parted:.3g} s on the augmented replay has left the record"
            + (f"; up to there {g.early.nominal:.3g} → {g.early.augmented:.3g}" if g.early else "")
        )
    if g.spread is not None and g.bifurcates:
        low, high = g.spread
        said.append(
            f"{g.record}: the replay bifurcates: values that the fit does not tell apart leave "
            f"gaps from {low:.3g} to {high:.3g}"
        )
    return said
