"""What the fitted logs could see and tell apart, as the page shows it: the plan of a campaign that
was measured, from the views that the diagnosis has.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.planning.information import (
    SEEN,
    Information,
    Sight,
    Size,
    gather,
    score,
    sights,
    sizes,
)
from pneugantry.engine.rules import Rules
from pneugantry.engine.signals.units import with_unit
from pneugantry.engine.task import Task
from pneugantry.engine.views.synthetic import noisy
from pneugantry.report.headline import number

__all__ = ["Row", "Visibility", "visibility"]

OWN = 0.9  # share of its signature that no other effect imitates, from which on none is named


@dataclass(frozen=True)
class Row:
    """An effect, in words and numbers."""

    effect: str
    usual: str  # size, with unit
    smallest: str  # that is seen; "never"
    sigma: float  # standard deviations by which the usual size stands out
    told: float  # the same after the best imitation by another effect
    rival: str  # that effect; empty where it imitates little
    record: str  # that has most of its signature
    share: float  # of it

    @property
    def mark(self) -> str:
        """What keeps a fit from naming it."""
        if self.sigma < SEEN:
            return "not seen"
        return "not told apart" if self.told < SEEN else ""


@dataclass(frozen=True)
class Visibility:
    """Effects that some view shows, those least told first."""

    rows: tuple[Row, ...]
    unseen: tuple[str, ...]  # effects that touch no view
    told: float  # effects of usual size that are told from all else; those told in part count so
    adds: tuple[tuple[str, float], ...]  # record: how many fewer without it, most first


def visibility(task: Task, rules: Rules) -> Visibility:
    """Of the effects of a task's catalogue at their usual sizes, beside noise, tolerance and what
    differs from record to record. Nothing is fitted: every effect is simulated once in every view
    and fitted record (1 s for the gantry's seven logs).
    """
    fitter = Fitter(task.plant, task.views, task.data.fitted, rules)
    try:
        readable = {
            k: e for k, e in task.catalogue.items() if fitter.coordinates.readable(e.forms[0])
        }
        information = gather(fitter, readable, partial(noisy, task.plant))
        usual = sizes(fitter, readable)
    finally:
        fitter.close()
    found = sights(information)
    names = [r.name for r in task.data.fitted]
    return Visibility(
        tuple(_row(s, usual[s.effect]) for s in sorted(found, key=lambda s: s.told)),
        tuple(k for k in task.catalogue if k not in readable),
        score(found),
        _adds(information, names, score(found)) if len(names) > 1 else (),
    )


def _adds(
    information: Information, names: Sequence[str], whole: float
) -> tuple[tuple[str, float], ...]:
    lost = [(n, whole - score(sights(information, [o for o in names if o != n]))) for n in names]
    return tuple(sorted(lost, key=lambda item: -item[1]))


def _row(sight: Sight, size: Size) -> Row:
    seen = math.isfinite(sight.smallest)
    by: dict[str, float] = {}
    for _, record, share in sight.seen_by:
        by[record] = by.get(record, 0.0) + share
    record = max(by, key=lambda r: by[r], default="")
    return Row(
        sight.effect,
        with_unit(number(size.usual), size.unit),
        with_unit(number(sight.smallest * size.usual, 2), size.unit) if seen else "never",
        sight.sigma,
        sight.told,
        sight.rival if sight.rival is not None and sight.own_share < OWN else "",
        record,
        by.get(record, 0.0),
    )
