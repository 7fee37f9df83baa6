"""A sensor's learnt error taken out of its readings: other views take them as known, and positions
are smoothed by speeds before any view sees them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.learn.term import Term

__all__ = ["calibrated", "read_by"]

ROUNDS = 40  # steps of the inversion, at most
EXACT = 1e-3  # of an error's size, left by the last one


def read_by(plant: Plant, term: Term) -> str | None:
    """The signal whose error a term is, as a function of what that sensor reads; None: none's."""
    if not (term.regressor.alone and term.point.is_read(term.variable)):
        return None
    left = term.point.equation.left
    return next((s.name for s in plant.signals if s.variable == left), None)


def calibrated(record: Record, signal: str, term: Term) -> Record | None:
    """A record without the term in a signal's readings; None: they have no single origin."""
    if signal not in record.signals:
        return record
    read = np.asarray(record.signals[signal], dtype=float)
    true, most = read, float(np.ptp(read))
    for _ in range(ROUNDS):
        error = _error(true, record.period, term)
        moved = float(np.abs(read - error - true).max())
        if not moved <= most:  # an error that grows faster than what is read
            return None
        true = read - error
        if moved <= EXACT * float(np.abs(error).max()):
            return replace(record, signals={**record.signals, signal: true})
    return None


def _error(true: Array, period: float, term: Term) -> Array:
    memory = term.law.memory
    if memory is not None:
        return np.asarray(term.values[0] * memory.walk(true, period, term.values[1:]))
    return np.asarray(term.law.law(true, term.values), dtype=float)
