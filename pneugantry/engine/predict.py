"""How well a fit foretells a record that it has not seen.

What the fit leaves of its parameters (their normal distribution) is the prior on the new record,
and so is the rig's scatter of what belongs to one record alone. The evidence of the new record
under them counts whatever a fit has bent to its own records against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pneugantry.engine.descent import Parabola, Problem, Solution, Weighing, descend
from pneugantry.engine.fitter import ROUGH, Fit, Fitter, fallen
from pneugantry.engine.hypothesis import Coordinate
from pneugantry.engine.noise import Noise
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.simulation import Cell, Point
from pneugantry.engine.views import View

__all__ = ["Foretelling", "Foretold"]


@dataclass(frozen=True, eq=False)
class Foretold:
    """What a record costs: -2 log likelihood by stretch, and prior with Occam's factor."""

    stretches: dict[Cell, Array]
    sizes: dict[Cell, int]  # values in each cell's residual
    price: float


class Foretelling:
    """One record beside fits to others."""

    def __init__(self, fitter: Fitter, views: Sequence[View], record: Record) -> None:
        self.fitter = Fitter(fitter.plant, views, (record,), fitter.rules)
        self._noise: Noise | None = None

    def close(self) -> None:
        self.fitter.close()

    def cost(self, fit: Fit) -> Foretold:
        """Under noise that is the same for all fits that are asked after the first."""
        sim, rules = self.fitter.simulation, self.fitter.rules
        cells = tuple(sim.cells)
        point, known = self._start(fit)
        residuals, columns = sim.linearised(point, cells, set(known.names))
        start, problem = Solution(point, residuals, columns), Problem(sim, rules, cells, known)
        rough = descend(problem, start, None, ROUGH)
        if self._noise is None:
            self._noise = self.fitter.coloured(rough.residuals)
        weighing = Weighing(self._noise, rules)
        ends = [descend(problem, s, self._noise, rules.converged) for s in (start, rough)]
        solution = min(
            ends,
            key=lambda s: sum(weighing.costs(s.residuals).values()) + known.cost(s.point.theta),
        )
        normal, _ = weighing.normal(solution.point, solution.residuals, solution.columns)
        change = solution.point.theta - known.least()
        prior = float(change @ known.square @ change)
        occam = float(np.linalg.slogdet(known.square + normal)[1])
        occam -= float(np.linalg.slogdet(known.square)[1])
        stretches = {
            c: self.fitter.stretches(c, r, self._noise[c]) for c, r in solution.residuals.items()
        }
        sizes = {c: r.size for c, r in solution.residuals.items()}
        return Foretold(stretches, sizes, prior + occam)

    def gain(self, fit: Fit, base: Foretold) -> float:
        """Fall of -2 log evidence from that of another fit (`cost`), less its doubt and what is
        immaterial.
        """
        own, rules = self.cost(fit), self.fitter.rules
        return base.price - own.price + fallen(base.stretches, own.stretches, base.sizes, rules)

    def _start(self, fit: Fit) -> tuple[Point, Parabola]:
        """Coordinates of the record, where the fit has them, and what the fit says of them."""
        coordinates = self.fitter.coordinates(fit.hypothesis, fit.scale)
        at = {c.name: i for i, c in enumerate(fit.point.coordinates)}
        shared = [i for i, c in enumerate(coordinates) if c.name in at]
        index = [at[coordinates[i].name] for i in shared]
        square = np.diag([c.spread**-2.0 for c in coordinates])
        theta = np.array([0.0 for _ in coordinates])
        theta[shared] = fit.point.theta[index]
        square[np.ix_(shared, shared)] = np.linalg.inv(fit.covariance[np.ix_(index, index)])
        for i, c in enumerate(coordinates):
            if c.record is not None:
                theta[i], square[i, i] = _of_one_record(fit, c)
        point = Point(coordinates, theta, fit.hypothesis.settings)
        return point, Parabola(tuple(c.name for c in coordinates), square, square @ theta)


def _of_one_record(fit: Fit, own: Coordinate) -> tuple[float, float]:
    """What the fitted records say of another one's own coordinate: mean and precision of theta."""
    pairs = zip(fit.point.coordinates, fit.point.theta, strict=True)
    found = np.array([t for c, t in pairs if c.parameter == own.parameter and c.record is not None])
    prior = own.spread**2
    if len(found) == 0:
        return 0.0, 1 / prior
    scatter = float(found.var(ddof=1)) if len(found) > 1 else prior
    share = prior / (prior + scatter / len(found))
    spread = scatter * (1 + 1 / len(found))
    return share * float(found.mean()), 1 / min(max(spread, prior / 100), prior)
