"""Whether a term is to be learnt, and of which records."""

from __future__ import annotations

from pneugantry.engine.answer.decide import Outstanding, stands_out
from pneugantry.engine.chances import UNEXPLAINED
from pneugantry.engine.plant import Record
from pneugantry.engine.run import Found
from pneugantry.engine.task import Task
from pneugantry.engine.views.foreign import ForeignPlant

__all__ = ["wanted", "whole"]


def wanted(found: Found) -> bool:
    """Whether there may be something to learn: what no catalogue explains is likely enough, or
    would be if what the answer leaves were left beside no effect, for one may only stand in for
    what is missing. Where it only may be a curve of a known effect over another variable, nothing
    is left to learn from.
    """
    task, told = found.task, found.decision
    left = stands_out(Outstanding(found.diagnosis.stands_out), task.chances)
    likely = max(told.unknown - told.imitated, left) >= UNEXPLAINED
    return likely and not isinstance(task.plant, ForeignPlant) and bool(whole(task))


def whole(task: Task) -> list[Record]:
    """Fitted records of all signals: a plant's variables are computed from these."""
    needed = {s.name for s in task.plant.signals}
    return [r for r in task.data.fitted if needed <= set(r.signals)]
