"""The record that no fit saw, replayed under an answer."""

from __future__ import annotations

from dataclasses import dataclass, replace

from modelica_fmu.errors import RunError
from pneugantry.engine.answer.confirm import (
    Gap,
    Replay,
    draws,
    floor_of,
    gap_of,
    noise_levels,
    replays,
    values_on,
)
from pneugantry.engine.answer.predict import Unseen
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.plant import Record
from pneugantry.engine.task import Task

__all__ = ["Confirmed", "confirm", "worsens"]

BLAMED = 1.1  # times the gap with tolerance alone from which on effects make it worse
NOTABLE = 2.0  # times the floor from which on a gap is more than noise


@dataclass(frozen=True, eq=False)
class Confirmed:
    """The record that no fit saw, replayed: nominal, under the answer, with its tolerance alone."""

    nominal: Replay | None
    augmented: Replay | None
    plain: Replay | None
    gap: Gap | None
    record: Record
    notes: tuple[str, ...] = ()

    def of(self, task: Task) -> Task:
        """The task with the held-out record as it was replayed."""
        if task.data.held_out is None:
            return task
        return replace(task, data=replace(task.data, held_out=self.record))

    @property
    def pair(self) -> tuple[Replay, Gap] | None:
        """The nominal replay, and the gap; None where the record could not be replayed."""
        return (self.nominal, self.gap) if self.nominal and self.gap else None

    @property
    def lost(self) -> bool:
        """Whether the augmented replay leaves the record for good, and with it the replay under
        each draw of what the fit leaves open: an event that the answer misses.
        """
        gap = self.gap
        return gap is not None and gap.parted is not None and gap.leaving >= 1


def worsens(gap: Gap, plain: Replay | None) -> bool:
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


def confirm(fitter: Fitter, task: Task, unseen: Unseen, null: Fit, fit: Fit) -> Confirmed:
    """The held-out record, else the last fitted one, under a fit and beside it under tolerance
    alone (null).
    """
    record = unseen.told(fit) if task.data.held_out is not None else None
    record = record or task.data.fitted[-1]
    drawn = draws(fit, record, unseen=fitter.coordinates.unseen(fit))
    own = [{}, values_on(fit, record), values_on(null, record), *drawn]
    try:
        nominal, augmented, plain, *others = replays(task.plant, record, own, task.cache)
    except RunError as error:
        return Confirmed(None, None, None, None, record, (str(error),))
    if nominal is None or augmented is None:
        note = f"{record.name} could not be replayed"
        return Confirmed(nominal, augmented, plain, None, record, (note,))
    floor = floor_of(noise_levels(task.plant, record, fitter.rules))
    gap = gap_of(nominal, augmented, fitter.rules, record.period, floor=floor, others=others)
    return Confirmed(nominal, augmented, plain, gap, record)
