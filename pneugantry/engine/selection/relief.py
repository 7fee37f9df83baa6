"""What tolerance bears and an effect would bear as well.

A level and the factors that it multiplies are one factor told twice: no record tells them apart,
only the priors do. Along such a direction the columns add up to nothing. At the end of
a fit they need not: it may stand at the edge of an event, where a step to either side is another
matter. So they are taken a little beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.fitting.problem import inside
from pneugantry.engine.hypotheses.catalogue import Form
from pneugantry.engine.hypotheses.hypothesis import Coordinate
from pneugantry.engine.plant import Array
from pneugantry.engine.views.simulation import Columns, Point

__all__ = ["Relief", "Reliefs"]

BESIDE = 0.3  # prior spreads by which all is moved before columns are taken


@dataclass(frozen=True)
class Relief:
    """Where an effect takes over what tolerance bears."""

    starts: Mapping[str, float]  # values of its parameters, and of the nuisances that it relieves
    gain: float  # of -2 log prior, less what the residuals change


class Reliefs:
    """Steps from a fit that leave the residuals as they are, where deviations are large."""

    def __init__(self, fitter: Fitter, base: Fit) -> None:
        self.fitter, self.base = fitter, base
        self.far_off = fitter.far_off(base)
        sim = fitter.simulation
        self.cells = [
            c for c in sim.cells if any(sim.views[c[0]].depends_on(n) for n in self.far_off)
        ]
        if not self.cells:
            return
        self.own = [c for c in base.point.coordinates if any(sim.in_cell(c, x) for x in self.cells)]
        at = dict(zip(base.point.coordinates, base.point.theta, strict=True))
        self.theta = np.array([at[c] for c in self.own])
        spread = np.array([c.spread for c in self.own])
        worth = np.array([1.0 if c.effect else fitter.rules.tolerated for c in self.own])
        self.weight = worth / spread**2
        drawn = np.random.default_rng(0).standard_normal(len(self.own))
        theta = self.theta + BESIDE * spread * drawn
        self.beside = inside(Point(tuple(self.own), theta, base.point.settings))
        names = {c.name for c in self.own}
        self.residuals, found = sim.linearised(self.beside, self.cells, names)
        self.columns = self._stacked(found, self.own)
        self.idle, _ = self._step(self.columns, self.theta, self.weight)

    def of(self, form: Form) -> Relief | None:
        """The one that a form of an effect brings; None where it brings none. A parameter that the
        base fits as a nuisance becomes the effect's, free of its tolerance.
        """
        sim, rules = self.fitter.simulation, self.fitter.rules
        names = [p.name for p in form.parameters]
        cells = [c for c in self.cells if any(sim.views[c[0]].depends_on(n) for n in names)]
        if form.settings or not cells:
            return None
        effects = [self.fitter.coordinates.of_effect(p) for p in form.parameters]
        rest = np.array([c.parameter not in names for c in self.own])
        kept = [c for c, stays in zip(self.own, rest, strict=True) if stays]
        beside, own = (_theta_of(effects, f.values(None)) for f in (self.beside, self.base))
        theta = np.concatenate([self.beside.theta[rest], beside])
        point = Point((*kept, *effects), theta, self.base.point.settings)
        residuals = {c: self.residuals[c] for c in cells}
        found = sim.columns(point, residuals, cells, {c.name for c in effects})
        columns = np.column_stack([self.columns[:, rest], self._stacked(found, effects)])
        weight = np.concatenate([self.weight[rest], np.full(len(effects), rules.effect_prior**-2)])
        gain, moved = self._step(columns, np.concatenate([self.theta[rest], own]), weight)
        gain += float(self.weight[~rest] @ self.theta[~rest] ** 2 - weight[-len(own) :] @ own**2)
        pairs = zip((*kept, *effects), moved, strict=True)
        starts = {c.parameter: c.value(t) for c, t in pairs if c.effect or c.name in self.far_off}
        return Relief(starts, gain - self.idle)

    def _stacked(self, columns: Columns, coordinates: Sequence[Coordinate]) -> Array:
        """Columns in the quoted noise, over all cells: (rows, coordinates)."""
        parts = []
        for cell in self.cells:
            sigmas = np.array(self.fitter.simulation.views[cell[0]].sigmas)
            nothing = np.zeros_like(self.residuals[cell])
            own = [(columns.get((cell, c.name), nothing) / sigmas).ravel() for c in coordinates]
            parts.append(np.nan_to_num(np.column_stack(own)))
        return np.concatenate(parts)

    @staticmethod
    def _step(columns: Array, theta: Array, weight: Array) -> tuple[float, Array]:
        """Fall of -2 log prior less what the residuals change, and where the step leads."""
        square = columns.T @ columns
        step = np.linalg.solve(square + np.diag(weight), -weight * theta)
        moved = theta + step
        return float(weight @ (theta**2 - moved**2) - step @ square @ step), moved


def _theta_of(effects: Sequence[Coordinate], known: Mapping[str, float]) -> Array:
    """Theta of effects' parameters at known values, else without the effects."""
    return np.array([c.theta(known.get(c.parameter, c.value(c.none))) for c in effects])
