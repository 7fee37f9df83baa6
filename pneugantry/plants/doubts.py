"""Readings that no effect is behind, it seems: in another unit than the model's, of the other sign,
of another sensor, of one that stands still; and inputs in each other's place.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, islice
from typing import TypeVar

import numpy as np

from modelica_fmu.errors import RunError
from pneugantry.engine.answer.confirm import Replay, replays
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.run import Found
from pneugantry.engine.signals.sensors import PREFIX
from pneugantry.engine.task import Task

__all__ = ["doubts_of", "with_doubts"]

FACTORS = {  # times what the model tells: what may have been recorded
    1e3: "thousandths of the unit",
    1e-3: "thousands of the unit",
    1e2: "hundredths of the unit, or percent",
    1e-2: "hundreds of the unit, or shares for percent",
    180 / math.pi: "degrees for radians",
    math.pi / 180: "radians for degrees",
    30 / math.pi: "turns a minute for rad/s",
    math.pi / 30: "rad/s for turns a minute",
    3.6: "km/h for m/s",
    1 / 3.6: "m/s for km/h",
    1e5: "pascals for bars",
    1e-5: "bars for pascals",
}
ZEROS = {  # beyond what the model tells: readings on a scale with another zero
    -273.15: "degrees Celsius for kelvins",
    273.15: "kelvins for degrees Celsius",
}
NEAR = 1.3  # factor by which a model may be off
LITTLE = 0.05  # of another zero, by which it may be off
FAR = 2.0  # scale of a sensor from which on, or its inverse, another unit may be behind it
ALIKE = 0.8  # correlation of readings and simulation from which on one may be the other, scaled
SURE = 0.95  # and from which on it is, where it is to be another sensor's
STILL = 10.0  # noises by which the model moves where a sensor stands still
MUCH = 5.0  # times the noise is a gap that exchanged inputs may explain; so many times less is left
PAIRS = 15  # of inputs, at most: each is a replay
T = TypeVar("T")


def doubts_of(task: Task) -> tuple[str, ...]:
    """A note on each log and signal that reads as another unit, another sign or another sensor
    would, or stands still; and on inputs in each other's place. From replays of the nominal plant.
    """
    records = (*task.data.fitted, *task.data.unseen)
    replayed = [_replayed(task, record) for record in records]
    found = [r for r in replayed if r is not None]
    each = (note for r in found for of in (_units, _zeros, _exchanged) for note in of(r))
    inputs = zip(records[:1], replayed, strict=False)
    return (*each, *_still(found), *(note for r in inputs for note in _exchanged_inputs(task, *r)))


def with_doubts(found: Found, doubts: Sequence[str]) -> Found:
    """An answer that is "unknown", or a scale of a sensor that no sensor has, with these notes."""
    diagnosis = found.diagnosis
    sizes = {n: size.value for c in diagnosis.causes for n, size in c.parameters.items()}
    if diagnosis.verdict != "unknown" and not any(_beyond(n, v) for n, v in sizes.items()):
        return found
    return replace(found, diagnosis=replace(diagnosis, notes=(*diagnosis.notes, *doubts)))


def _beyond(parameter: str, value: float) -> bool:
    """Whether it is a sensor's scale, of a size that is rather another unit's."""
    scale = parameter.startswith(PREFIX) and parameter.endswith(".scale")
    return scale and not 1 / FAR < value < FAR


def _replayed(task: Task, record: Record) -> Replay | None:
    """None where the model stops, or FMUs feed each other in a ring: the answer says so."""
    try:
        (found,) = replays(task.plant, record, [{}], task.cache)
    except RunError:
        return None
    return found


def _units(nominal: Replay) -> Iterator[str]:
    for name, (read, told) in _readings(nominal).items():
        alike, ratio = _alike(read, told), _ratio(read, told)
        times = f"{math.copysign(ratio, alike):.3g} times what the model tells"
        said = f"{nominal.record}: {name} reads {times}"
        if alike <= -ALIKE:
            yield f"{said}: check the sign of it and of the inputs (scale = -1 turns one round)"
        for factor, unit in FACTORS.items():
            if alike >= ALIKE and _near(ratio / factor):
                yield f"{said}, as {unit} would: check its unit (`recorded` under [outputs])"


def _zeros(nominal: Replay) -> Iterator[str]:
    for name, (read, told) in _readings(nominal).items():
        if _alike(read, told) < ALIKE or not _near(_ratio(read, told)):
            continue
        beyond = float(np.mean(read - told))
        for zero, unit in ZEROS.items():
            if abs(beyond - zero) < LITTLE * abs(zero):
                said = f"{nominal.record}: {name} reads {beyond:+.4g} beside what the model tells"
                yield f"{said}, as {unit} would: check its unit (`recorded` under [outputs])"


def _exchanged(nominal: Replay) -> Iterator[str]:
    """Signals that read as each other."""
    for (one, (read, told)), (other, (read_other, told_other)) in combinations(
        _readings(nominal).items(), 2
    ):
        own = min(_alike(read, told), _alike(read_other, told_other)) >= ALIKE
        crossed = ((read, told_other), (read_other, told))
        if not own and all(_alike(*c) >= SURE and _near(_ratio(*c)) for c in crossed):
            said = f"{nominal.record}: {one} reads as {other} would, and {other} as {one}"
            yield f"{said}: check whether their columns are exchanged"


def _still(found: Sequence[Replay]) -> Iterator[str]:
    """Sensors that stand still in a log where the model moves, and not in others."""
    moves = {n for r in found for n, (read, _) in _readings(r).items() if np.ptp(read) > 0}
    for nominal in found:
        for (name, (read, told)), sigma in zip(
            _readings(nominal).items(), nominal.sigma, strict=True
        ):
            if name in moves and len(read) and np.ptp(read) == 0 < np.ptp(told) - STILL * sigma:
                said = f"{nominal.record}: {name} reads {read[0]:.4g} throughout, not in other logs"
                yield f"{said}: check its sensor and the cable"


def _exchanged_inputs(task: Task, record: Record, nominal: Replay | None) -> Iterator[str]:
    """Inputs that explain much of a gap once they change places."""
    if nominal is None or nominal.gap < MUCH:
        return
    for one, other in islice(combinations(record.inputs, 2), PAIRS):
        if np.array_equal(record.inputs[one], record.inputs[other]):
            continue
        found = _replayed(task, _with_exchanged(record, {one: other, other: one}))
        if found is not None and found.gap < nominal.gap / MUCH:
            said = f"{record.name}: the gap goes from {nominal.gap:.3g} to {found.gap:.3g} with"
            yield f"{said} {one} and {other} exchanged: check whether their columns are"


def _with_exchanged(record: Record, places: Mapping[str, str]) -> Record:
    """A record with some inputs in each other's place."""

    def moved(values: Mapping[str, T]) -> dict[str, T]:
        return {places.get(name, name): v for name, v in values.items()}

    straight = frozenset(places.get(name, name) for name in record.straight)
    inputs, within = moved(record.inputs), moved(record.within)
    return replace(record, inputs=inputs, within=within, straight=straight)


def _readings(nominal: Replay) -> dict[str, tuple[Array, Array]]:
    """What each signal reads, and what the model tells, in rows that count."""
    rows = ~np.isnan(nominal.residuals)
    return {
        name: (nominal.measured[rows[:, k], k], nominal.simulated[rows[:, k], k])
        for k, name in enumerate(nominal.signals)
    }


def _alike(read: Array, told: Array) -> float:
    """Correlation; 0 where one does not move, or they do not count at the same rows."""
    if len(read) != len(told) or len(read) < 2 or min(np.std(read), np.std(told)) == 0:
        return 0.0
    return float(np.corrcoef(read, told)[0, 1])


def _ratio(read: Array, told: Array) -> float:
    """Of standard deviations; 0 where the model does not move."""
    size = float(np.std(told))
    return float(np.std(read)) / size if size > 0 else 0.0


def _near(ratio: float) -> bool:
    return ratio > 0 and abs(math.log(ratio)) < math.log(NEAR)
