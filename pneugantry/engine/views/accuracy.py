"""How exactly a plant is simulated: so that the solver's error hides in the sensors' noise.

A solver's tolerance is relative to the nominal values of states, which few models give: what it is
worth in a signal's noise is measured. So is what the length of steps is worth that are all alike:
runs side by side take such steps together, and their error changes smoothly with the parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pneugantry.engine.plant import Plant, Record
from pneugantry.engine.views.view import View

__all__ = ["accurate"]

TOLERANCE, LONGEST = "solver.tolerance", "solver.max_step"
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)  # the first is the models' own
STEPS = (1, 2, 4, 8, 16)  # of a row
REFERENCE = 1e-2  # share of a tolerance that stands for no error
HIDDEN = 1e-3  # of a signal's noise as it is judged, rms; its jumps, over a column's step, add up
STEADY = 5e-3  # the same of an error that has no jumps: of 40,000 rows it changes -2 log L by 1
TRIED = 2  # records


def accurate(plant: Plant, views: Sequence[View], records: Sequence[Record]) -> Plant:
    """The plant with the largest tolerance whose error is hidden, and in its views with the longest
    steps of which that is so; as it is where it sets either, or where a finer tolerance makes no
    difference (modes that change at the slightest difference).
    """
    own = [v for v in views if v.depends_on(TOLERANCE)]
    if not own or TOLERANCE in plant.settings or LONGEST in plant.settings:
        return plant
    chosen, error = TOLERANCES[0], math.inf
    for tolerance in TOLERANCES:
        finer = _error(own, records[:TRIED], {TOLERANCE: tolerance}, tolerance * REFERENCE)
        if finer > 0.5 * error:
            break
        chosen, error = tolerance, finer
        if error < HIDDEN:
            break
    settings = {} if chosen == TOLERANCES[0] else {TOLERANCE: chosen}
    in_views: dict[str, float] = {}
    for count in STEPS if error < HIDDEN else ():
        steps = {TOLERANCE: TOLERANCES[0], LONGEST: records[0].period / count}
        if _error(own, records[:TRIED], steps, chosen * REFERENCE) < STEADY:
            in_views = steps
            break
    if not settings and not in_views:
        return plant
    return replace(plant, settings={**plant.settings, **settings}, in_views=in_views)


def _error(
    views: Sequence[View], records: Sequence[Record], settings: Mapping[str, float], exact: float
) -> float:
    """The largest of any view's signals, rms, in noise levels, beside an exact tolerance."""
    found = [0.0]
    for view in views:
        for record in filter(view.shows, records):
            own, reference = view.residuals([(record, settings), (record, {TOLERANCE: exact})])
            if (np.isfinite(reference) & ~np.isfinite(own)).any():
                return math.inf
            off = (own - reference) / np.asarray(view.sigmas)
            found.append(float(np.sqrt(np.nan_to_num(off**2).mean(axis=0).max())))
    return max(found)
