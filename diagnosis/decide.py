"""From trials to a verdict: hypotheses weighed against each other, "nothing" and "unknown" among them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from diagnosis.bench import Outcome
from diagnosis.search import QUIET, Search, Trial, advantage, excess, misfit, strength

__all__ = ["Decision", "Hypothesis", "Weights", "decide"]


CONTESTANTS = 16  # hypotheses by evidence that are held against each other


@dataclass(frozen=True)
class Weights:
    """How evidence becomes probability."""

    temperature: float = 0.5  # evidence is optimistic: functional forms differ from the rig's
    single_cost: float = 10.0  # evidence that an effect must bring
    pair_cost: float = 24.0  # and a second one besides
    unknown_share: float = 0.20  # share of a block's misfit left unexplained at which "unknown" is as likely as not
    unknown_slope: float = 3.0
    unknown_least: float = 10.0  # evidence of that misfit, below which nothing is made of it
    unknown_excess: float = 1.0  # and mean square beyond the floor
    cap: float = 0.99

    def unknown(self, share: float, excess: float) -> float:
        """Probability that a misfit of this share of the block's, and of this size, comes from outside the catalogue."""
        odds = [
            (least / max(value, 1e-9)) ** self.unknown_slope
            for value, least in ((share, self.unknown_share), (excess, self.unknown_excess))
        ]
        return 1.0 / ((1.0 + odds[0]) * (1.0 + odds[1]))

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
    contest = _contest(found, weights)
    total = sum(math.exp(-0.5 * weights.temperature * loss) for _, loss in contest)
    ranked = [
        Hypothesis(t.choice.keys if t is not None else (), math.exp(-0.5 * weights.temperature * loss) / total, t) for t, loss in contest
    ]
    ranked.sort(key=lambda h: -h.probability)
    best = ranked[0].trial
    share, view = unexplained(found, best, weights.unknown_least)
    unknown = weights.unknown(share, _excess(_outcome_in(found, best, view), view)) if view else 0.0
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
        if best is None and not seen and ranked[0].probability > 0.5
        else "identified"
        if ranked[0].probability > 0.6
        else "ambiguous"
    )
    return Decision(verdict, ranked, best, share, unknown, view, answers)


def _contest(found: Search, weights: Weights) -> list[tuple[Trial | None, float]]:
    """Hypotheses (None: nothing beyond tolerance), each with what its strongest opponent has over it, 0 if none has.

    Evidence that is cut is not additive: two hypotheses are compared by the mean of what one has over the other directly, and of what
    each has over tolerance alone.
    """
    by_gain = sorted([*found.singles, *found.pairs], key=lambda t: -t.gain)[:CONTESTANTS]
    by_standing = sorted(found.singles, key=lambda t: -advantage(found, t.outcome, None))[: CONTESTANTS // 2]
    field: list[Trial | None] = [None, *by_gain, *(t for t in by_standing if t not in by_gain)]
    standing = [advantage(found, t.outcome, None) if t is not None else 0.0 for t in field]
    losses = [0.0] * len(field)
    for i, a in enumerate(field):
        for j, b in enumerate(field[:i]):
            if a is None:
                continue
            cost = weights.cost(len(a.choice.keys)) - weights.cost(len(b.choice.keys) if b is not None else 0)
            direct = advantage(found, a.outcome, b.outcome) if b is not None else standing[i]
            ahead = 0.5 * (direct + standing[i] - standing[j]) - cost
            losses[i], losses[j] = max(losses[i], -ahead), max(losses[j], ahead)
    return [(t, losses[i]) for i, t in enumerate(field)]


def unexplained(found: Search, best: Trial | None, least: float = Weights.unknown_least) -> tuple[float, str]:
    """Share of the misfit under tolerance alone that the best hypothesis leaves, at its worst view, and that view."""
    worst, name = 0.0, ""
    for view in found.troubled:
        before = _excess(found.null[view], view)
        outcome = _outcome_in(found, best, view)
        if misfit(outcome, view) <= QUIET or strength(excess(found, outcome, view)) <= least:
            continue
        share = _excess(outcome, view) / max(before, 1e-9)
        if share > worst:
            worst, name = share, view
    return worst, name


def _outcome_in(found: Search, best: Trial | None, view: str) -> Outcome:
    return best.outcome if best is not None and view in best.outcome.views else found.null[view]


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
