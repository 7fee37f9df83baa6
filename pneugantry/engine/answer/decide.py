"""From fits to probabilities and a verdict.

Evidence of simulations is overconfident: a model that is a little wrong everywhere misfits a little
in every row, and the rows agree. So evidence counts by a share of it (`Chances.temper`), and what
no catalogue explains is judged by how far residuals stand out of the sensors' noise. These few
numbers are fitted to campaigns whose truth is known (`python -m benchmarks.calibrate`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pneugantry.engine.answer.confirm import Gap
from pneugantry.engine.answer.result import Answer
from pneugantry.engine.chances import Chances
from pneugantry.engine.fitting.fit import Fit, deviations
from pneugantry.engine.plant import Array
from pneugantry.engine.selection.excess import Channel, Excess

__all__ = [
    "SURE",
    "UNKNOWN",
    "Belief",
    "Decision",
    "Evidence",
    "Outstanding",
    "Weighed",
    "beliefs",
    "decide",
    "outstanding",
    "shares",
    "stands_out",
]

UNKNOWN = "unknown"
SURE = 0.5  # probability from which a verdict claims something
CLEAR = 0.8  # probability that each of its effects needs for an answer to be identified


@dataclass(frozen=True, eq=False)
class Evidence:
    """A fit and what speaks for it: -2 log evidence, the record that no fit saw included."""

    fit: Fit
    cost: float


@dataclass(frozen=True, eq=False)
class Decision:
    """Hypotheses by their probability, the likeliest first."""

    verdict: str
    answers: tuple[Answer, ...]
    chosen: tuple[str, ...]  # effects that the verdict claims
    none: float  # probability that nothing is wrong
    unknown: float  # probability that something is that the catalogue lacks
    best: Fit  # of the likeliest hypothesis
    imitated: float = 0.0  # of `unknown`, what is a curve of an effect over another variable

    @property
    def located(self) -> Fit:
        """Whose effects tell where the gap lies: those of the likeliest hypothesis; where that has
        none and is not believed, of the likeliest that has some.
        """
        if self.best.keys or self.verdict != "ambiguous":
            return self.best
        return next((a.fit for a in self.answers if a.keys and a.fit), self.best)


@dataclass(frozen=True)
class Outstanding:
    """What stands out most of noise and tolerance. Scores are logarithms of how far."""

    score: float
    channel: Channel | None = None  # that shows it; None: a replay or a bent parameter does
    before: float | None = None  # score of the same channel beside no effect, where one is there


def outstanding(
    left: Sequence[Excess],
    chances: Chances,
    gap: Gap | None = None,
    fit: Fit | None = None,
    null: Excess | None = None,
) -> Outstanding:
    """How far the channel that stands out most does so: log of its ratio to the usual one. left: of
    the fitted records, then of others. Or how far the replay of a record that no fit saw does, as
    far as a view of such a record does, too (else it has missed an event), under the luckiest of
    the values that the fit leaves open and beyond how far these differ. Or how far beyond tolerance
    a fit without effects has bent a parameter (beside an effect it may be the effect's other side).
    null: of the fitted records beside no effect, where `left` is beside one.
    """
    fitted, *others = left
    found = [_loudest([fitted], chances, null)]
    if gap is not None and gap.parted is None and not gap.bifurcates:
        least = min(gap.augmented, gap.spread[0] if gap.spread else gap.augmented)
        far = least / math.hypot(max(gap.floor, 1e-9), gap.open) / chances.replayed
        replayed = chances.replay * math.log(max(far, 1e-9))
        shown = _loudest(others, chances, null)
        found.append(replace(shown, score=min(replayed, shown.score)))
    if fit is not None and not fit.keys:
        largest = max((abs(x) for x in deviations(fit.point).values()), default=0.0)
        found.append(Outstanding(chances.bent * (largest - chances.bent_from), None))
    return max(found, key=lambda o: _beyond(o, chances))


def _loudest(left: Sequence[Excess], chances: Chances, null: Excess | None) -> Outstanding:
    """The channel that stands out most."""
    usual = chances.usual or {}

    def score(excess: Excess, c: Channel) -> float:
        return math.log(max(excess.ratio(c), 1e-9) / usual.get(c, 1.0))

    found = [
        Outstanding(
            score(excess, c), c, score(null, c) if null is not None and c in null.whole else None
        )
        for excess in left
        for c in excess.whole
    ]
    return max(found, key=lambda o: _beyond(o, chances), default=Outstanding(0.0))


def _beyond(left: Outstanding, chances: Chances) -> float:
    """Log odds of something that the catalogue lacks. An effect of another form than the model's
    leaves a share of what it has done; what only looks like one leaves more.
    """
    at = chances.unknown_at
    if left.before is not None:
        stood = max(math.expm1(2 * left.before), 0.0)
        at = max(at, math.log1p(chances.unknown_left * stood) / 2)
    return (left.score - at) / (chances.unknown_per * at / chances.unknown_at)


Weighed = tuple[tuple[str, ...], float]  # effects, cost


def shares(weighed: Sequence[Weighed], chances: Chances) -> Array:
    """Probability of each hypothesis among all that the catalogue has."""
    costs = np.array([cost + chances.entry * len(keys) for keys, cost in weighed])
    weights = np.exp(-(costs - costs.min()) / (2 * chances.temper))
    return np.asarray(weights / weights.sum())


def stands_out(left: Outstanding, chances: Chances) -> float:
    """Probability that what stands out is something that the catalogue lacks."""
    return 1 / (1 + math.exp(min(-_beyond(left, chances), 700.0)))


Belief = tuple[frozenset[str], bool]  # effects, and whether there is something unknown besides


def beliefs(
    weighed: Sequence[Weighed],
    left: Outstanding,
    doubtful: Collection[str],
    chances: Chances,
    least: float = 0.0,
) -> dict[Belief, float]:
    """What may be wrong, with its probability; they sum to 1. Something unknown shows where what is
    `left` stands out; of `doubtful` effects, which may only look like it, all or none are then
    there. Or it hides behind one effect that imitates it, the more likely the more there are; where
    it was weighed itself, among the effects of a hypothesis, it is there.
    least: probability that something stands out has at least.
    """
    among = shares(weighed, chances)
    likeliest = weighed[int(np.argmax(among))][0]
    if not likeliest:
        left = replace(left, before=None)
    out = max(stands_out(left, chances), least)
    found: dict[Belief, float] = {}
    for (named, _), share in zip(weighed, map(float, among), strict=True):
        keys = frozenset(named) - {UNKNOWN}
        if len(keys) < len(named):
            found[keys, True] = found.get((keys, True), 0.0) + share
            continue
        true = (1 - chances.imitated) ** len(keys)
        kept = keys - frozenset(doubtful)
        for belief, part in (
            ((keys, False), (1 - out) * true),
            *(((keys - {k}, True), (1 - out) * (1 - true) / len(keys)) for k in keys),
            ((keys, True), out * chances.beside),
            ((kept, True), out * (1 - chances.beside)),
        ):
            found[belief] = found.get(belief, 0.0) + share * part
    return found


def decide(
    found: Sequence[Evidence],
    left: Outstanding,
    chances: Chances,
    *,
    worse: bool = False,
    doubtful: Collection[str] | None = None,
    imitators: Sequence[Weighed] = (),
) -> Decision:
    """left: by the likeliest fit (`outstanding`). worse: whether its replay leaves a
    larger gap than the nominal one, so that it explains nothing. doubtful: effects that may only
    look like what stands out; None: any. imitators: hypotheses with something unknown that no fit
    stands for.
    """
    by_keys: dict[tuple[str, ...], Evidence] = {}
    for e in found:
        name = tuple(sorted(e.fit.keys))
        if name not in by_keys or e.cost < by_keys[name].cost:
            by_keys[name] = e
    kept = list(by_keys.values())
    weighed = [*((tuple(e.fit.keys), e.cost) for e in kept), *imitators]
    best = min(kept, key=lambda e: e.cost + chances.entry * len(e.fit.keys)).fit
    if doubtful is None:
        doubtful = {key for e in kept for key in e.fit.keys}
    found_by = {frozenset(e.fit.keys): e.fit for e in kept}
    believed = beliefs(weighed, left, doubtful, chances, CLEAR if worse else 0.0)
    answers = [
        Answer((*sorted(keys), UNKNOWN) if odd else found_by[keys].keys, p, found_by.get(keys))
        for (keys, odd), p in believed.items()
        if p > 0
    ]
    answers.sort(key=lambda a: -a.probability)
    unknown = sum(p for (_, odd), p in believed.items() if odd)
    # a further effect that may be there takes nothing away; something unknown in its place does
    holding = [sum(a.probability for a in answers if k in a.keys) for k in best.keys]
    known = min(holding, default=1.0)
    none = next((a.probability for a in answers if not a.keys), 0.0)
    if unknown > SURE:
        verdict = UNKNOWN
    elif not best.keys:  # several hypotheses may outweigh it together
        verdict = "none" if none >= SURE else "ambiguous"
    else:
        verdict = "identified" if known >= CLEAR else "ambiguous"
    imitated = float(shares(weighed, chances)[len(kept) :].sum())
    return Decision(verdict, tuple(answers), best.keys, none, unknown, best, imitated)
