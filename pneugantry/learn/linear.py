"""Evidence of terms that are linear in their coefficients, about a fit: whitened residuals,
the columns of everything that was fitted, and the responses to a missing term beside them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from pneugantry.engine.descent import Weighing
from pneugantry.engine.fitter import Fit
from pneugantry.engine.noise import Noise, Whitener
from pneugantry.engine.plant import Array
from pneugantry.engine.rules import Rules
from pneugantry.engine.simulation import Cell

__all__ = ["Answer", "Base", "Stats", "base_of", "solved"]


@dataclass(frozen=True, eq=False)
class Stats:
    """Normal equations of some rows: J'J, J'r and r'r; the coordinates of the fit come first."""

    square: Array
    pull: Array
    size: float
    rows: int

    def __add__(self, other: Stats) -> Stats:
        return Stats(
            self.square + other.square,
            self.pull + other.pull,
            self.size + other.size,
            self.rows + other.rows,
        )


@dataclass(frozen=True, eq=False)
class Base:
    """A fit whose residuals are explained further. Folds are what is left out in turn: a record
    each, or stretches of the only one.
    """

    fit: Fit
    weighing: Weighing
    roots: Mapping[Cell, Array]  # weights of rows, whitened
    white: Mapping[Cell, Array]  # residuals, whitened and weighted
    columns: Mapping[Cell, Array]  # of the fit's coordinates (rows, n)
    folds: Mapping[Cell, tuple[tuple[str, slice], ...]]  # rows of each signal by fold

    @property
    def precision(self) -> Array:
        """Prior precision of the fit's coordinates."""
        return np.array([c.spread**-2.0 for c in self.fit.point.coordinates])

    def whitened(self, cell: Cell, column: Array) -> Array:
        """A column (rows, signals) as the residuals are."""
        found = self.weighing.innovations(cell, column) * self.roots[cell]
        return np.asarray(np.nan_to_num(found))

    def whitened_all(self, cell: Cell, columns: Array) -> Array:
        """Columns (rows, signals, n) as the residuals are: (rows of all signals, n)."""
        if not columns.shape[2]:
            return np.zeros((len(self.white[cell]), 0))
        told = [self.whitened(cell, columns[:, :, k]) for k in range(columns.shape[2])]
        return np.stack(told, axis=1)

    def stats(self, replies: Mapping[Cell, Array], width: int) -> dict[str, Stats]:
        """By fold, with whitened replies (rows, width) after the fit's coordinates; a cell that has
        none does not answer to the term.
        """
        n = len(self.fit.point.coordinates)
        found: dict[str, Stats] = {}
        for cell, white in self.white.items():
            own = np.zeros((len(white), n + width))
            own[:, :n] = self.columns[cell]
            if cell in replies:
                own[:, n:] = replies[cell]
            for fold, rows in self.folds[cell]:
                j, r = own[rows], white[rows]
                made = Stats(j.T @ j, j.T @ r, float(r @ r), len(r))
                found[fold] = found[fold] + made if fold in found else made
        return found


def base_of(fit: Fit, rules: Rules, parts: int = 4) -> Base:
    """Weights and whitened columns of a fit. parts: stretches into which a single record is cut."""
    weighing = Weighing(_flat(fit, rules), rules)
    names = [c.name for c in fit.point.coordinates]
    roots, white, columns, folds = {}, {}, {}, {}
    records = sorted({c[1] for c in fit.residuals})
    for cell, r in fit.residuals.items():
        if not np.isfinite(r).all():
            continue
        w = weighing.innovations(cell, r)
        freedom = rules.tails
        roots[cell] = np.sqrt((freedom + 1) / (freedom + w**2))
        white[cell] = w * roots[cell]
        columns[cell] = np.zeros((len(w), len(names)))
        for i, name in enumerate(names):
            if (cell, name) in fit.columns:
                column = weighing.innovations(cell, fit.columns[cell, name])
                columns[cell][:, i] = np.nan_to_num(column) * roots[cell]
        folds[cell] = tuple(_folds(cell[1], len(w), r.shape[1], 1 if len(records) > 1 else parts))
    return Base(fit, weighing, roots, white, columns, folds)


def _flat(fit: Fit, rules: Rules) -> Noise:
    """White noise of each residual's own size. What is missing has coloured the residuals: under
    their own colour it would look like noise.
    """
    return {
        cell: tuple(
            Whitener(np.zeros(0), max(float(np.sqrt(np.mean(r[:, c] ** 2))), 0.1 * w.sigma))
            for c, w in enumerate(fit.noise[cell])
        )
        for cell, r in fit.residuals.items()
    }


def _folds(record: str, rows: int, signals: int, parts: int) -> Iterable[tuple[str, slice]]:
    """Rows of a cell by fold; its signals lie one behind the other."""
    each = rows // signals
    ends = np.linspace(0, each, parts + 1).astype(int)
    for s in range(signals):
        for k in range(parts):
            name = record if parts == 1 else f"{record}, part {k + 1}"
            yield name, slice(s * each + int(ends[k]), s * each + int(ends[k + 1]))


@dataclass(frozen=True, eq=False)
class Answer:
    """Coefficients of a term, what they are worth, and their covariance."""

    theta: Array  # of the fit's coordinates, changes
    coefficients: Array
    covariance: Array  # of the coefficients
    cost: float  # -2 log evidence


def solved(base: Base, stats: Iterable[Stats], prior: Array) -> Answer:
    """Joint least squares under priors; prior: precision of the coefficients (width, width)."""
    total: Stats | None = None
    for s in stats:
        total = s if total is None else total + s
    assert total is not None
    own, n = base.precision, len(base.fit.point.coordinates)
    theta = base.fit.point.theta
    square = total.square.copy()
    square[np.arange(n), np.arange(n)] += own
    square[n:, n:] += prior
    pull = -total.pull
    pull[:n] -= own * theta
    factor = np.linalg.cholesky(square)
    found = np.linalg.solve(factor.T, np.linalg.solve(factor, pull))
    occam = 2 * float(np.log(np.diag(factor)).sum()) - float(np.log(own).sum())
    if prior.size:
        occam -= float(np.linalg.slogdet(prior)[1])
    cost = total.size + float(theta @ (own * theta)) - float(found @ pull) + occam
    inverse = np.linalg.solve(factor.T, np.linalg.solve(factor, np.eye(len(found))))
    return Answer(found[:n], found[n:], inverse[n:, n:], cost)
