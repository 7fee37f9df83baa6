"""Errors of sensors, for every signal alike: what a sensor says of a true signal, and the signal
that a reading stands for.

Parameters "sensors.SIGNAL.WHAT": scale (1), bias, drift (per s), lag (s, first order), delay (s),
window (s: the reading is the mean of as long before it, as that of a speed from a way travelled),
curve (share by which a reading as large as its spread is more), from.OTHER (share of what
another signal's sensor would read without this one that leaks in).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from pneugantry.engine.plant import Array, Record
from pneugantry.engine.signals.slow import Slowness
from pyfmi_runner.first_order import first_order

__all__ = [
    "PREFIX",
    "affine",
    "leaks",
    "neutral",
    "read_with",
    "sensed",
    "shifted",
    "signal_of",
    "slowness",
    "true_signal",
]

PREFIX = "sensors."


def neutral(name: str) -> float:
    """Value of a sensor's parameter that has no error."""
    return 1.0 if name.endswith(".scale") else 0.0


def signal_of(name: str) -> str:
    """The signal that a sensor's parameter belongs to; its name may hold dots."""
    own, leak, _ = name.removeprefix(PREFIX).partition(".from.")
    return own if leak else own.rpartition(".")[0]


def leaks(name: str) -> bool:
    """Whether a sensor's parameter is what leaks in from another signal."""
    return ".from." in name


def read_with(name: str) -> tuple[str, ...]:
    """Signals whose readings a sensor's parameter moves, or what they stand for."""
    own = signal_of(name)
    return (own, name.removeprefix(f"{PREFIX}{own}.from.")) if leaks(name) else (own,)


def sensed(signal: str, true: Array, record: Record, values: Mapping[str, float]) -> Array:
    """Reading (N,) of a true signal (N,)."""
    own = _own(signal, values)
    if not own:
        return true
    result = true
    if lag := own.get("lag", 0.0):
        result = _lagged(result, lag / record.period)
    if delay := own.get("delay", 0.0):
        result = shifted(result, delay / record.period)
    if window := own.get("window", 0.0):
        result = _averaged(result, window / record.period)
    result = result * own.get("scale", 1.0)
    if drift := own.get("drift", 0.0):
        result = result + drift * record.period * np.arange(len(result))
    if curve := own.get("curve", 0.0):
        result = result * (1 + curve * (result / _spread(signal, record)) ** 2)
    result = result + own.get("bias", 0.0)
    if crosstalk := _crosstalk(signal, record, values):
        kept, others = crosstalk
        result = kept * result + others
    return np.asarray(result)


def true_signal(signal: str, record: Record, values: Mapping[str, float]) -> Array:
    """What a reading (N,) stands for, but for noise and for what makes it slow."""
    own, result = _own(signal, values), record.signals[signal]
    if not own:
        return result
    if crosstalk := _crosstalk(signal, record, values):
        kept, others = crosstalk
        result = (result - others) / kept
    result = result - own.get("bias", 0.0)
    if curve := own.get("curve", 0.0):
        straight, spread = result, _spread(signal, record)
        for _ in range(5):
            straight = result / np.maximum(1 + curve * (straight / spread) ** 2, 0.2)
        result = straight
    if drift := own.get("drift", 0.0):
        result = result - drift * record.period * np.arange(len(result))
    return np.asarray(result / own.get("scale", 1.0))


def slowness(signal: str, values: Mapping[str, float]) -> Slowness | None:
    """What makes a sensor slow; None where nothing does."""
    own = _own(signal, values)
    found = Slowness(own.get("lag", 0.0), own.get("delay", 0.0), own.get("window", 0.0))
    return found if any(found) else None


def affine(signal: str, values: Mapping[str, float]) -> tuple[float, float] | None:
    """(scale, bias) of a sensor that has no other error; None where it has."""
    own = {k: v for k, v in _own(signal, values).items() if v or k == "scale"}
    if own.keys() <= {"scale", "bias"}:
        return own.get("scale", 1.0), own.get("bias", 0.0)
    return None


def _own(signal: str, values: Mapping[str, float]) -> dict[str, float]:
    return {what: values[k] for what, k in _named(signal, tuple(values))}


@lru_cache(maxsize=4096)  # a diagnosis asks thousands of times about the same few sets of names
def _named(signal: str, names: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """(what, name) of the parameters that are a sensor's own."""
    prefix = f"{PREFIX}{signal}."
    own = (k for k in names if k.startswith(prefix) and signal_of(k) == signal)
    return tuple((k.removeprefix(prefix), k) for k in own)


def _crosstalk(
    signal: str, record: Record, values: Mapping[str, float]
) -> tuple[float, Array] | None:
    """The share of a signal's own reading that stays, and what the others' readings (N,) add to it.
    They hold a share of this one: in r = g + c h, h = q - d g the reading is (1 - c d) g + c q. A
    record that lacks a channel shows nothing of it.
    """
    kept, added = 1.0, []
    for key, share in _own(signal, values).items():
        source = key.removeprefix("from.")
        if source != key and share and source in record.signals:
            kept -= share * values.get(f"{PREFIX}{source}.from.{signal}", 0.0)
            added.append(share * record.signals[source])
    return (kept, np.sum(added, axis=0)) if added else None


def shifted(values: Array, rows: float) -> Array:
    """Values (N,) some rows later, or earlier; the last known ones at the ends."""
    at = np.arange(len(values))
    return np.interp(at - rows, at, values)


def _lagged(values: Array, rows: float) -> Array:
    """Values (N,) behind a first-order lag of some rows, straight from one to the next; at rest
    before the first. Held over a row instead they would come half a row too late.
    """
    keep = float(np.exp(-1 / rows))
    ahead = 1 - rows * (1 - keep)  # the new row's share; the rest is the old one's
    off = values - values[0]
    driven = ahead * off + (1 - keep - ahead) * np.append(0.0, off[:-1])
    return np.asarray(values[0] + first_order(driven, 1.0, keep))


def _averaged(values: Array, rows: float) -> Array:
    """Means (N,) of values over the last so many rows, straight from one to the next; at rest
    before the first.
    """
    ahead = np.append(values[1:], values[-1])
    area = np.append(0.0, np.cumsum(0.5 * (values[:-1] + values[1:])))
    began = np.maximum(np.arange(len(values)) - rows, 0.0)
    row = began.astype(int)
    part = began - row
    before = area[row] + part * (values[row] + 0.5 * part * (ahead - values)[row])
    rested = np.maximum(rows - np.arange(len(values)), 0.0)  # of the window, before the first row
    return np.asarray((area - before + rested * values[0]) / rows)


def _spread(signal: str, record: Record) -> float:
    values = record.signals[signal]
    return max(float(np.percentile(np.abs(values), 99)), 1e-12)
