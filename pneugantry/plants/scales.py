"""Readings in another unit than the model's, or of the other sign: what no effect explains may be
in millimetres, or turned round.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from modelica_fmu.errors import RunError
from pneugantry.engine.answer.confirm import Replay, replays
from pneugantry.engine.run import Found
from pneugantry.engine.signals.sensors import PREFIX

__all__ = ["with_doubtful_units"]

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
NEAR = 1.3  # factor by which a model may be off
FAR = 2.0  # scale of a sensor from which on, or its inverse, another unit may be behind it
ALIKE = 0.8  # correlation of readings and simulation from which on one may be the other, scaled


def with_doubtful_units(found: Found) -> Found:
    """An answer that is "unknown", or a scale of a sensor no sensor has, with a note on each log
    and signal that reads as another unit would.
    """
    diagnosis = found.diagnosis
    sizes = {n: size.value for c in diagnosis.causes for n, size in c.parameters.items()}
    if diagnosis.verdict != "unknown" and not any(_beyond(n, v) for n, v in sizes.items()):
        return found
    notes = (*found.diagnosis.notes, *_doubtful(found))
    return replace(found, diagnosis=replace(found.diagnosis, notes=notes))


def _beyond(parameter: str, value: float) -> bool:
    """Whether it is a sensor's scale, of a size that is rather another unit's."""
    scale = parameter.startswith(PREFIX) and parameter.endswith(".scale")
    return scale and not 1 / FAR < value < FAR


def _doubtful(found: Found) -> Iterator[str]:
    task = found.task
    for record in (*task.data.fitted, *task.data.unseen):
        try:
            (nominal,) = replays(task.plant, record, [{}], task.cache)
        except RunError:  # FMUs in a ring: the answer says so
            continue
        if nominal is None:
            continue
        for k, name in enumerate(nominal.signals):
            ratio = _ratio(nominal, k)
            read = f"{record.name}: {name} reads {ratio:.3g} times what the model tells"
            if ratio < 0:
                yield f"{read}: check the sign of it and of the inputs (scale = -1 turns one round)"
            for factor, unit in FACTORS.items():
                if ratio > 0 and abs(math.log(ratio / factor)) < math.log(NEAR):
                    yield f"{read}, as {unit} would: check its unit (`recorded` under [outputs])"


def _ratio(nominal: Replay, k: int) -> float:
    """Standard deviation of what a signal reads over that of what the model tells, with the sign of
    their correlation; 0 where the two are not alike.
    """
    rows = ~np.isnan(nominal.residuals[:, k])
    read, told = nominal.measured[rows, k], nominal.simulated[rows, k]
    sizes = float(np.std(read)), float(np.std(told))
    alike = float(np.corrcoef(read, told)[0, 1]) if min(sizes) > 0.0 else 0.0
    return math.copysign(sizes[0] / sizes[1], alike) if abs(alike) >= ALIKE else 0.0
