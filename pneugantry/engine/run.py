"""One diagnosis: from a plant, its views and its records to an answer.

Data flow one way: null fit -> search -> evidence on the record that no fit saw -> decision ->
where, and how far the gap shrinks.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from modelica_fmu.errors import RunError
from pneugantry.engine.catalogue import Effect
from pneugantry.engine.confirm import (
    Gap,
    Replay,
    draws,
    floor_of,
    gap_of,
    noise_levels,
    replays,
    values_on,
)
from pneugantry.engine.decide import Chances, Decision, Evidence, decide, outstanding
from pneugantry.engine.excess import Excess, excess_of, floors_of
from pneugantry.engine.fit import Fit
from pneugantry.engine.fitter import Fitter
from pneugantry.engine.location import where
from pneugantry.engine.plant import Data, Epoch, Plant
from pneugantry.engine.predict import Foretelling
from pneugantry.engine.result import Diagnosis, answer_set, causes_of
from pneugantry.engine.rules import Rules
from pneugantry.engine.search import Search, resumed, search
from pneugantry.engine.threads import one_blas_thread
from pneugantry.engine.views import View

__all__ = ["Found", "Task", "run"]

Say = Callable[[str], None]
CUT = "the search was cut short: trying everything beside everything would take minutes"
LEFT_OPEN = "; nothing that was tried explains all that stands out"
Keys = tuple[str, ...]  # effects of a hypothesis, sorted
BLAMED = 1.1  # times the gap with tolerance alone from which on effects make it worse
NOTABLE = 2.0  # times the floor from which on a gap is more than noise
RIVALS = 4  # likeliest hypotheses that are also judged by the record that no fit saw


@dataclass(frozen=True, eq=False)
class Task:
    """What a diagnosis is made of."""

    plant: Plant
    views: Sequence[View]
    data: Data
    catalogue: Mapping[str, Effect]
    cache: Path  # of the parts of the model
    chances: Chances = field(default_factory=Chances)
    notes: tuple[str, ...] = ()
    limits: tuple[str, ...] = ()  # what the records cannot show
    epoch: Epoch | None = None  # the campaign whose plant is told, where there are two


@dataclass(frozen=True, eq=False)
class Found:
    """The answer, and what pictures and further experiments need of its making."""

    task: Task
    diagnosis: Diagnosis
    search: Search
    evidence: tuple[Evidence, ...]  # all that was weighed
    decision: Decision
    excess: Excess  # of what the answer leaves
    nominal: Replay | None  # of the record that no fit saw (else of the last one)
    augmented: Replay | None
    gap: Gap | None
    learnt: Found | None = None  # of the plant with what it lacked, where the answer is that one's

    @property
    def final(self) -> Found:
        """Where the augmented plant and its values come from."""
        return self.learnt or self

    @property
    def values(self) -> dict[str, float]:
        """The augmented plant's, of no record in particular."""
        values = self.decision.best.values(None)
        return values if self.task.epoch is None else self.task.epoch.read(values, {})


@one_blas_thread()
def run(task: Task, rules: Rules, say: Say = lambda stage: None) -> Found:
    """Diagnoses the records of a task. say: told the name of each stage as it begins."""
    clock = _Clock()
    fitter = Fitter(task.plant, task.views, task.data.fitted, rules)
    try:
        say("tolerance")
        null = fitter.null()
        clock.lap("tolerance")
        say("search")
        found = search(fitter, null, task.catalogue)
        clock.lap("search")
        say("held-out record")
        evidence = _evidence(fitter, task, found)
        clock.lap("held-out record")
        say("confirmation")
        confirmed = _confirmed(fitter, task, found.null, _likeliest(evidence, task))
        if confirmed.lost and task.data.held_out:
            clock.lap("confirmation")
            say("search again")
            further = resumed(fitter, found, task.catalogue)
            clock.lap("search")
            if further is not found:
                say("held-out record")
                found, evidence = further, _evidence(fitter, task, further)
                clock.lap("held-out record")
                say("confirmation")
                confirmed = _confirmed(fitter, task, found.null, _likeliest(evidence, task))
        if confirmed.lost and (vouched := _vouched(fitter, task, found, evidence, confirmed)):
            evidence = [*evidence, *vouched]
            confirmed = _confirmed(fitter, task, found.null, _likeliest(evidence, task))
        return _answer(fitter, task, found, evidence, confirmed, clock)
    finally:
        fitter.close()


class _Clock:
    """Wall time by stage, s."""

    def __init__(self) -> None:
        self.start = self.last = time.perf_counter()
        self.stages: dict[str, float] = {}

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self.stages[stage] = self.stages.get(stage, 0.0) + now - self.last
        self.last = now

    @property
    def seconds(self) -> float:
        return time.perf_counter() - self.start


def _evidence(fitter: Fitter, task: Task, found: Search) -> list[Evidence]:
    """All that was tried; the likeliest few with what the held-out record says of them, beside the
    nuisances alone, the others with what it says of the most that they contain.

    Where that record turns the order round of two hypotheses of which one has an effect less, this
    one is fitted again from the other's optimum: it may have been in a worse one, of the same
    evidence in the records that were fitted.
    """
    fits = _compared(fitter, (*found.tried, found.null, found.best))
    costs = _judged(fitter, task, fits, found.null)
    for fewer, more in _turned(_costs(fits, fitter.rules), costs):
        (gone,) = set(more) - set(fewer)
        other = fitter.again(fitter.explore(fits[more].hypothesis.without(gone), fits[more]))
        tried = _judged(fitter, task, {**fits, fewer: other}, found.null)
        if tried[fewer] < costs[fewer]:
            fits, costs = {**fits, fewer: other}, tried
    return [Evidence(fit, costs[k]) for k, fit in fits.items() if _bring(k, costs)]


def _compared(fitter: Fitter, tried: Iterable[Fit]) -> dict[Keys, Fit]:
    """The best fit of each hypothesis' effects. Of the likeliest one in which all views were fitted
    together: what was fitted beside parabolas of other views has tens of -2 log evidence too much
    where it moved what they share.
    """
    by_keys: dict[Keys, list[Fit]] = {}
    for fit in tried:
        by_keys.setdefault(tuple(sorted(fit.keys)), []).append(fit)
    fits = {k: min(own, key=lambda f: f.evidence) for k, own in by_keys.items()}
    whole: set[Keys] = set()
    while new := [k for k in _rivals(_costs(fits, fitter.rules), fitter.rules) if k not in whole]:
        rough = [fits[k] for k in new if not fits[k].whole]
        for made in fitter.together(fitter.again, rough, [f.hypothesis for f in rough]):
            k = tuple(sorted(made.keys))
            exact = (f for f in by_keys[k] if f.whole)
            fits[k] = min((made, *exact), key=lambda f: f.evidence)
        whole.update(new)
    return fits


def _rivals(costs: Mapping[Keys, float], rules: Rules) -> list[Keys]:
    """The likeliest, but for what is hopelessly far behind."""
    ranked = sorted(costs, key=lambda k: costs[k])[:RIVALS]
    return [k for k in ranked if costs[k] < costs[ranked[0]] + rules.hopeless]


def _judged(fitter: Fitter, task: Task, fits: Mapping[Keys, Fit], null: Fit) -> dict[Keys, float]:
    """Costs of fits, with what records say of them that none has seen: of the likeliest, but for
    what is hopelessly far behind.
    """
    costs = before = _costs(fits, fitter.rules)
    judged: dict[Keys, float] = {(): 0.0}
    while new := [k for k in _rivals(costs, fitter.rules) if k not in judged]:
        judged = _foretold(fitter, task, {k: fits[k] for k in (*judged, *new)}, null)
        costs = {k: before[k] - judged[_most(k, judged)] for k in before}
    return costs


def _turned(before: Mapping[Keys, float], after: Mapping[Keys, float]) -> list[tuple[Keys, Keys]]:
    """The likeliest hypothesis, and each that has one of its effects less and was likelier before
    the held-out record: the fewer effects first.
    """
    more = min(after, key=lambda k: after[k])
    fewer = [k for k in after if len(k) == len(more) - 1 and set(k) < set(more)]
    return [(k, more) for k in fewer if k and before[k] < before[more]]


def _foretold(fitter: Fitter, task: Task, fits: Mapping[Keys, Fit], null: Fit) -> dict[Keys, float]:
    """How much better each fit foretells the records that none saw than the nuisances alone."""
    found = dict.fromkeys(fits, 0.0)
    own = sorted((k for k in fits if k), key=lambda k: fits[k].evidence)
    for held in task.data.unseen if own else ():
        foretelling = Foretelling(fitter, task.views, held)
        try:
            gains = foretelling.gains([fits[k] for k in own], null)
        finally:
            foretelling.close()
        for k, gain in zip(own, gains, strict=True):
            found[k] += gain
    return found


def _most(keys: Keys, judged: Collection[Keys]) -> Keys:
    """The most effects among these that were judged together."""
    return max((k for k in judged if set(k) <= set(keys)), key=len)


def _bring(keys: Keys, costs: Mapping[Keys, float]) -> bool:
    """Whether effects bring anything beside fewer of them: else how many are tried would tell how
    likely none is.
    """
    return all(costs[keys] < cost for k, cost in costs.items() if set(k) < set(keys))


def _costs(fits: Mapping[Keys, Fit], rules: Rules) -> dict[Keys, float]:
    """Less what effects bring. The best of as many effects is held against the likeliest that has
    one of its effects less, else against none at all; the others of as many against that best:
    over a detour each would be doubted for more than what tells it from its rival.
    """
    costs: dict[Keys, float] = {(): 0.0}
    for count in sorted({len(k) for k in fits} - {0}):
        level = [k for k in fits if len(k) == count]
        best = min(level, key=lambda k: fits[k].evidence)
        fewer = [k for k in costs if len(k) == count - 1 and set(k) < set(best)]
        base = min(fewer, key=lambda k: costs[k], default=())
        costs[best] = costs[base] - fits[best].gain(fits[base], rules)
        for k in level:
            costs[k] = costs[best] + (fits[best].gain(fits[k], rules) if k != best else 0.0)
    return costs


def _likeliest(evidence: Sequence[Evidence], task: Task) -> Fit:
    """What is answered where nothing stands out."""
    return decide(evidence, 0.0, task.chances).best


def _answer(
    fitter: Fitter,
    task: Task,
    found: Search,
    evidence: Sequence[Evidence],
    c: _Confirmed,
    clock: _Clock,
) -> Found:
    likeliest = _likeliest(evidence, task)
    excess = excess_of(fitter, likeliest, floors_of(fitter, likeliest))
    worse = bool(likeliest.keys) and c.gap is not None and _worse(c.gap, c.plain)
    seen = c.gap if task.data.held_out else None
    left = outstanding(excess, task.chances, seen, likeliest)
    doubtful = _read_by(fitter, evidence, None if worse or not left.channel else left.channel[0])
    decision = decide(evidence, left.score, task.chances, worse=worse, doubtful=doubtful)
    claimed = decision.best if not worse else found.null
    levels = dict.fromkeys((s.name for s in task.plant.signals), excess.level)
    places = (
        where(fitter, found, claimed, levels, decision.unknown)
        if decision.verdict != "none"
        else ()
    )
    clock.lap("confirmation")
    diagnosis = Diagnosis(
        verdict=decision.verdict,
        where=places,
        causes=causes_of(decision.answers, task.catalogue, decision.chosen),
        answer_set=answer_set(decision.answers),
        gap=c.gap,
        notes=(*task.notes, *c.notes, *_cut_short(found, decision)),
        limits=task.limits,
        seconds=clock.seconds,
        steps=found.steps,
        probabilities={"none": decision.none, "unknown": decision.unknown},
        stages=clock.stages,
        weighed=tuple((e.fit.keys, e.cost) for e in evidence),
        stands_out=left.score,
        doubtful=doubtful,
    )
    return Found(
        task,
        diagnosis,
        found,
        tuple(evidence),
        decision,
        excess,
        c.nominal,
        c.augmented,
        c.gap,
    )


def _cut_short(found: Search, decision: Decision) -> tuple[str, ...]:
    """What is said of a search that has spent what it may."""
    if not found.cut:
        return ()
    return (CUT + LEFT_OPEN if decision.verdict == "unknown" else CUT,)


def _read_by(fitter: Fitter, evidence: Sequence[Evidence], view: str | None) -> tuple[str, ...]:
    """Effects that a view reads, in any form that was weighed; None: all."""
    weighed = [x for own in evidence for x in own.fit.hypothesis.effects]
    read = [e.key for e, form in weighed if view is None or view in fitter.readers(form)]
    return tuple(sorted(set(read)))


@dataclass(frozen=True, eq=False)
class _Confirmed:
    """The record that no fit saw, replayed: nominal, under the answer, with its tolerance alone."""

    nominal: Replay | None
    augmented: Replay | None
    plain: Replay | None
    gap: Gap | None
    notes: tuple[str, ...] = ()

    @property
    def lost(self) -> bool:
        """Whether the augmented replay leaves the record for good, and with it the replay under
        each draw of what the fit leaves open: an event that the answer misses.
        """
        gap = self.gap
        return gap is not None and gap.parted is not None and gap.leaving >= 1


def _vouched(
    fitter: Fitter,
    task: Task,
    found: Search,
    evidence: Sequence[Evidence],
    lost: _Confirmed,
) -> list[Evidence]:
    """Where the answer's replay has left the record that no fit saw: what was tried, brings enough
    but for its doubt, and replays that record to its end as well as the answer did before it left.
    What few stretches carry is doubted, for it may not be there again; here it is.
    """
    record, answer = task.data.held_out, _likeliest(evidence, task)
    if record is None or lost.gap is None or lost.gap.early is None or lost.nominal is None:
        return []
    bar, rivals = fitter.rules.effect, dict[Keys, Fit]()
    for fit in sorted(found.tried, key=lambda f: f.evidence):
        more = max(len(fit.keys) - len(answer.keys), 1)
        if answer.evidence - fit.evidence > bar * more:
            rivals.setdefault(tuple(sorted(fit.keys)), fit)
    few = list(rivals.values())[:RIVALS]
    if not few:
        return []
    few = fitter.together(
        lambda f: f if f.whole else fitter.again(f), few, [f.hypothesis for f in few]
    )
    made = replays(task.plant, record, [values_on(f, record) for f in few], task.cache)
    kept, cost = [], next(e.cost for e in evidence if e.fit is answer)
    for fit, replayed in zip(few, made, strict=True):
        own = replayed and gap_of(
            lost.nominal, replayed, fitter.rules, record.period, floor=lost.gap.floor
        )
        if own and own.parted is None and own.augmented < NOTABLE * lost.gap.early.augmented:
            kept.append(Evidence(fit, cost - (answer.evidence - fit.evidence)))
    return kept


def _worse(gap: Gap, plain: Replay | None) -> bool:
    """Whether the augmented plant replays its record surely worse than the nominal one: by more
    than noise, over all stretches, and with all values that the fit leaves open. Where `plain`, the
    plant with its tolerance alone, replays no better, the effects are not to blame. Behind an event
    that it missed a replay tells nothing.
    """
    plain = plain and plain.until(gap.parted)
    gap = gap.early or gap
    open_too = gap.spread is None or gap.spread[0] > gap.nominal
    blamed = plain is None or gap.augmented > BLAMED * plain.gap
    return gap.augmented > NOTABLE * gap.floor and gap.ci95[1] < 0 and open_too and blamed


def _confirmed(fitter: Fitter, task: Task, null: Fit, fit: Fit) -> _Confirmed:
    record = task.data.held_out or task.data.fitted[-1]
    drawn = draws(fit, record, unseen=fitter.unseen(fit))
    own = [{}, values_on(fit, record), values_on(null, record), *drawn]
    try:
        nominal, augmented, plain, *others = replays(task.plant, record, own, task.cache)
    except RunError as error:
        return _Confirmed(None, None, None, None, (str(error),))
    if nominal is None or augmented is None:
        note = f"{record.name} could not be replayed"
        return _Confirmed(nominal, augmented, plain, None, (note,))
    floor = floor_of(noise_levels(task.plant, record, fitter.rules))
    gap = gap_of(nominal, augmented, fitter.rules, record.period, floor=floor, others=others)
    return _Confirmed(nominal, augmented, plain, gap)
