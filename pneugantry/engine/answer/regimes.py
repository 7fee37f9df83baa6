"""The regime of the motion in which a view misfits, in words.

Every quantity that the view reads is offered as it is, by its size, by its rate, by its sign and by
how near its next reversal is. Said is what best separates rows by their misfit: the largest area
under the curve of hits against false alarms.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pneugantry.engine.fitting.noise import LONGEST
from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.engine.signals.sensors import PREFIX
from pneugantry.engine.views.subsystem import SubsystemView
from pneugantry.engine.views.view import View

__all__ = ["THROUGHOUT", "area", "regime_of"]

THROUGHOUT = "throughout"
CLEAR = 0.1  # area beyond one half from which on a feature separates
AROUND = 9  # rows over which a quantity is smoothed
BOTH = 0.05  # share of the rows on either side of 0 from which on a quantity has both signs
QUIET = 3.0  # standard deviations of a row's noise within which a quantity is 0


@dataclass(frozen=True, eq=False)
class _Feature:
    """A number for each row, and what to say where large or small ones go with the misfit."""

    values: Array
    large: str
    small: str = ""  # empty: small values say nothing


def regime_of(plant: Plant, view: View, rows: Sequence[tuple[Record, Array]]) -> str:
    """rows: records, each with the misfit (rows of the view's residual less `LONGEST`,), >= 0."""
    if not rows:
        return ""
    weights = np.concatenate([w for _, w in rows])
    if not weights.sum() > 0:
        return ""
    best, said = CLEAR, THROUGHOUT
    for quantity in _quantities(plant, view, rows[0][0]):
        parts = [_resampled(record, quantity, view, len(w)) for record, w in rows]
        for feature in _features(quantity, parts, _sigma(plant, view, quantity)):
            found = area(feature.values, weights) - 0.5
            if found > best:
                best, said = found, feature.large
            elif -found > best and feature.small:
                best, said = -found, feature.small
    return said


def area(values: Array, weights: Array) -> float:
    """Probability that a row drawn by its weight has a larger value than one drawn evenly; ties
    count half.
    """
    _, rank, count = np.unique(values, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(count) - 0.5 * count)[rank] / len(values)  # ties share their mean
    return float(ranks @ weights / weights.sum())


def _quantities(plant: Plant, view: View, record: Record) -> list[str]:
    """Inputs and signals that a view reads."""
    read = [
        s.name
        for s in plant.signals
        if s.name in record.signals
        and (s.name in view.signals or view.depends_on(f"{PREFIX}{s.name}.bias"))
    ]
    view = getattr(view, "view", view)  # that of one campaign of several
    if not isinstance(view, SubsystemView):
        return [*(n for n in view.signals if n in record.inputs), *read]
    return [*(n for n in plant.inputs if n in view.sources.values()), *read]


def _sigma(plant: Plant, view: View, quantity: str) -> float:
    """Noise of a row of what is smoothed; 0 of an input."""
    quoted = {s.name: s.sigma for s in plant.signals}
    return quoted.get(quantity, 0.0) / np.sqrt(AROUND * view.decimation)


def _resampled(record: Record, quantity: str, view: View, rows: int) -> Array:
    """A quantity at the rows of a view's residual, smoothed."""
    values = record.inputs.get(quantity)
    raw = np.asarray(record.signals[quantity] if values is None else values, dtype=float)
    every = view.decimation
    mean = raw[: len(raw) // every * every].reshape(-1, every).mean(axis=1)
    if len(mean) < LONGEST + rows:  # a view with a rate of its own
        at = (np.arange(LONGEST + rows) + 0.5) * len(raw) / (LONGEST + rows) - 0.5
        mean = np.interp(at, np.arange(len(raw)), raw)
    padded = np.pad(mean, AROUND // 2, mode="edge")
    return np.convolve(padded, np.full(AROUND, 1 / AROUND), "valid")[LONGEST : LONGEST + rows]


def _features(name: str, parts: Sequence[Array], sigma: float) -> Iterator[_Feature]:
    values = np.concatenate(parts)
    if np.ptp(values) <= 2 * QUIET * sigma:
        return  # at rest
    sign = np.sign(np.where(np.abs(values) > QUIET * sigma, values, 0.0))
    both = min(float((sign > 0).mean()), float((sign < 0).mean())) > BOTH
    rate = np.concatenate([np.abs(np.gradient(p)) for p in parts])
    yield _Feature(rate, f"fast changes of {name}", f"steady {name}")
    yield _Feature(np.abs(values), f"large {name}", f"small {name}")
    if not both:
        return
    yield _Feature(sign, f"{name} > 0", f"{name} < 0")
    near = np.concatenate([_nearness(p, QUIET * sigma) for p in parts])
    yield _Feature(near, f"reversals of {name}")


def _nearness(values: Array, quiet: float) -> Array:
    """Minus the distance to the nearest change of sign, in rows; what is within `quiet` of 0 has
    the sign before it.
    """
    at = np.flatnonzero(np.abs(values) > quiet)
    rows = np.arange(len(values))
    if len(at) < 2:
        return np.full(len(values), -float(len(values)))
    turns = np.flatnonzero(np.diff(np.sign(values[at])) != 0)
    middles = 0.5 * (at[turns] + at[turns + 1])
    if not len(middles):
        return np.full(len(values), -float(len(values)))
    after = np.searchsorted(middles, rows)
    before = np.abs(rows - middles[np.maximum(after - 1, 0)])
    behind = np.abs(rows - middles[np.minimum(after, len(middles) - 1)])
    return np.asarray(-np.minimum(before, behind), dtype=float)
