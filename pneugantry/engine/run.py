"""One diagnosis: from a plant, its views and its records to an answer.

Data flow one way: null fit -> search -> evidence on the record that no fit saw -> decision ->
where, and how far the gap shrinks.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pneugantry.engine.answer.confirm import Gap, Replay
from pneugantry.engine.answer.confirmed import Confirmed, confirm, worsens
from pneugantry.engine.answer.decide import Decision, Evidence, decide, outstanding
from pneugantry.engine.answer.evidence import (
    evidence_of,
    left_by,
    left_in_views,
    likeliest,
    settled,
    vouched,
)
from pneugantry.engine.answer.imitation import imitators
from pneugantry.engine.answer.location import where
from pneugantry.engine.answer.predict import Unseen
from pneugantry.engine.answer.result import Diagnosis, answer_set, causes_of
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.hypotheses.hypothesis import Coordinate
from pneugantry.engine.rules import Rules
from pneugantry.engine.selection.excess import Excess
from pneugantry.engine.selection.search import Search, resumed, search
from pneugantry.engine.task import Task
from pneugantry.engine.threads import one_blas_thread

__all__ = ["Found", "run"]

Say = Callable[[str], None]
CUT = "the search was cut short: trying everything beside everything would take minutes"
LEFT_OPEN = "; nothing that was tried explains all that stands out"


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
    unseen: tuple[Coordinate, ...]  # what every rig has off and no fitted record shows
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
    unseen = Unseen(fitter, task.views, task.data.unseen)
    try:
        say("tolerance")
        null = fitter.null()
        clock.lap("tolerance")
        say("search")
        found = search(fitter, null, task.catalogue)
        clock.lap("search")
        evidence, confirmed = _judged(fitter, task, unseen, found, clock, say)
        if confirmed.lost and task.data.held_out:
            say("search again")
            further = resumed(fitter, found, task.catalogue)
            clock.lap("search")
            if further is not found:
                found = further
                evidence, confirmed = _judged(fitter, task, unseen, found, clock, say)
        same = confirmed.of(task)
        if confirmed.lost and (more := vouched(fitter, same, found, evidence, confirmed.pair)):
            evidence = [*evidence, *more]
            confirmed = confirm(fitter, task, unseen, found.null, likeliest(evidence, task))
        best = likeliest(evidence, task)
        left = left_by(fitter, unseen, best)
        stood = left_in_views(fitter, found.null) if best.keys else left[0]
        if more := settled(fitter, task, found, evidence, left[0], stood):
            evidence = [*evidence, *more]
            best = likeliest(evidence, task)
            confirmed = confirm(fitter, task, unseen, found.null, best)
            left = left_by(fitter, unseen, best)
        return _answer(fitter, task, found, _Judged(tuple(evidence), confirmed, left, stood), clock)
    finally:
        unseen.close()
        fitter.close()


def _judged(
    fitter: Fitter, task: Task, unseen: Unseen, found: Search, clock: _Clock, say: Say
) -> tuple[list[Evidence], Confirmed]:
    """What a search has found, beside the record that no fit saw."""
    say("held-out record")
    evidence = evidence_of(fitter, task, unseen, found)
    clock.lap("held-out record")
    say("confirmation")
    confirmed = confirm(fitter, task, unseen, found.null, likeliest(evidence, task))
    clock.lap("confirmation")
    return evidence, confirmed


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


def _answer(fitter: Fitter, task: Task, found: Search, judged: _Judged, clock: _Clock) -> Found:
    evidence, c, excess = judged.evidence, judged.confirmed, judged.left[0]
    best = likeliest(evidence, task)
    worse = bool(best.keys) and c.gap is not None and worsens(c.gap, c.plain)
    seen = c.gap if task.data.held_out else None
    stood = judged.stood if best.keys else None
    left = outstanding(judged.left, task.chances, seen, best, stood)
    doubtful = _read_by(fitter, evidence, None if worse or not left.channel else left.channel[0])
    others, doubts = imitators(fitter, evidence, task.chances)
    decision = decide(
        evidence, left, task.chances, worse=worse, doubtful=doubtful, imitators=others
    )
    claimed = decision.located if not worse else found.null
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
        causes=causes_of(decision.answers, task.catalogue, decision.chosen, task.chances.temper),
        answer_set=answer_set(decision.answers),
        gap=c.gap,
        notes=(*task.notes, *c.notes, *_cut_short(found, decision), *doubts),
        limits=task.limits,
        seconds=clock.seconds,
        steps=found.steps,
        probabilities={"none": decision.none, "unknown": decision.unknown},
        stages=clock.stages,
        weighed=(*((e.fit.keys, e.cost) for e in evidence), *others),
        stands_out=left.score,
        stood_out=left.before,
        doubtful=doubtful,
    )
    return Found(
        c.of(task),
        diagnosis,
        found,
        evidence,
        decision,
        excess,
        c.nominal,
        c.augmented,
        c.gap,
        tuple(fitter.coordinates.unseen(best)),
    )


def _cut_short(found: Search, decision: Decision) -> tuple[str, ...]:
    """What is said of a search that has spent what it may."""
    if not found.cut:
        return ()
    return (CUT + LEFT_OPEN if decision.verdict == "unknown" else CUT,)


def _read_by(fitter: Fitter, evidence: Sequence[Evidence], view: str | None) -> tuple[str, ...]:
    """Effects that a view reads, in any form that was weighed; None: all."""
    weighed = [x for own in evidence for x in own.fit.hypothesis.effects]
    read = [
        e.key for e, form in weighed if view is None or view in fitter.coordinates.readers(form)
    ]
    return tuple(sorted(set(read)))


@dataclass(frozen=True, eq=False)
class _Judged:
    """What was weighed, and what the likeliest of it leaves."""

    evidence: tuple[Evidence, ...]
    confirmed: Confirmed
    left: tuple[Excess, ...]  # as of `left_by`
    stood: Excess  # what stands out beside no effect, in the views
