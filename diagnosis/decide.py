"""From trials to a verdict: hypotheses weighed against each other, "nothing" and "unknown" among them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from diagnosis.bench import Outcome
from diagnosis.search import QUIET, Search, Trial, advantage, excess, misfit, strength

__all__ = ["Decision", "Hypothesis", "Weights", "decide"]


@dataclass(frozen=True)
class Weights:
    """How evidence becomes probability."""

    temperature: float = 0.5  # evidence is optimistic: functional forms differ from the rig's
    single_cost: float = 8.0  # evidence that an effect must bring
    pair_cost: float = 16.0  # and a second one besides
    unknown_share: float = 0.10  # share of a block's misfit left unexplained at which "unknown" is as likely as not
    unknown_slope: float = 3.0
    unknown_least: float = 30.0  # evidence of that misfit, below which nothing is made of it
    cap: float = 0.99

    def cost(self, effects: int) -> float:
        return (0.0, self.single_cost, self.single_cost + self.pair_cost)[effects]


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects (none: nothing beyond tolerance) with its probability."""

    keys: tuple[str, ...]
    probability: float
    trial: Trial | None


@dataclass
class Decision:
    verdict: str  # identified, ambiguous, unknown, none
    hypotheses: list[Hypothesis]  # by probability, falling
    best: Trial | None
    unexplained: float  # share of the misfit that the best hypothesis leaves
    unknown: float  # probability that something outside the catalogue is at work
    unknown_view: str = ""
    answer_set: list[list[str]] = field(default_factory=list)


def decide(found: Search, weights: Weights | None = None, seen: tuple[str, ...] = ()) -> Decision:
    """`seen`: effects that the readings show by themselves (a coarse converter), part of every hypothesis."""
    weights = weights or Weights()
    if not found.troubled:
        alone = Hypothesis(seen, weights.cap, None)
        return Decision("identified" if seen else "none", [alone], None, 0.0, 1.0 - weights.cap, "", [list(seen)])
    trials = [*found.singles, *found.pairs]
    top = max(trials, key=lambda t: t.gain, default=None)
    if top is None:
        raw: list[tuple[tuple[str, ...], float, Trial | None]] = [((), 0.0, None)]
    else:
        lead = advantage(found, top.outcome, None)
        ahead: list[tuple[tuple[str, ...], float, Trial | None]] = [((), lead, None)]
        for t in trials:  # no nearer than what it has over tolerance alone
            ahead.append((t.choice.keys, max(advantage(found, top.outcome, t.outcome), lead - advantage(found, t.outcome, None)), t))
        raw = [(keys, -0.5 * weights.temperature * (behind + weights.cost(len(keys))), t) for keys, behind, t in ahead]
    most = max(score for _, score, _ in raw)
    total = sum(math.exp(max(-700.0, score - most)) for _, score, _ in raw)
    ranked = [Hypothesis(keys, math.exp(max(-700.0, score - most)) / total, t) for keys, score, t in raw]
    ranked.sort(key=lambda h: -h.probability)
    best = ranked[0].trial
    share, view = unexplained(found, best, weights.unknown_least)
    unknown = 1.0 / (1.0 + (weights.unknown_share / max(share, 1e-6)) ** weights.unknown_slope) if view else 0.0
    ranked = [Hypothesis((*h.keys, *seen), h.probability * (1 - unknown) * weights.cap, h.trial) for h in ranked]
    answers, held = [], 0.0
    for item in [*ranked, Hypothesis(("unknown",), unknown, None)] if unknown < 0.5 else [Hypothesis(("unknown",), unknown, None), *ranked]:
        if held >= 0.95 or item.probability < 0.005:
            break
        answers.append(list(item.keys))
        held += item.probability
    verdict = (
        "unknown"
        if unknown > 0.5
        else "none"
        if best is None and not seen
        else "identified"
        if ranked[0].probability > 0.6
        else "ambiguous"
    )
    return Decision(verdict, ranked, best, share, unknown, view, answers)


def unexplained(found: Search, best: Trial | None, least: float = Weights.unknown_least) -> tuple[float, str]:
    """Share of the misfit under tolerance alone that the best hypothesis leaves, at its worst view, and that view."""
    worst, name = 0.0, ""
    for view in found.troubled:
        before = _excess(found.null[view], view)
        outcome = best.outcome if best is not None and view in best.outcome.views else found.null[view]
        if misfit(outcome, view) <= QUIET or strength(excess(found, outcome, view)) <= least:
            continue
        share = _excess(outcome, view) / max(before, 1e-9)
        if share > worst:
            worst, name = share, view
    return worst, name


def _excess(outcome: Outcome, view: str) -> float:
    return max(0.0, outcome.squares[view] / max(outcome.counts[view], 1) - outcome.floor.get(view, 1.0) ** 2)


def contributions(found: Search, decision: Decision, blocks: Mapping[str, str]) -> dict[str, float]:
    """Gain per block: what each effect of the best hypothesis explains, and what stays unexplained where."""
    result: dict[str, float] = {}
    if decision.best is not None:
        keys = decision.best.choice.keys
        singles = {t.choice.keys[0]: max(t.gain, 0.0) for t in found.singles if len(t.choice.keys) == 1}
        for key in keys:
            if key not in singles and len(keys) == 1:
                singles[key] = decision.best.gain
            others = sum(singles.get(k, 0.0) for k in keys if k != key)
            result[blocks[key]] = result.get(blocks[key], 0.0) + max(decision.best.gain - others, 0.05 * decision.best.gain, 1e-6)
    return result
