"""Residuals as costs and normal equations, under given noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pneugantry.engine.fitting import noise
from pneugantry.engine.fitting.noise import Noise
from pneugantry.engine.plant import Array
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.simulation import Cell, Columns, Point, Residuals, Simulation

__all__ = ["FAILED", "LARGE", "Weighing", "flat_noise"]

FAILED = 1e12  # stands for a simulation that failed
LARGE = 5.0  # standard deviations of what stands out


class Weighing:
    """Residuals as costs and normal equations, under given noise."""

    def __init__(self, of_views: Noise, rules: Rules) -> None:
        self.noise, self.freedom = of_views, rules.tails
        self._white: dict[Cell, tuple[list[Array], Array]] = {}  # columns, and as innovations
        self._left: dict[Cell, tuple[Array, Array]] = {}  # a residual, and as innovations

    def of_residual(self, cell: Cell, residual: Array) -> Array:
        """Innovations (rows,) of a cell's residual; kept as long as it is the same array."""
        kept = self._left.get(cell)
        if kept is None or kept[0] is not residual:
            self._left[cell] = kept = (residual, self.innovations(cell, residual))
        return kept[1]

    def innovations(self, cell: Cell, values: Array) -> Array:
        """Whitened residual or columns (..., rows, signals) of a cell, its signals in turn."""
        white = [w(values[..., c]) for c, w in enumerate(self.noise[cell])]
        return white[0] if len(white) == 1 else np.concatenate(white, axis=-1)

    def whitened(self, columns: Columns, cell: Cell, names: Sequence[str]) -> Array:
        """Innovations (columns, rows) of columns of a cell; kept as long as these are the same."""
        own = [columns[cell, name] for name in names]
        kept, white = self._white.get(cell, ([], np.zeros((0, 0))))
        if len(kept) != len(own) or any(a is not b for a, b in zip(kept, own, strict=True)):
            white = self.innovations(cell, np.stack(own))
            if not np.isfinite(white).all():
                white = np.nan_to_num(white, posinf=0.0, neginf=0.0)
            self._white[cell] = own, white
        return white

    def costs(self, residuals: Residuals) -> dict[str, float]:
        """-2 log likelihood by view."""
        found: dict[str, float] = {}
        for cell, r in residuals.items():
            cost = FAILED
            if np.isfinite(r).all():
                cost = float(noise.loss(self.of_residual(cell, r), self.freedom).sum())
            found[cell[0]] = found.get(cell[0], 0.0) + cost
        return found

    def tails(self, residuals: Residuals) -> float:
        """-2 log likelihood of what stands out alone."""
        total = 0.0
        for cell, r in residuals.items():
            w = np.nan_to_num(self.innovations(cell, r))
            total += float(noise.loss(w[np.abs(w) > LARGE], self.freedom).sum())
        return total

    def normal(self, point: Point, residuals: Residuals, columns: Columns) -> tuple[Array, Array]:
        """J'WJ and J'Wr over all cells but those that failed, or whose columns are beyond all
        numbers: what grows without bound tells no step.
        """
        names = [c.name for c in point.coordinates]
        normal, gradient = np.zeros((len(names), len(names))), np.zeros(len(names))
        for cell, r in residuals.items():
            index = [i for i, name in enumerate(names) if (cell, name) in columns]
            if index and np.isfinite(r).all():
                w = self.of_residual(cell, r)
                root = np.sqrt(noise.weights(w, self.freedom))
                j = self.whitened(columns, cell, [names[i] for i in index]) * root
                with np.errstate(over="ignore", invalid="ignore"):
                    square, slope = j @ j.T, j @ (w * root)
                if np.isfinite(square).all() and np.isfinite(slope).all():
                    normal[np.ix_(index, index)] += square
                    gradient[index] += slope
        return normal, gradient


def flat_noise(simulation: Simulation, residuals: Residuals) -> Noise:
    """White noise, in each view of its residuals' own size."""
    of_views = {
        name: tuple(
            noise.flat([r[:, c] for r in _of_view(residuals, name)], sigma)
            for c, sigma in enumerate(simulation.views[name].sigmas)
        )
        for name in dict.fromkeys(c[0] for c in residuals)
    }
    return {cell: of_views[cell[0]] for cell in residuals}


def _of_view(residuals: Residuals, view: str) -> list[Array]:
    """A view's residuals, record after record."""
    return [r for (v, _), r in residuals.items() if v == view]
