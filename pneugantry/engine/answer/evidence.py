"""What speaks for each hypothesis: its fit beside the others', what the records that no fit saw say
of it, and where an answer loses such a record, what keeps it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from pneugantry.engine.answer.confirm import Gap, Replay, gap_of, replays, values_on
from pneugantry.engine.answer.decide import (
    SURE,
    Evidence,
    Outstanding,
    decide,
    outstanding,
    stands_out,
)
from pneugantry.engine.answer.predict import Unseen
from pneugantry.engine.chances import Chances
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.rules import Rules
from pneugantry.engine.selection.excess import Excess, excess_of, floors_of
from pneugantry.engine.selection.search import Search
from pneugantry.engine.task import Task

__all__ = ["evidence_of", "left_by", "left_in_views", "likeliest", "settled", "vouched"]

Keys = tuple[str, ...]  # effects of a hypothesis, sorted
RIVALS = 4  # likeliest hypotheses that are also judged by the record that no fit saw
AS_WELL = 2.0  # times the gap of an answer's replay before it left a record, of one that keeps it


def evidence_of(fitter: Fitter, task: Task, unseen: Unseen, found: Search) -> list[Evidence]:
    """All that was tried; the likeliest few with what the held-out record says of them, beside the
    nuisances alone, the others with what it says of the most that they contain.

    Where that record turns the order round of two hypotheses of which one has an effect less, this
    one is fitted again from the other's optimum: it may have been in a worse one, of the same
    evidence in the records that were fitted.
    """
    temper = task.chances.temper
    fits = _compared(fitter, (*found.tried, found.null, found.best), temper)
    costs = _judged(fitter, task, unseen, fits, found.null)
    for fewer, more in _turned(_costs(fits, fitter.rules, temper), costs):
        (gone,) = set(more) - set(fewer)
        other = fitter.again(fitter.explore(fits[more].hypothesis.without(gone), fits[more]))
        tried = _judged(fitter, task, unseen, {**fits, fewer: other}, found.null)
        if tried[fewer] < costs[fewer]:
            fits, costs = {**fits, fewer: other}, tried
    return [Evidence(fit, costs[k]) for k, fit in fits.items() if _bring(k, costs)]


def _compared(fitter: Fitter, tried: Iterable[Fit], temper: float) -> dict[Keys, Fit]:
    """The best fit of each hypothesis' effects. Of the likeliest one in which all views were fitted
    together: what was fitted beside parabolas of other views has tens of -2 log evidence too much
    where it moved what they share.
    """
    by_keys = _by_keys(tried)
    fits = {k: min(own, key=lambda f: f.evidence) for k, own in by_keys.items()}
    whole: set[Keys] = set()
    rules = fitter.rules
    while new := [k for k in _rivals(_costs(fits, rules, temper), rules) if k not in whole]:
        rough = [fits[k] for k in new if not fits[k].whole]
        for made in fitter.together(fitter.again, rough, [f.hypothesis for f in rough]):
            k = tuple(sorted(made.keys))
            exact = (f for f in by_keys[k] if f.whole)
            fits[k] = min((made, *exact), key=lambda f: f.evidence)
        whole.update(new)
    return fits


def _by_keys(tried: Iterable[Fit]) -> dict[Keys, list[Fit]]:
    """Fits of each hypothesis' effects, in whichever forms."""
    found: dict[Keys, list[Fit]] = {}
    for fit in tried:
        found.setdefault(tuple(sorted(fit.keys)), []).append(fit)
    return found


def _rivals(costs: Mapping[Keys, float], rules: Rules) -> list[Keys]:
    """The likeliest, but for what is outweighed, or behind fewer of its effects by as much as one
    more must bring.
    """
    worth = [k for k in costs if _bring(k, costs, rules.effect)]
    ranked = sorted(worth, key=lambda k: costs[k])[:RIVALS]
    return [k for k in ranked if costs[k] < costs[ranked[0]] + rules.outweighed]


def _judged(
    fitter: Fitter, task: Task, unseen: Unseen, fits: Mapping[Keys, Fit], null: Fit
) -> dict[Keys, float]:
    """Costs of fits, with what records say of them that none has seen: of the likeliest, but for
    what is outweighed.
    """
    costs = before = _costs(fits, fitter.rules, task.chances.temper)
    judged: dict[Keys, float] = {(): 0.0}
    while new := [k for k in _rivals(costs, fitter.rules) if k not in judged]:
        judged = _predicted_better(unseen, {k: fits[k] for k in (*judged, *new)}, null)
        costs = {k: before[k] - judged[_most(k, judged)] for k in before}
    return costs


def _turned(before: Mapping[Keys, float], after: Mapping[Keys, float]) -> list[tuple[Keys, Keys]]:
    """The likeliest hypothesis, and each that has one of its effects less and was likelier before
    the held-out record: the fewer effects first.
    """
    more = min(after, key=lambda k: after[k])
    fewer = [k for k in after if len(k) == len(more) - 1 and set(k) < set(more)]
    return [(k, more) for k in fewer if k and before[k] < before[more]]


def _predicted_better(unseen: Unseen, fits: Mapping[Keys, Fit], null: Fit) -> dict[Keys, float]:
    """How much better each fit predicts the records that none saw than the nuisances alone."""
    own = sorted((k for k in fits if k), key=lambda k: fits[k].evidence)
    gains = unseen.gains([fits[k] for k in own], null)
    return dict.fromkeys(fits, 0.0) | dict(zip(own, gains, strict=True))


def _most(keys: Keys, judged: Collection[Keys]) -> Keys:
    """The most effects among these that were judged together."""
    return max((k for k in judged if set(k) <= set(keys)), key=len)


def _bring(keys: Keys, costs: Mapping[Keys, float], behind: float = 0.0) -> bool:
    """Whether effects bring anything beside fewer of them: else how many are tried would tell how
    likely none is. behind: cost that they may have beyond those.
    """
    return all(costs[keys] < cost + behind for k, cost in costs.items() if set(k) < set(keys))


def _costs(fits: Mapping[Keys, Fit], rules: Rules, temper: float) -> dict[Keys, float]:
    """Less what effects bring. The best of as many effects is held against the likeliest that has
    one of its effects less, else against none at all; the others of as many against that best:
    over a detour each would be doubted for more than what tells it from its rival. temper: as of
    `Chances`.
    """
    costs: dict[Keys, float] = {(): 0.0}
    for count in sorted({len(k) for k in fits} - {0}):
        level = [k for k in fits if len(k) == count]
        best = min(level, key=lambda k: fits[k].evidence)
        fewer = [k for k in costs if len(k) == count - 1 and set(k) < set(best)]
        base = min(fewer, key=lambda k: costs[k], default=())
        costs[best] = costs[base] - fits[best].gain(fits[base], rules)
        for k in level:
            costs[k] = costs[best] + (fits[best].sure_fall(fits[k], temper) if k != best else 0.0)
    return costs


def likeliest(evidence: Sequence[Evidence], task: Task) -> Fit:
    """What is answered where nothing stands out."""
    return decide(evidence, Outstanding(0.0), task.chances).best


def vouched(
    fitter: Fitter,
    task: Task,
    found: Search,
    evidence: Sequence[Evidence],
    lost: tuple[Replay, Gap] | None,
) -> list[Evidence]:
    """Where the answer's replay has left the record that no fit saw (lost: the nominal replay, and
    the answer's gap): what was tried, brings enough but for its doubt, and replays that record to
    its end as well as the answer did before it left. What few stretches carry is doubted, for it
    may not be there again; here it is.
    """
    record, answer = task.data.held_out, likeliest(evidence, task)
    if record is None or lost is None or lost[1].early is None:
        return []
    few = _whole(fitter, _doubted(found, answer, fitter.rules)[:RIVALS])
    if not few:
        return []
    nominal, gap = lost
    as_well = AS_WELL * lost[1].early.augmented
    made = replays(task.plant, record, [values_on(f, record) for f in few], task.cache)
    kept, cost = [], next(e.cost for e in evidence if e.fit is answer)
    for fit, replayed in zip(few, made, strict=True):
        own = replayed and gap_of(nominal, replayed, fitter.rules, record.period, floor=gap.floor)
        if own and own.parted is None and own.augmented < as_well:
            kept.append(Evidence(fit, cost - (answer.evidence - fit.evidence)))
    return kept


def left_in_views(fitter: Fitter, fit: Fit) -> Excess:
    """What a fit leaves in the views of the records that were fitted."""
    return excess_of(fitter, fit, floors_of(fitter, fit))


def left_by(fitter: Fitter, unseen: Unseen, fit: Fit) -> tuple[Excess, ...]:
    """What a fit leaves in the views: of the records that were fitted, then of each other one."""
    here = left_in_views(fitter, fit)
    return here, *unseen.excesses(fit, here.level)


def settled(
    fitter: Fitter,
    task: Task,
    found: Search,
    evidence: Sequence[Evidence],
    left: Excess,
    stood: Excess,
) -> list[Evidence]:
    """Where the answer leaves what stands out of noise (left: in the views, where beside no effect
    it stood out): what was tried, brings enough but for its doubt, and leaves nothing that does.
    What few stretches carry is doubted, for all may be noise there; here it is not.
    """
    answer = likeliest(evidence, task)
    if not _stands_out(left, answer, task.chances, stood):
        return []
    few = _whole(fitter, _doubted(found, answer, fitter.rules)[:RIVALS])
    leave = [left_in_views(fitter, f) for f in few]
    cost = next(e.cost for e in evidence if e.fit is answer)
    return [
        Evidence(fit, cost - (answer.evidence - fit.evidence))
        for fit, own in zip(few, leave, strict=True)
        if not _stands_out(own, fit, task.chances, stood)
    ]


def _stands_out(left: Excess, fit: Fit, chances: Chances, stood: Excess) -> bool:
    """Whether what a fit leaves in the views is rather something unknown than noise."""
    null = stood if fit.keys else None
    return stands_out(outstanding([left], chances, fit=fit, null=null), chances) > SURE


def _doubted(found: Search, answer: Fit, rules: Rules) -> list[Fit]:
    """The best fit of each hypothesis that brings enough over an answer but for its doubt, the best
    of all first.
    """
    best = (min(own, key=lambda f: f.evidence) for own in _by_keys(found.tried).values())
    return sorted(
        (f for f in best if answer.evidence - f.evidence > rules.effect * _more(f, answer)),
        key=lambda f: f.evidence,
    )


def _more(fit: Fit, answer: Fit) -> int:
    """Effects that a fit has more than an answer, at least one."""
    return max(len(fit.keys) - len(answer.keys), 1)


def _whole(fitter: Fitter, fits: Sequence[Fit]) -> list[Fit]:
    """Fits with all views fitted together."""
    return fitter.together(
        lambda f: f if f.whole else fitter.again(f), fits, [f.hypothesis for f in fits]
    )
