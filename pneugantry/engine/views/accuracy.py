"""How exactly a plant is simulated: so that the solver's error hides in the sensors' noise.

A solver's tolerance is relative to the nominal values of states, which few models give: what it is
worth in a signal's noise is measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pneugantry.engine.plant import Plant, Record
from pneugantry.engine.views.view import View

__all__ = ["accurate"]

TOLERANCE = "solver.tolerance"
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)  # the first is the models' own
REFERENCE = 1e-2  # share of a tolerance that stands for no error
HIDDEN = 1e-3  # of a signal's noise as it is judged, rms; its jumps, over a column's step, add up
TRIED = 2  # records


def accurate(plant: Plant, views: Sequence[View], records: Sequence[Record]) -> Plant:
    """The plant with the largest tolerance whose error is hidden; its own where it sets one, or
    where a finer one makes no difference (modes that change at the slightest difference).
    """
    if TOLERANCE in plant.settings:
        return plant
    chosen, error = TOLERANCES[0], math.inf
    for tolerance in TOLERANCES:
        finer = _error(views, records[:TRIED], tolerance)
        if finer > 0.5 * error:
            break
        chosen, error = tolerance, finer
        if error < HIDDEN:
            break
    if chosen == TOLERANCES[0]:
        return plant
    return replace(plant, settings={**plant.settings, TOLERANCE: chosen})


def _error(views: Sequence[View], records: Sequence[Record], tolerance: float) -> float:
    """The largest of any view's signals, rms, in noise levels."""
    found = [0.0]
    for view in views:
        for record in records:
            if view.depends_on(TOLERANCE) and view.shows(record):
                tolerances = (tolerance, tolerance * REFERENCE)
                own, reference = view.residuals([(record, {TOLERANCE: t}) for t in tolerances])
                off = (own - reference) / np.asarray(view.sigmas)
                found.append(float(np.sqrt(np.nan_to_num(off**2).mean(axis=0).max())))
    return max(found)
