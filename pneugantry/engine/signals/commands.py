"""What drives a plant, where a record says what was commanded.

Parameters "inputs.NAME.WHAT", the input's name as in the model: delay (s), lag (s, first order). A
command's scale and its offset are numbers of the model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from modelica_fmu.batch import Drive
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.signals.sensors import PREFIX as OF_SENSORS
from pneugantry.engine.signals.sensors import shifted
from pyfmi_runner.first_order import first_order

__all__ = ["PREFIX", "Lateness", "acting", "drives_of", "input_of", "lateness", "outside"]

PREFIX = "inputs."
Held = Array | tuple[Array, Array]  # as `Record.driving` has it
Lateness = tuple[float, float]  # delay and lag, s


def outside(name: str) -> bool:
    """Whether a parameter is none of the model's, but of a sensor or of an input."""
    return name.startswith((PREFIX, OF_SENSORS))


def input_of(name: str) -> str:
    """The input that such a parameter belongs to."""
    return name.removeprefix(PREFIX).rpartition(".")[0]


def lateness(name: str, values: Mapping[str, float]) -> Lateness:
    """How late an input acts, by the parameters among some values."""
    delay, lag = _named(name)
    return values.get(delay, 0.0), values.get(lag, 0.0)


def acting(record: Record, name: str, late: Lateness) -> Held:
    """What an input does by the time it acts, over a record: held over rows, or at the rows and
    behind them, there in parts or as a mean. Before the record it was what it is at its start.
    """
    given = record.driving(name)
    if not any(late):
        return given
    held = given[1] if isinstance(given, tuple) else given
    period = record.period * len(held) / held.size
    made = _behind(shifted(held.ravel(), late[0] / period), late[1] / period).reshape(held.shape)
    if not isinstance(given, tuple):
        return made
    if made.ndim == 2:
        return made[:, 0], made
    return np.append(made[0], 0.5 * (made[:-1] + made[1:])), made


def drives_of(
    record: Record, sources: Mapping[str, str], values: Sequence[Mapping[str, float]]
) -> tuple[list[Drive], list[int]]:
    """What drives runs over a record by its inputs alone, once for runs that are driven alike; and
    which of it drives each. sources: input of what is driven -> input of the plant; values:
    parameters of each run.
    """
    read = sorted(set(sources.values()))
    late = [tuple((n, lateness(n, given)) for n in read) for given in values]
    each = list(dict.fromkeys(late))
    acts = [{n: acting(record, n, own) for n, own in found} for found in each]
    inputs = [{name: found[source] for name, source in sources.items()} for found in acts]
    drives = [Drive(own, rows=record.rows) for own in inputs]
    return drives, [each.index(own) for own in late]


def _behind(held: Array, rows: float) -> Array:
    """Means over the rows behind a first-order lag of some rows, whose input is held; at rest
    before the first.
    """
    if rows <= 0:
        return held
    gone = -float(np.expm1(-1 / rows))  # share of a step that is made up for over a row
    state = first_order(gone * (held - held[0]), 1.0, 1 - gone)  # at the ends of the rows
    before = np.append(0.0, state[:-1])
    return np.asarray(held + rows * gone * (held[0] + before - held))


@lru_cache(maxsize=256)
def _named(name: str) -> tuple[str, str]:
    return f"{PREFIX}{name}.delay", f"{PREFIX}{name}.lag"
