"""From trials to a verdict: hypotheses weighed against each other, "nothing" and "unknown" among
them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pneugantry.diagnosis.bench import Choice, Outcome
from pneugantry.diagnosis.evidence import (
    QUIET,
    Search,
    Trial,
    advantage,
    excess,
    misfit,
    steady_strength,
    strength,
)
from pneugantry.engine.catalogue import Effect

__all__ = ["Decision", "Hypothesis", "Weights", "decide"]


CONTESTANTS = 16  # hypotheses by evidence that are held against each other


@dataclass(frozen=True)
class Weights:
    """How evidence becomes probability."""

    temperature: float = 0.5  # evidence is optimistic: functional forms differ from the rig's
    single_cost: float = 12.0  # evidence that an effect must bring
    pair_cost: float = 16.0  # and a second one besides
    # further evidence that it must bring where readings are coarse: what they leave is not white
    coarse_cost: float = 20.0
    outside_cost: float = (
        10.0  # further evidence that a rough form of what the catalogue lacks must bring
    )
    unknown_share: float = (
        0.20  # share of a block's misfit left unexplained at which "unknown" is as likely as not
    )
    timing_share: float = (
        0.02  # the same in the timing, where a controller that is known leaves nothing
    )
    unknown_slope: float = 3.0
    unknown_least: float = 10.0  # evidence of that misfit, below which nothing is made of it
    unknown_excess: float = 0.1  # and mean square beyond the floor
    friction_excess: float = (
        1.0  # the same in z's friction, where one missed break-away makes as much
    )
    # one claim in fifty was wrong on development cases even where nothing spoke against it
    cap: float = 0.98

    def unknown(self, view: str, share: float, excess: float) -> float:
        """Probability that a misfit of this share of the view's, and of this size, comes from
        outside the catalogue.
        """
        least_share = self.timing_share if view == "timing" else self.unknown_share
        least_excess = self.friction_excess if view == "friction_z" else self.unknown_excess
        odds = [
            (least / max(value, 1e-9)) ** self.unknown_slope
            for value, least in ((share, least_share), (excess, least_excess))
        ]
        return 1.0 / ((1.0 + odds[0]) * (1.0 + odds[1]))

    def cost(self, choice: Choice | None) -> float:
        """Evidence that a hypothesis must bring."""
        if choice is None:
            return 0.0
        effects = (0.0, self.single_cost, self.single_cost + self.pair_cost)[len(choice.effects)]
        return effects + self.outside_cost * len(choice.outside)


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects (none: nothing beyond tolerance) with its probability."""

    keys: tuple[str, ...]
    probability: float
    trial: Trial | None


@dataclass
class Decision:
    verdict: str  # identified, ambiguous, unknown, none
    hypotheses: list[Hypothesis]  # of catalogue effects, by probability, falling
    best: Trial | None
    unexplained: float  # share of the misfit that the best hypothesis leaves
    unknown: float  # probability that something outside the catalogue is at work
    unknown_view: str = ""
    answer_set: list[list[str]] = field(default_factory=list)
    resembles: Effect | None = None  # rough form that leads, of what the catalogue lacks
    left: frozenset[str] = (
        frozenset()
        # views in which the best hypothesis, like tolerance alone, leaves something of the fitted
        # logs
    )


def decide(
    found: Search,
    weights: Weights | None = None,
    seen: tuple[str, ...] = (),
    odd: Effect | None = None,
) -> Decision:
    """What the readings show by themselves: `seen`, effects (a coarse converter), part of every
    hypothesis; `odd`, what no catalogue holds, and then the verdict.
    """
    weights = weights or Weights()
    if seen:
        weights = replace(weights, single_cost=weights.single_cost + weights.coarse_cost)
    losses = contest(found, weights)
    total = sum(math.exp(-0.5 * weights.temperature * loss) for _, loss in losses)
    ranked = [
        Hypothesis(
            t.choice.keys if t is not None else (),
            math.exp(-0.5 * weights.temperature * loss) / total,
            t,
        )
        for t, loss in losses
    ]
    ranked.sort(key=lambda h: -h.probability)
    outside = [h for h in ranked if h.trial is not None and h.trial.choice.outside]
    ranked = [h for h in ranked if h not in outside]
    rough = sum(h.probability for h in outside)
    best = outside[0].trial if rough > 0.5 else ranked[0].trial
    # of coarse readings not even a right hypothesis leaves white noise: there, nothing is made of
    # what remains
    left, share, view = unexplained(found, best, weights) if not seen else (0.0, 0.0, "")
    if odd is not None:
        left, share, view = max(left, weights.cap), 0.0, ""
    unknown = left + (1 - left) * rough
    ranked = [
        Hypothesis((*h.keys, *seen), h.probability * (1 - left) * weights.cap, h.trial)
        for h in ranked
    ]
    verdict = (
        "unknown"
        if unknown > 0.5
        else "none"
        if best is None and not seen and ranked[0].probability > 0.5
        else "identified"
        if ranked[0].probability > 0.6
        else "ambiguous"
    )
    resembles = odd or (
        outside[0].trial.choice.outside[0] if rough > 0.5 and outside[0].trial is not None else None
    )
    return Decision(
        verdict,
        ranked,
        best,
        share,
        unknown,
        view,
        _answers(ranked, unknown),
        resembles,
        _left_views(found, best, weights),
    )


def _answers(ranked: list[Hypothesis], unknown: float) -> list[list[str]]:
    """The likeliest hypotheses, "unknown" among them, until they hold 95 %."""
    answers: list[list[str]] = []
    held = 0.0
    for item in sorted(
        [*ranked, Hypothesis(("unknown",), unknown, None)], key=lambda h: -h.probability
    ):
        if held >= 0.95 or item.probability < 0.005:
            break
        answers.append(list(item.keys))
        held += item.probability
    return answers


def contest(found: Search, weights: Weights | None = None) -> list[tuple[Trial | None, float]]:
    """Hypotheses (None: nothing beyond tolerance), each with what its strongest opponent has over
    it, 0 if none has.

    Evidence that is cut is not additive: two hypotheses are compared by the mean of what one has
    over the other directly, and of what each has over tolerance alone, besides what the log that no
    fit has seen says.
    """
    weights = weights or Weights()
    # a fit that leaves more than tolerance alone had stuck, and what it leaves of the held-out log
    # is luck
    better = [t for t in (*found.singles, *found.pairs) if t.gain > 0]
    by_gain = sorted(better, key=lambda t: -t.gain)[:CONTESTANTS]
    by_standing = sorted(
        (t for t in found.singles if t.gain > 0), key=lambda t: -advantage(found, t.outcome, None)
    )[: CONTESTANTS // 2]
    field: list[Trial | None] = [None, *by_gain, *(t for t in by_standing if t not in by_gain)]
    standing = [advantage(found, t.outcome, None) if t is not None else 0.0 for t in field]
    losses = [0.0] * len(field)
    for i, a in enumerate(field):
        for j, b in enumerate(field[:i]):
            if a is None:
                continue
            cost = weights.cost(a.choice) - weights.cost(b.choice if b is not None else None)
            direct = advantage(found, a.outcome, b.outcome) if b is not None else standing[i]
            unseen = _held_out(a.held_out, b.held_out if b is not None else found.held_out)
            ahead = 0.5 * (direct + standing[i] - standing[j]) + unseen - cost
            losses[i], losses[j] = max(losses[i], -ahead), max(losses[j], ahead)
    return [(t, losses[i]) for i, t in enumerate(field)]


def _held_out(better: Outcome | None, worse: Outcome | None) -> float:
    """Evidence of one hypothesis over another on the log that no fit has seen: nothing is fitted
    there, so nothing is charged.
    """
    if better is None or worse is None:
        return 0.0
    total = 0.0
    for view in better.views:
        length = min(better, worse, key=lambda outcome: outcome.squares[view]).lengths[view]
        total += steady_strength(worse.surprise(view, length) - better.surprise(view, length))
    return total


def unexplained(found: Search, best: Trial | None, weights: Weights) -> tuple[float, float, str]:
    """Probability that what the best hypothesis leaves in its worst view comes from outside the
    catalogue, its share of the misfit under tolerance alone, and the view ("" where nothing is
    left).
    """
    worst = (0.0, 0.0, "")
    named = best.choice.parameter_names if best is not None else ()
    lagging = [
        name[-1] for name in named if name.startswith("sensors.tau_v")
    ]  # axes whose speed is not known at impacts
    unseen = {view for axis in lagging for view in (f"friction_{axis}", "contact")}
    for view in sorted(set(found.null) - unseen):
        pairs = (
            [(found.null[view], _outcome_in(found, best, view))] if view in found.troubled else []
        )
        if found.held_out is not None:
            pairs.append((found.held_out, _unseen(found, best) or found.held_out))
        seen = [_remains(outcome, view) for _, outcome in pairs]
        if view.startswith("friction") and (
            min(seen, default=0.0) <= weights.unknown_least / 3 or len(seen) < 2
        ):
            pairs = (
                pairs[:1] if view in found.troubled else []
            )  # in one log alone it may be a break-away's luck
            seen = seen[:1]
        if sum(seen[: len(pairs)]) <= weights.unknown_least:
            continue
        for before, outcome in pairs:
            left = _excess(outcome, view, apart=1)
            share = left / max(_excess(before, view, apart=1), 1e-9)
            worst = max(worst, (weights.unknown(view, share, left), share, view))
    return worst


def _left_views(found: Search, best: Trial | None, weights: Weights) -> frozenset[str]:
    return frozenset(
        view
        for view, null in found.null.items()
        if min(_remains(null, view), _remains(_outcome_in(found, best, view), view))
        > weights.unknown_least
    )


def _remains(outcome: Outcome, view: str) -> float:
    """Evidence that something is left in a view. In friction what stands out of the stretches
    counts little: a missed break-away.
    """
    beyond = misfit(outcome, view)
    if beyond <= QUIET:
        return 0.0
    if view.startswith("friction"):
        return max(0.0, strength(excess(outcome, view)))
    return (
        beyond - float(outcome.blocks[view].max()) / outcome.lengths[view]
    )  # one stretch alone is no effect


def _outcome_in(found: Search, best: Trial | None, view: str) -> Outcome:
    return best.outcome if best is not None and view in best.outcome.views else found.null[view]


def _unseen(found: Search, best: Trial | None) -> Outcome | None:
    """What a hypothesis leaves on the log that no fit has seen; tolerance alone, where it was not
    examined.
    """
    return best.held_out if best is not None and best.held_out is not None else found.held_out


def _excess(outcome: Outcome, view: str, apart: int = 0) -> float:
    """Mean square beyond the floor, without the stretches, `apart` in number, that
    stand out most.
    """
    squares = outcome.squares[view] - float(np.sort(outcome.blocks[view])[::-1][:apart].sum())
    return max(0.0, squares / max(outcome.counts[view], 1) - outcome.floor.get(view, 1.0) ** 2)


def contributions(found: Search, decision: Decision, blocks: Mapping[str, str]) -> dict[str, float]:
    """Gain per block: what each effect of the best hypothesis explains, and what stays unexplained
    where.
    """
    result: dict[str, float] = {}
    if decision.best is not None:
        keys = decision.best.choice.keys
        singles = {
            t.choice.keys[0]: max(t.gain, 0.0) for t in found.singles if len(t.choice.keys) == 1
        }
        for key in keys:
            if key not in singles and len(keys) == 1:
                singles[key] = decision.best.gain
            others = sum(singles.get(k, 0.0) for k in keys if k != key)
            result[blocks[key]] = result.get(blocks[key], 0.0) + max(
                decision.best.gain - others, 0.05 * decision.best.gain, 1e-6
            )
    return result
