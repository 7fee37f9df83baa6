"""Whether a term is to be learnt, and of which records."""

from __future__ import annotations

from pneugantry.engine.chances import UNEXPLAINED
from pneugantry.engine.plant import Record
from pneugantry.engine.run import Found
from pneugantry.engine.task import Task
from pneugantry.engine.views.foreign import ForeignPlant

__all__ = ["wanted", "whole"]


def wanted(found: Found) -> bool:
    """Whether there may be something to learn: what no catalogue explains is likely enough. Where
    it only may be a curve of a known effect over another variable, nothing is left to learn from.
    """
    foreign, told = isinstance(found.task.plant, ForeignPlant), found.decision
    likely = told.unknown - told.imitated >= UNEXPLAINED
    return likely and not foreign and bool(whole(found.task))


def whole(task: Task) -> list[Record]:
    """Fitted records of all signals: a plant's variables are computed from these."""
    needed = {s.name for s in task.plant.signals}
    return [r for r in task.data.fitted if needed <= set(r.signals)]
