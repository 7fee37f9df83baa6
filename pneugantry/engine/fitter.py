"""Fits hypotheses to records: Gauss-Newton on whitened residuals of all views at once, with priors.

A residual depends on few parameters, so it is kept by view and record (a cell), and columns of the
Jacobian exist only where a view reads the parameter. Nuisance columns are taken once, at the fit
without effects, and again whenever a hypothesis is accepted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from pneugantry.diagnosis.catalogue import Form
from pneugantry.engine.hypothesis import (
    Coordinate,
    Hypothesis,
    effect_coordinate,
    nuisance_coordinate,
)
from pneugantry.engine.noise import Whitener, whitener_of
from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.sensors import PREFIX, neutral
from pneugantry.engine.views import View

__all__ = ["Fit", "Fitter"]

Cell = tuple[str, str]  # view, record
FAILED = 1e9


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis fitted."""

    hypothesis: Hypothesis
    coordinates: tuple[Coordinate, ...]
    theta: Array
    residuals: Mapping[Cell, Array]  # (rows, signals), units of the signals
    columns: Mapping[tuple[Cell, str], Array]  # d residual / d theta, by coordinate's name
    whiteners: Mapping[str, tuple[Whitener, ...]]  # by view, one per signal
    covariance: Array
    scale: float = 1.0  # of the rig's tolerance
    stretches: Array = field(default_factory=lambda: np.zeros(0))  # -2 log likelihood, by stretch
    cost: float = 0.0  # priors, Occam factor and order of the noise

    @property
    def keys(self) -> tuple[str, ...]:
        return self.hypothesis.keys

    @property
    def evidence(self) -> float:
        """-2 log evidence; smaller is better."""
        return float(self.stretches.sum()) + self.cost

    def value(self, name: str) -> float:
        for c, theta in zip(self.coordinates, self.theta, strict=True):
            if c.name == name:
                return c.value(theta)
        raise KeyError(name)

    def values(self, record: str | None) -> dict[str, float]:
        """Parameters of a record; None: those of no record in particular."""
        found = dict(self.hypothesis.settings)
        for c, theta in zip(self.coordinates, self.theta, strict=True):
            if c.record is None or c.record == record:
                found[c.parameter] = c.value(theta)
        return found


class Fitter:
    """Views over records."""

    def __init__(
        self, plant: Plant, views: Sequence[View], records: Sequence[Record], rules: Rules
    ) -> None:
        self.plant, self.rules, self.records = plant, rules, {r.name: r for r in records}
        self.views = {v.name: v for v in views}
        self.cells = [(v.name, r.name) for v in views for r in records if v.shows(r)]
        self.nominal = self._nominal()
        self.simulated = 0.0  # s of records
        self._pool = ThreadPoolExecutor(2)

    def close(self) -> None:
        self._pool.shutdown()

    def _nominal(self) -> dict[str, float]:
        known: dict[str, float] = {}
        for view in self.views.values():
            part = getattr(view, "part", None)
            for v in part.variables if part is not None else ():
                if v.kind == "parameter" and v.start is not None:
                    known[v.name] = v.start
        return {**known, **self.plant.parameters}

    # -- coordinates

    def nuisances(self) -> list[Coordinate]:
        made = []
        for n in self.plant.nuisances:
            if n.per_record:
                for name, record in self.records.items():
                    if n.parameter in record.parameters and self._read((n.parameter), name):
                        centre = record.parameters[n.parameter]
                        made.append(nuisance_coordinate(n, centre, name))
            elif self._read(n.parameter, None):
                made.append(nuisance_coordinate(n, self.neutral(n.parameter), None))
        return made

    def neutral(self, name: str) -> float:
        return neutral(name) if name.startswith(PREFIX) else self.nominal.get(name, 0.0)

    def _read(self, parameter: str, record: str | None) -> bool:
        return any(
            self.views[v].depends_on(parameter) for v, r in self.cells if record in (None, r)
        )

    def readable(self, form: Form) -> bool:
        """Whether some view reads a parameter of a form."""
        return any(self._read(p.name, None) for p in form.parameters)

    def coordinates(self, hypothesis: Hypothesis, scale: float) -> list[Coordinate]:
        effects = [
            effect_coordinate(p, self.neutral(p.name), self.rules.effect_prior)
            for p in hypothesis.parameters
        ]
        taken = {c.parameter for c in effects}
        rest = [c for c in self.nuisances() if c.parameter not in taken]
        rest = [replace(c, spread=scale) if c.scales else c for c in rest]
        return [*rest, *effects]

    # -- simulation

    def simulate(self, jobs: Mapping[Cell, Sequence[Mapping[str, float]]]) -> dict[Cell, Array]:
        """Residuals (values, rows, signals) of each cell."""

        def run(cell: Cell) -> Array:
            view, record = self.views[cell[0]], self.records[cell[1]]
            return view.residuals(record, jobs[cell])

        cells = sorted(jobs, key=lambda c: -len(jobs[c]) * self.records[c[1]].rows)
        for cell in cells:
            record = self.records[cell[1]]
            self.simulated += len(jobs[cell]) * record.rows * record.period
        return dict(zip(cells, self._pool.map(run, cells), strict=True))

    def linearise(
        self,
        coordinates: Sequence[Coordinate],
        theta: Array,
        settings: Mapping[str, float],
        wanted: set[str],
        cells: Sequence[Cell] | None = None,
    ) -> tuple[dict[Cell, Array], dict[tuple[Cell, str], Array]]:
        """Residuals, and columns of the coordinates named, at a point."""
        jobs: dict[Cell, list[dict[str, float]]] = {}
        moved: dict[Cell, list[tuple[Coordinate, float]]] = {}
        for cell in cells or self.cells:
            view, record = self.views[cell[0]], cell[1]
            base = self._values(coordinates, theta, settings, record)
            jobs[cell], moved[cell] = [base], []
            for c, t in zip(coordinates, theta, strict=True):
                if c.name not in wanted or c.record not in (None, record):
                    continue
                if not view.depends_on(c.parameter):
                    continue
                step = self._step(c, t)
                jobs[cell].append({**base, c.parameter: c.value(t + step)})
                moved[cell].append((c, step))
        found = self.simulate(jobs)
        residuals = {cell: r[0] for cell, r in found.items()}
        columns = {
            (cell, c.name): (found[cell][i + 1] - found[cell][0]) / step
            for cell, steps in moved.items()
            for i, (c, step) in enumerate(steps)
        }
        return residuals, columns

    def _step(self, c: Coordinate, theta: float) -> float:
        step = self.rules.difference
        return step if c.value(theta + step) != c.value(theta) else -step

    def _values(
        self,
        coordinates: Sequence[Coordinate],
        theta: Array,
        settings: Mapping[str, float],
        record: str,
    ) -> dict[str, float]:
        values = dict(settings)
        for c, t in zip(coordinates, theta, strict=True):
            if c.record is None or c.record == record:
                values[c.parameter] = c.value(t)
        return values

    # -- fits

    def fit(
        self,
        hypothesis: Hypothesis,
        base: Fit | None = None,
        starts: Mapping[str, float] | None = None,
        thorough: bool = False,
    ) -> Fit:
        """`base`: where nuisances start and whose columns of them are used unless `thorough`;
        `starts`: values of effect parameters to start from.
        """
        scale = base.scale if base else self.rules.tolerance
        coordinates = self.coordinates(hypothesis, scale)
        theta = self._first(coordinates, base, starts or {})
        whiteners = base.whiteners if base else self.quoted()
        settings = hypothesis.settings
        touched = self._touched(hypothesis, base) if base and not thorough else set(self.cells)
        kept = {} if base is None or thorough else dict(base.columns)
        fresh = {c.name for c in coordinates if c.effect or thorough or base is None}
        residuals: dict[Cell, Array] = {}
        columns: dict[tuple[Cell, str], Array] = {}
        if base is None:
            theta = self._by_view(coordinates, theta, settings, whiteners)
        if not thorough:  # white noise as large as the misfit: the widest basin
            whiteners = self.flat(base.residuals) if base else whiteners
            residuals, columns, theta = self._descend(
                coordinates, theta, settings, whiteners, touched, kept, fresh, base, reweigh=True
            )
            whiteners = self._whiten(residuals)
            kept = columns
        settled = self.rules.settled * (1 if thorough or base is None else 6)
        residuals, columns, theta = self._descend(
            coordinates, theta, settings, whiteners, touched, kept, fresh, base, settled
        )
        whiteners = self._whiten(residuals)
        return self._finished(hypothesis, coordinates, theta, residuals, columns, whiteners, scale)

    def _by_view(
        self,
        coordinates: Sequence[Coordinate],
        theta: Array,
        settings: Mapping[str, float],
        whiteners: Mapping[str, tuple[Whitener, ...]],
    ) -> Array:
        """A start for the joint fit: each view by itself, a coordinate of several views from the
        view that knows most of it.
        """
        known = np.zeros(len(coordinates))
        result = theta.copy()
        for name, view in self.views.items():
            cells = {c for c in self.cells if c[0] == name}
            index = [i for i, c in enumerate(coordinates) if view.depends_on(c.parameter)]
            if not index or not cells:
                continue
            own = [coordinates[i] for i in index]
            names = {c.name for c in own}
            residuals, columns, at = self._descend(
                own, theta[index], settings, whiteners, cells, {}, names, None, reweigh=True
            )
            if view.observes and self._misfit(residuals) > self.rules.doubtful:
                at = theta[index]
                for share in self.rules.homotopy:
                    view.looser(share)
                    residuals, columns, at = self._descend(
                        own, at, settings, whiteners, cells, {}, names, None, reweigh=True
                    )
            for j, i in enumerate(index):
                size = sum(
                    float(
                        (columns[key] / view.sigmas[0]).ravel()
                        @ (columns[key] / view.sigmas[0]).ravel()
                    )
                    for key in columns
                    if key[1] == coordinates[i].name
                )
                if size > known[i]:
                    known[i], result[i] = size, at[j]
        return result

    def _misfit(self, residuals: Mapping[Cell, Array]) -> float:
        """RMS of residuals in units of the quoted noise."""
        squares = [
            np.mean((r / np.array(self.views[cell[0]].sigmas)) ** 2)
            for cell, r in residuals.items()
        ]
        return float(np.sqrt(np.mean(squares)))

    def _first(
        self, coordinates: Sequence[Coordinate], base: Fit | None, starts: Mapping[str, float]
    ) -> Array:
        known = (
            dict(zip((c.name for c in base.coordinates), base.theta, strict=True)) if base else {}
        )
        of_base = (
            {c.name: c.value(t) for c, t in zip(base.coordinates, base.theta, strict=True)}
            if base
            else {}
        )
        theta = np.zeros(len(coordinates))
        for i, c in enumerate(coordinates):
            if c.parameter in starts:
                theta[i] = c.theta(starts[c.parameter])
            elif c.effect and c.name in of_base:
                theta[i] = c.theta(of_base[c.name])
            elif c.name in known and not c.effect:
                theta[i] = known[c.name]
        return theta

    def _touched(self, hypothesis: Hypothesis, base: Fit) -> set[Cell]:
        """Cells in which the hypothesis differs from the base: the rest is taken as linear."""
        new = {p.name for p in hypothesis.parameters} | set(hypothesis.settings)
        new |= {p.name for p in base.hypothesis.parameters} | set(base.hypothesis.settings)
        return {c for c in self.cells if any(self.views[c[0]].depends_on(p) for p in new)}

    def _descend(
        self,
        coordinates: Sequence[Coordinate],
        theta: Array,
        settings: Mapping[str, float],
        whiteners: Mapping[str, tuple[Whitener, ...]],
        touched: set[Cell],
        kept: Mapping[tuple[Cell, str], Array],
        fresh: set[str],
        base: Fit | None,
        settled: float = 2.0,
        reweigh: bool = False,
    ) -> tuple[dict[Cell, Array], dict[tuple[Cell, str], Array], Array]:
        spread = np.array([c.spread for c in coordinates])
        cells = [c for c in self.cells if c in touched]

        def rest(at: Array) -> dict[Cell, Array]:
            """Residuals of the cells that are taken as linear about the base."""
            if base is None:
                return {}
            known = dict(zip((c.name for c in base.coordinates), base.theta, strict=True))
            found = {}
            for cell in self.cells:
                if cell in touched:
                    continue
                value = base.residuals[cell]
                for c, t in zip(coordinates, at, strict=True):
                    column = base.columns.get((cell, c.name))
                    if column is not None and t != known.get(c.name, t):
                        value = value + column * (t - known[c.name])
                found[cell] = value
            return found

        columns = dict(kept)
        residuals, made = self.linearise(coordinates, theta, settings, fresh, cells)
        columns.update(made)
        residuals |= rest(theta)
        groups = self._groups(coordinates)
        damping = np.full(len(coordinates), self.rules.damping)
        for iteration in range(self.rules.iterations):
            if reweigh:
                whiteners = self.flat(residuals)
            costs = self._costs(residuals, whiteners)
            cost = sum(costs.values()) + float(((theta / spread) ** 2).sum())
            normal, gradient = self._normal(coordinates, residuals, columns, whiteners)
            normal += np.diag(1 / spread**2)
            gradient += theta / spread**2
            better = False
            for _ in range(5):
                step = -np.linalg.solve(normal + np.diag(damping * np.diag(normal)), gradient)
                tried, todo, moved = dict(residuals), list(cells), np.ones(len(theta), dtype=bool)
                for _ in range(3):
                    trial = self._inside(coordinates, np.where(moved, theta + step, theta))
                    found, _ = self.linearise(coordinates, trial, settings, set(), todo)
                    tried = {**tried, **found, **rest(trial)}
                    after = self._costs(tried, whiteners)
                    worse = {v for v in after if after[v] > costs[v] + 1e-9}
                    value = sum(after.values()) + float(((trial / spread) ** 2).sum())
                    held = np.array([bool(g) and g <= worse for g in groups]) & moved
                    if value < cost and not held.any():
                        break
                    if held.any():  # back in what only views read that became worse
                        moved &= ~held
                        todo = [c for c in cells if c[0] in worse]
                    else:  # back in what several views read
                        moved &= np.array([len(g) < 2 for g in groups])
                        todo = list(cells)
                damping = np.where(moved, np.maximum(0.1 * damping, 1e-4), 10 * damping)
                if value < cost and moved.any():
                    better = True
                    break
                damping = np.maximum(damping, self.rules.damping) * 3
            if not better:
                break
            fall, theta, residuals = cost - value, trial, tried
            if fall < settled or iteration == self.rules.iterations - 1:
                break
            _, made = self.linearise(coordinates, theta, settings, fresh, cells)
            columns.update(made)
        return residuals, columns, theta

    def _groups(self, coordinates: Sequence[Coordinate]) -> list[set[str]]:
        """The views that read each coordinate."""
        return [
            {
                v
                for v, r in self.cells
                if c.record in (None, r) and self.views[v].depends_on(c.parameter)
            }
            for c in coordinates
        ]

    @staticmethod
    def _inside(coordinates: Sequence[Coordinate], theta: Array) -> Array:
        result = theta.copy()
        for i, c in enumerate(coordinates):
            if not c.logarithmic or c.low > 0:
                value = c.value(theta[i])
                if value in (c.low, c.high):
                    result[i] = c.theta(value)
        return result

    # -- whitened algebra

    def quoted(self) -> dict[str, tuple[Whitener, ...]]:
        return {n: tuple(Whitener(np.zeros(0), s) for s in v.sigmas) for n, v in self.views.items()}

    def flat(self, residuals: Mapping[Cell, Array]) -> dict[str, tuple[Whitener, ...]]:
        """White noise of the residuals' own size."""
        found = {}
        for name, view in self.views.items():
            own = [r for (v, _), r in residuals.items() if v == name]
            size = [
                max(float(np.sqrt(np.mean(np.concatenate([r[:, c] for r in own]) ** 2))), sigma)
                if own
                else sigma
                for c, sigma in enumerate(view.sigmas)
            ]
            found[name] = tuple(Whitener(np.zeros(0), s) for s in size)
        return found

    def _whiten(self, residuals: Mapping[Cell, Array]) -> dict[str, tuple[Whitener, ...]]:
        found = {}
        for name, view in self.views.items():
            own = [r for (v, _), r in residuals.items() if v == name]
            found[name] = tuple(
                whitener_of([r[:, c] for r in own], self.rules.quietest * sigma)
                if own
                else Whitener(np.zeros(0), sigma)
                for c, sigma in enumerate(view.sigmas)
            )
        return found

    def whitened(
        self, cell: Cell, values: Array, whiteners: Mapping[str, tuple[Whitener, ...]]
    ) -> Array:
        """Innovations of a cell's residual or column, flattened."""
        parts = [w(values[:, c]) for c, w in enumerate(whiteners[cell[0]])]
        return np.concatenate(parts)

    def _costs(
        self, residuals: Mapping[Cell, Array], whiteners: Mapping[str, tuple[Whitener, ...]]
    ) -> dict[str, float]:
        found: dict[str, float] = {}
        for cell, r in residuals.items():
            w = self.whitened(cell, r, whiteners) if np.isfinite(r).all() else np.array([FAILED])
            found[cell[0]] = found.get(cell[0], 0.0) + float(w @ w)
        return found

    def _cost(
        self, residuals: Mapping[Cell, Array], whiteners: Mapping[str, tuple[Whitener, ...]]
    ) -> float:
        total = 0.0
        for cell, r in residuals.items():
            if not np.isfinite(r).all():
                return FAILED
            w = self.whitened(cell, r, whiteners)
            total += float(w @ w)
        return total

    def _normal(
        self,
        coordinates: Sequence[Coordinate],
        residuals: Mapping[Cell, Array],
        columns: Mapping[tuple[Cell, str], Array],
        whiteners: Mapping[str, tuple[Whitener, ...]],
    ) -> tuple[Array, Array]:
        n = len(coordinates)
        normal, gradient = np.zeros((n, n)), np.zeros(n)
        for cell, r in residuals.items():
            index = [
                i
                for i, c in enumerate(coordinates)
                if c.record in (None, cell[1]) and (cell, c.name) in columns
            ]
            if not index:
                continue
            w = self.whitened(cell, r, whiteners)
            j = np.column_stack(
                [self.whitened(cell, columns[cell, coordinates[i].name], whiteners) for i in index]
            )
            j = np.nan_to_num(j)
            normal[np.ix_(index, index)] += j.T @ j
            gradient[index] += j.T @ w
        return normal, gradient

    def _finished(
        self,
        hypothesis: Hypothesis,
        coordinates: Sequence[Coordinate],
        theta: Array,
        residuals: Mapping[Cell, Array],
        columns: Mapping[tuple[Cell, str], Array],
        whiteners: Mapping[str, tuple[Whitener, ...]],
        scale: float,
    ) -> Fit:
        spread = np.array([c.spread for c in coordinates])
        normal, _ = self._normal(coordinates, residuals, columns, whiteners)
        normal += np.diag(1 / spread**2)
        covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
        scaled = normal * np.outer(spread, spread)
        penalty = float(((theta / spread) ** 2).sum()) + float(np.linalg.slogdet(scaled)[1])
        stretches = []
        count = 0
        for cell, r in residuals.items():
            view = self.views[cell[0]]
            period = self.records[cell[1]].period * view.decimation
            length = max(4, round(self.rules.block / period))
            for c, w in enumerate(whiteners[cell[0]]):
                terms = w(r[:, c]) ** 2 + 2 * math.log(w.sigma)
                count += len(terms)
                parts = np.array_split(terms, max(1, len(terms) // length))
                stretches += [float(p.sum()) for p in parts]
        order = sum(len(w.coefficients) for ws in whiteners.values() for w in ws)
        return Fit(
            hypothesis,
            tuple(coordinates),
            theta,
            residuals,
            columns,
            whiteners,
            covariance,
            scale,
            np.array(stretches),
            penalty + order * math.log(max(count, 2)),
        )
