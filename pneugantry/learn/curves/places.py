"""Where a wave that runs on between records stands in one that no fit has seen: nothing else tells
than that record's own views.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pneugantry.engine.plant import Array
from pneugantry.engine.views.simulation import Cell, Simulation

__all__ = ["place_of"]

ROUND = 24  # places in a period that are tried
CLOSER = (1.0, 0.2)  # steps about the best of them, in steps of the places


def place_of(
    simulation: Simulation, values: Mapping[str, float], parameter: str, period: float
) -> float:
    """The value of a parameter, from 0 to its period, that leaves least in the views that read it,
    under white noise of whatever size. values: of all other parameters.
    """
    cells = [c for c in simulation.cells if simulation.views[c[0]].depends_on(parameter)]
    step = period / ROUND
    tried = np.linspace(0.0, period - step, ROUND)
    best = float(tried[np.argmin(_costs(simulation, cells, values, parameter, tried))])
    for size in CLOSER:
        near = np.asarray(best + size * step * np.linspace(-0.8, 0.8, 9), dtype=float)
        best = float(near[np.argmin(_costs(simulation, cells, values, parameter, near))])
    return best % period


def _costs(
    simulation: Simulation,
    cells: list[Cell],
    values: Mapping[str, float],
    parameter: str,
    tried: Array,
) -> Array:
    """-2 log likelihoods (tried,)."""
    runs = simulation.run({c: [{**values, parameter: float(t)} for t in tried] for c in cells})
    total = np.zeros(len(tried))
    for residuals in runs.values():
        squares = np.array([np.mean(r**2, axis=0) for r in residuals])
        total += len(residuals[0]) * np.log(squares).sum(axis=1)
    return np.where(np.isfinite(total), total, np.inf)
