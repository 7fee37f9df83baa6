"""Fits hypotheses to records, with priors, and their evidence (Laplace's approximation)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pneugantry.diagnosis.catalogue import Form
from pneugantry.engine import noise
from pneugantry.engine.descent import (
    Problem,
    Solution,
    Weighing,
    descend,
    flat_noise,
    inside,
    of_view,
    penalty,
)
from pneugantry.engine.hypothesis import (
    Coordinate,
    Hypothesis,
    effect_coordinate,
    nuisance_coordinate,
)
from pneugantry.engine.noise import Noise, Whitener
from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.sensors import PREFIX, neutral
from pneugantry.engine.simulation import Cell, Columns, Point, Residuals, Simulation
from pneugantry.engine.views import View

__all__ = ["Fit", "Fitter"]

ROUGH = 2.0  # fall of -2 log posterior that ends a descent of which another follows


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis fitted."""

    hypothesis: Hypothesis
    point: Point
    residuals: Residuals
    columns: Columns
    noise: Noise
    covariance: Array  # of theta
    scale: float  # of the rig's tolerance
    stretches: Array  # -2 log likelihood, by stretch of a record
    cost: float  # priors, Occam factor and order of the noise

    @property
    def keys(self) -> tuple[str, ...]:
        return self.hypothesis.keys

    @property
    def evidence(self) -> float:
        """-2 log evidence; smaller is better."""
        return float(self.stretches.sum()) + self.cost

    def values(self, record: str | None) -> dict[str, float]:
        """Parameters of a record; None: those of no record in particular."""
        return self.point.values(record)

    def sigma(self, name: str) -> float:
        """Standard deviation of a coordinate's theta."""
        index = [c.name for c in self.point.coordinates].index(name)
        return float(np.sqrt(self.covariance[index, index]))


class Fitter:
    """One plant, its views and its records."""

    def __init__(
        self, plant: Plant, views: Sequence[View], records: Sequence[Record], rules: Rules
    ) -> None:
        self.plant, self.rules = plant, rules
        self.simulation = Simulation(views, records, rules.difference)
        self.nominal = _nominal(plant, views)

    def close(self) -> None:
        self.simulation.close()

    # -- coordinates

    def neutral(self, name: str) -> float:
        """Value of a parameter without any effect."""
        return neutral(name) if name.startswith(PREFIX) else self.nominal.get(name, 0.0)

    def readable(self, form: Form) -> bool:
        """Whether some view reads a parameter of a form."""
        return any(self.simulation.reads(p.name) for p in form.parameters)

    def touched(self, hypothesis: Hypothesis) -> list[Cell]:
        """Cells whose view reads anything of a hypothesis' effects."""
        names = {p.name for p in hypothesis.parameters} | set(hypothesis.settings)
        views = self.simulation.views
        return [c for c in self.simulation.cells if any(views[c[0]].depends_on(n) for n in names)]

    def coordinates(self, hypothesis: Hypothesis, scale: float) -> tuple[Coordinate, ...]:
        """Nuisances, then effects; an effect's parameter is no nuisance besides."""
        effects = [
            effect_coordinate(p, self.neutral(p.name), self.rules.effect_prior)
            for p in hypothesis.parameters
        ]
        taken = {c.parameter for c in effects}
        rest = [c for c in self.nuisances() if c.parameter not in taken]
        return (*(replace(c, spread=scale) if c.scales else c for c in rest), *effects)

    def nuisances(self) -> list[Coordinate]:
        """Coordinates of what every rig has somewhat off."""
        made = []
        for n in self.plant.nuisances:
            if not n.per_record:
                if self.simulation.reads(n.parameter):
                    made.append(nuisance_coordinate(n, self.neutral(n.parameter), None))
                continue
            for name, record in self.simulation.records.items():
                if n.parameter in record.parameters and self.simulation.reads(n.parameter, name):
                    made.append(nuisance_coordinate(n, record.parameters[n.parameter], name))
        return made

    # -- fits

    def null(self) -> Fit:
        """Nuisances alone."""
        hypothesis = Hypothesis()
        coordinates = self.coordinates(hypothesis, self.rules.tolerance)
        start = Point(coordinates, np.zeros(len(coordinates)), {})
        return self._whole(hypothesis, start, self.rules.tolerance, set(self.simulation.views))

    def again(self, fit: Fit) -> Fit:
        """The same hypothesis from where a fit ended, all coordinates free."""
        views = {view for view, _ in self.touched(fit.hypothesis)}
        return self._whole(fit.hypothesis, fit.point, fit.scale, views)

    def explore(
        self, hypothesis: Hypothesis, base: Fit, starts: Mapping[str, float] | None = None
    ) -> Fit:
        """A hypothesis near `base`: only what its effects touch is fitted. `starts`: values of
        effect parameters to start from.
        """
        start = self._first(hypothesis, base, starts or {})
        touched = set(self.touched(hypothesis)) | set(self.touched(base.hypothesis))
        cells = tuple(c for c in self.simulation.cells if c in touched)
        problem = Problem(
            self.simulation,
            self.rules,
            cells,
            fixed=self._fixed(start.coordinates, touched),
            fresh=frozenset(c.name for c in start.coordinates if c.effect),
        )
        residuals, made = self.simulation.linearised(start, cells, set(problem.fresh))
        solution = Solution(start, {**base.residuals, **residuals}, {**base.columns, **made})
        solution = descend(problem, solution, None, ROUGH)
        solution = descend(problem, solution, self._colour(solution.residuals), ROUGH)
        return self._finished(hypothesis, solution, base.scale)

    def _whole(self, hypothesis: Hypothesis, start: Point, scale: float, views: set[str]) -> Fit:
        """`views`: those that are first fitted by themselves."""
        self.simulation.forget()
        merged, columns = self._by_view(start, views)
        problem = Problem(
            self.simulation,
            self.rules,
            tuple(self.simulation.cells),
            fresh=frozenset(c.name for c in start.coordinates),
        )
        residuals = self.simulation.residuals(merged, problem.cells)
        solution = Solution(merged, residuals, columns)
        solution = descend(problem, solution, self._colour(residuals), ROUGH)
        solution = descend(problem, solution, self._colour(solution.residuals), self.rules.settled)
        return self._finished(hypothesis, solution, scale)

    def _by_view(self, start: Point, views: set[str]) -> tuple[Point, Columns]:
        """A start for a joint fit: each view by itself, then the least of the sum of their
        parabolas. Columns: those of the views.
        """
        prior = np.array([c.spread for c in start.coordinates]) ** -2.0
        square, pull = np.diag(prior), np.zeros(len(prior))
        columns: Columns = {}
        for name in self.simulation.views:
            cells = tuple(c for c in self.simulation.cells if c[0] == name)
            index = [
                i
                for i, c in enumerate(start.coordinates)
                if any(self.simulation.in_cell(c, cell) for cell in cells)
            ]
            if not index:
                continue
            own = Point(
                tuple(start.coordinates[i] for i in index), start.theta[index], start.settings
            )
            fresh = frozenset(c.name for c in own.coordinates)
            problem = Problem(self.simulation, self.rules, cells, fresh=fresh)
            found = self.simulation.linearised(own, cells, set(fresh))
            solution = Solution(own, *found)
            if name in views:
                solution = descend(problem, solution, None, ROUGH)
            weighing = Weighing(self._colour(solution.residuals), self.rules.tails)
            normal, gradient = weighing.normal(
                solution.point, solution.residuals, solution.columns
            )
            square[np.ix_(index, index)] += normal
            pull[index] += normal @ solution.point.theta - gradient
            columns |= solution.columns
        return inside(start.moved(np.linalg.solve(square, pull))), columns

    def _first(self, hypothesis: Hypothesis, base: Fit, starts: Mapping[str, float]) -> Point:
        coordinates = self.coordinates(hypothesis, base.scale)
        known = {
            c.name: (c, t) for c, t in zip(base.point.coordinates, base.point.theta, strict=True)
        }
        theta = np.zeros(len(coordinates))
        for i, c in enumerate(coordinates):
            if c.parameter in starts:
                theta[i] = c.theta(starts[c.parameter])
            elif c.name in known:
                old, at = known[c.name]
                theta[i] = at if old == c else c.theta(old.value(at))
        return Point(coordinates, theta, hypothesis.settings)

    def _fixed(self, coordinates: Sequence[Coordinate], touched: set[Cell]) -> frozenset[str]:
        """Nuisances that views outside the hypothesis read: they stay as they are."""
        outside = {c[0] for c in self.simulation.cells if c not in touched}
        return frozenset(
            c.name for c in coordinates if not c.effect and self.simulation.readers(c) & outside
        )

    # -- noise and evidence

    def quoted(self) -> Noise:
        """White noise as the sensors are said to have."""
        return {
            name: tuple(Whitener(np.zeros(0), s) for s in view.sigmas)
            for name, view in self.simulation.views.items()
        }

    def flat(self, residuals: Residuals) -> Noise:
        """White noise of the residuals' own size."""
        return flat_noise(self.simulation, residuals)

    def _colour(self, residuals: Residuals) -> Noise:
        return {
            name: tuple(
                noise.coloured(
                    [r[:, c] for r in of_view(residuals, name)], self.rules.quietest * sigma
                )
                for c, sigma in enumerate(view.sigmas)
            )
            for name, view in self.simulation.views.items()
        }

    def _finished(self, hypothesis: Hypothesis, solution: Solution, scale: float) -> Fit:
        point, colour = solution.point, self._colour(solution.residuals)
        weighing = Weighing(colour, self.rules.tails)
        spreads = np.array([c.spread for c in point.coordinates])
        normal, _ = weighing.normal(point, solution.residuals, solution.columns)
        normal += np.diag(1 / spreads**2)
        occam = float(np.linalg.slogdet(normal * np.outer(spreads, spreads))[1])
        stretches, rows = self._stretches(solution.residuals, colour)
        order = sum(len(w.coefficients) for ws in colour.values() for w in ws)
        return Fit(
            hypothesis,
            point,
            solution.residuals,
            solution.columns,
            colour,
            np.asarray(np.linalg.inv(normal), dtype=np.float64),
            scale,
            stretches,
            penalty(point) + occam + order * math.log(max(rows, 2)),
        )

    def _stretches(self, residuals: Residuals, colour: Noise) -> tuple[Array, int]:
        """-2 log likelihood by stretch, and the number of rows."""
        found: list[float] = []
        rows = 0
        for cell, r in residuals.items():
            view, record = self.simulation.views[cell[0]], self.simulation.records[cell[1]]
            length = max(4, round(self.rules.block / (record.period * view.decimation)))
            for c, w in enumerate(colour[cell[0]]):
                terms = noise.loss(w(r[:, c]), self.rules.tails) + 2 * math.log(w.sigma)
                parts = np.array_split(terms, max(1, len(terms) // length))
                found += [float(p.sum()) for p in parts]
                rows += len(terms)
        return np.array(found), rows


def _nominal(plant: Plant, views: Sequence[View]) -> dict[str, float]:
    """Values of the model's parameters."""
    known: dict[str, float] = {}
    for view in views:
        known.update(view.defaults)
    return {**known, **plant.parameters}
