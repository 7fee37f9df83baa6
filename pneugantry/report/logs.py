"""Every record of a diagnosis beside its simulation, nominal and with the answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modelica_fmu.errors import InputError, RunError
from pneugantry.engine.answer.confirm import Replay, replays, values_on
from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.engine.run import Found
from pneugantry.report.pictures import Curves, Shown

__all__ = ["Shot", "shots", "shown_of"]


@dataclass(frozen=True, eq=False)
class Shot:
    """One record as the page shows it."""

    record: Record
    nominal: Replay
    augmented: Replay
    curves: Curves
    held_out: bool

    @property
    def residuals(self) -> dict[str, tuple[Array, Array]]:
        """By signal: what the nominal and the augmented plant leave (rows,), in quoted noises."""
        both = self.nominal.residuals, self.augmented.residuals
        return {n: (both[0][:, i], both[1][:, i]) for i, n in enumerate(self.nominal.signals)}


def shots(found: Found) -> tuple[list[Shot], list[str]]:
    """The record that no fit saw first, then the fitted ones; and what could not be replayed, a
    sentence each.
    """
    task = found.task
    made: list[Shot] = []
    notes: list[str] = []
    held = task.data.held_out
    for record in (*([held] if held is not None else []), *task.data.fitted):
        if record.rows < 2:
            continue
        try:
            nominal, augmented = _pair(found, record)
        except (RunError, InputError) as error:
            if f"{error}" not in found.diagnosis.notes:
                notes.append(f"{error}")
            continue
        if nominal is None or augmented is None:
            notes.append(f"{record.name} could not be replayed for the page: the model stops")
            continue
        curves = _curves(task.plant, nominal, augmented)
        made.append(Shot(record, nominal, augmented, curves, record is held))
    return made, notes


def _pair(found: Found, record: Record) -> tuple[Replay | None, Replay | None]:
    """Nominal and augmented; those that the diagnosis has made are taken."""
    if found.nominal is not None and found.nominal.record == record.name:
        return found.nominal, found.augmented
    task, final = found.task, found.final
    values = values_on(final.decision.best, record)
    if final is found:
        nominal, augmented = replays(task.plant, record, [{}, values], task.cache)
        return nominal, augmented
    (nominal,) = replays(task.plant, record, [{}], task.cache)
    (augmented,) = replays(final.task.plant, record, [values], task.cache)
    return nominal, augmented


def _curves(plant: Plant, nominal: Replay, augmented: Replay) -> Curves:
    """Measured and simulated, at the rate of the replays, which may be finer than that of the fits;
    a simulation is left out where its rows do not count.
    """
    values = {"measured": nominal.measured}
    for name, replay in (("nominal", nominal), ("augmented", augmented)):
        values[name] = np.where(np.isnan(replay.residuals), np.nan, replay.simulated)
    return Curves(shown_of(plant, nominal), nominal.period, values)


def shown_of(plant: Plant, replay: Replay) -> tuple[Shown, ...]:
    """The signals of a replay, with the noise that its residuals are counted in."""
    units = {s.name: s.unit for s in plant.signals}
    quoted = zip(replay.signals, replay.sigma.tolist(), strict=True)
    return tuple(Shown.of(name, units[name], sigma) for name, sigma in quoted)
