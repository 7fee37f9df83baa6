"""Evidence of terms that are linear in their coefficients, about a fit: whitened residuals,
the columns of everything that was fitted, and the responses to a missing term beside them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.noise import Noise
from pneugantry.engine.fitting.weighing import Weighing
from pneugantry.engine.plant import Array
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.simulation import Cell
from pneugantry.learn.screening.reply import Reply, means

__all__ = [
    "Base",
    "Estimate",
    "Response",
    "Trial",
    "base_of",
    "response_of",
    "trial_of",
    "trial_over",
]

PARTS = 4  # stretches into which a single record is cut


@dataclass(frozen=True, eq=False)
class Sums:
    """J'J, J'r and r'r of the fit's coordinates over some rows."""

    square: Array
    pull: Array
    size: float

    def __add__(self, other: Sums) -> Sums:
        return Sums(self.square + other.square, self.pull + other.pull, self.size + other.size)


def sum_of(several: Iterable[Sums]) -> Sums:
    """Of at least one."""
    return reduce(Sums.__add__, several)


@dataclass(frozen=True, eq=False)
class Kept:
    """Some folds, the fit's coordinates eliminated."""

    folds: frozenset[str]
    factor: Array  # lower; of J'J and the prior
    pull: Array  # of the coordinates, divided by it
    cost: float  # -2 log evidence without any term


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
        told = self.weighing.innovations(cell, np.moveaxis(columns, 2, 0)) * self.roots[cell]
        return np.asarray(np.nan_to_num(told).T)

    def products(self, cell: Cell, columns: Array) -> dict[str, Products]:
        """Of whitened columns (rows of all signals, n) of a cell, by fold."""
        found: dict[str, Products] = {}
        for fold, rows in self.folds[cell]:
            m, j, r = columns[rows], self.columns[cell][rows], self.white[cell][rows]
            made = Products(m.T @ m, j.T @ m, m.T @ r)
            found[fold] = found[fold] + made if fold in found else made
        return found

    @cached_property
    def sums(self) -> dict[str, Sums]:
        """By fold, of the fit's coordinates alone."""
        found: dict[str, Sums] = {}
        for cell, white in self.white.items():
            for fold, rows in self.folds[cell]:
                j, r = self.columns[cell][rows], white[rows]
                made = Sums(j.T @ j, j.T @ r, float(r @ r))
                found[fold] = found[fold] + made if fold in found else made
        return found

    @cached_property
    def kept(self) -> dict[str, Kept]:
        """What is kept by the fold that is left out, "" for none."""
        found: dict[str, Kept] = {}
        own, theta = self.precision, self.fit.point.theta
        for left_out in ("", *self.sums):
            total = sum_of(s for name, s in self.sums.items() if name != left_out)
            factor = np.asarray(np.linalg.cholesky(total.square + np.diag(own)))
            pull = np.linalg.solve(factor, -total.pull - own * theta)
            occam = 2 * float(np.log(np.diag(factor)).sum()) - float(np.log(own).sum())
            cost = total.size + float(theta @ (own * theta)) - float(pull @ pull) + occam
            folds = frozenset(self.sums) - {left_out}
            found[left_out] = Kept(folds, factor, np.asarray(pull), cost)
        return found

    def predicted(self, cost: Callable[[str], float]) -> float:
        """-2 log density of each fold as predicted by the others, summed. cost: -2 log evidence by
        the fold that is left out.
        """
        whole = cost("")
        return sum(whole - cost(fold) for fold in self.sums)

    @cached_property
    def plain(self) -> float:
        """The same without any term."""
        return self.predicted(lambda left_out: self.kept[left_out].cost)


def base_of(fit: Fit, of_views: Noise, rules: Rules) -> Base:
    """Weights and whitened columns of a fit. of_views: noise, of the sensors' own colour: what is
    missing has coloured the residuals, and under their colour it would look like noise.
    """
    weighing = Weighing(of_views, rules)
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
        folds[cell] = tuple(_folds(cell[1], len(w), r.shape[1], 1 if len(records) > 1 else PARTS))
    return Base(fit, weighing, roots, white, columns, folds)


def _folds(record: str, rows: int, signals: int, parts: int) -> Iterable[tuple[str, slice]]:
    """Rows of a cell by fold; its signals lie one behind the other."""
    each = rows // signals
    ends = np.linspace(0, each, parts + 1).astype(int)
    for s in range(signals):
        for k in range(parts):
            name = record if parts == 1 else f"{record}, part {k + 1}"
            yield name, slice(s * each + int(ends[k]), s * each + int(ends[k + 1]))


@dataclass(frozen=True, eq=False)
class Estimate:
    """Coefficients of a term, what they are worth, and their covariance."""

    coefficients: Array
    covariance: Array
    cost: float  # -2 log evidence


@dataclass(frozen=True, eq=False)
class Products:
    """Of columns with themselves (n, n), with the fit's (coordinates, n) and with the residuals."""

    square: Array
    cross: Array
    pull: Array

    def __add__(self, other: Products) -> Products:
        return Products(
            self.square + other.square, self.cross + other.cross, self.pull + other.pull
        )

    def times(self, factor: float) -> Products:
        """Of columns so many times as large."""
        return Products(factor**2 * self.square, factor * self.cross, factor * self.pull)


@dataclass(frozen=True, eq=False)
class Reduced:
    """Normal equations of a term's coefficients, the fit's coordinates eliminated; cost: without
    the term.
    """

    square: Array
    pull: Array
    cost: float

    def solved(self, prior: Array) -> Estimate:
        """Least squares under a prior; prior: precision of the coefficients (n, n)."""
        factor = _factor(self.square, prior)
        half = np.linalg.solve(factor, self.pull)
        inverse = np.linalg.solve(factor, np.eye(len(half)))
        occam = 2 * float(np.log(np.diag(factor)).sum()) - float(np.linalg.slogdet(prior)[1])
        covariance = inverse.T @ inverse
        return Estimate(inverse.T @ half, covariance, self.cost - float(half @ half) + occam)


def _factor(square: Array, prior: Array) -> Array:
    """Cholesky's factor of a square (n, n) and a prior. Where two large products have left a square
    that is none by their rounding, whatever it says no more of counts as much as that error.
    """
    try:
        return np.asarray(np.linalg.cholesky(square + prior))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh((square + square.T) / 2)
        lifted = (vectors * np.maximum(values, abs(values[0]))) @ vectors.T
        return np.asarray(np.linalg.cholesky(lifted + prior))


@dataclass(frozen=True, eq=False)
class Response:
    """What residuals reply to each block of rows of an addend, whitened: its products with itself,
    with the fit's columns and with the residuals by cell and fold. Any term of the addend is then a
    product of small matrices.
    """

    base: Base
    replies: Mapping[Cell, Reply]
    products: Mapping[Cell, Mapping[str, Products]]
    factor: float = 1.0  # by which replies and products are to be multiplied

    @property
    def bare(self) -> Response:
        """Without its products, which are large: columns need none."""
        return replace(self, products={})

    def times(self, factor: float) -> Response:
        """Of an addend that does so many times as much."""
        return replace(self, factor=factor * self.factor)

    def shapes(self, cell: Cell, series: Mapping[str, Array]) -> Array:
        """Means (blocks, n) of series by record, (rows, n) or (rows,)."""
        return means(series[cell[1]], self.replies[cell].block)

    def columns(self, series: Mapping[str, Array]) -> dict[Cell, Array]:
        """Whitened replies (rows of all signals, n)."""
        return {
            c: self.factor * self.base.whitened_all(c, reply.told(_rows(series[c[1]])))
            for c, reply in self.replies.items()
        }

    def over(self, cell: Cell, shapes: Array) -> dict[str, Products]:
        """Products of shapes (blocks, n) of a cell, by fold."""
        return {
            fold: Products(shapes.T @ p.square @ shapes, p.cross @ shapes, shapes.T @ p.pull)
            for fold, p in self.products[cell].items()
        }

    def at(self, cell: Cell, series: Mapping[str, Array]) -> Array:
        """Means of a series (rows,) by block, or by row where the reply is fine; the first rows,
        which have no innovation, are left out there.
        """
        reply = self.replies[cell]
        at = reply.at(series[cell[1]])[:, 0]
        return at[-self._innovations(cell) :] if reply.fine else at

    def _innovations(self, cell: Cell) -> int:
        """Innovations of each signal."""
        return len(self.base.white[cell]) // self.replies[cell].felt().shape[1]

    def says(self, cell: Cell, series: Mapping[str, Array]) -> tuple[Array, Array, Array]:
        """`at`, how much residuals feel of an addend there, and how much of it they ask for."""
        reply, at = self.replies[cell], self.at(cell, series)
        if not reply.fine:
            whole = reduce(Products.__add__, self.products[cell].values())
            return at, np.diag(whole.square), whole.pull**2
        felt = reply.felt()[-len(at) :] ** 2
        asked = self.base.white[cell].reshape(-1, len(at)).T ** 2
        return at, felt.sum(axis=1), (felt * asked).sum(axis=1)

    def pairs(self, shapes: Mapping[Cell, Array]) -> tuple[Array, Array]:
        """Of pairs of columns one behind the other (blocks, 2 n): products of each pair with itself
        (n, 2, 2) and with the residuals (n, 2), over all cells.
        """
        square: Array | float = 0.0
        pull: Array | float = 0.0
        for cell, own in self.products.items():
            s = shapes[cell]
            whole = reduce(Products.__add__, own.values())
            one, both = (x.reshape(len(s), -1, 2) for x in (s, whole.square @ s))
            square = square + np.einsum("bni,bnj->nij", one, both)
            pull = pull + (s.T @ whole.pull).reshape(-1, 2)
        return np.asarray(self.factor**2 * square), np.asarray(self.factor * pull)


def response_of(base: Base, replies: Mapping[Cell, Reply]) -> Response:
    """See `Response`."""
    products = {c: base.products(c, base.whitened_all(c, r.matrix)) for c, r in replies.items()}
    return Response(base, replies, products)


@dataclass(frozen=True, eq=False)
class _Scaled:
    """A reply so many times as large."""

    reply: Reply
    factor: float

    @property
    def matrix(self) -> Array:
        """See `Reply`."""
        return self.factor * self.reply.matrix

    @property
    def block(self) -> int:
        """See `Reply`."""
        return self.reply.block

    @property
    def fine(self) -> bool:
        """See `Reply`."""
        return self.reply.fine

    def told(self, series: Array) -> Array:
        """See `Reply`."""
        return self.factor * self.reply.told(series)

    def at(self, series: Array) -> Array:
        """See `Reply`."""
        return self.reply.at(series)

    def felt(self) -> Array:
        """See `Reply`."""
        return abs(self.factor) * self.reply.felt()


def together(responses: Sequence[Response]) -> Response:
    """Of one addend that does what several do, each in cells of its own."""
    replies: dict[Cell, Reply] = {}
    products: dict[Cell, Mapping[str, Products]] = {}
    for r in responses:
        replies |= {c: _Scaled(reply, r.factor) for c, reply in r.replies.items()}
        products |= {
            c: {fold: p.times(r.factor) for fold, p in own.items()} for c, own in r.products.items()
        }
    return Response(responses[0].base, replies, products)


@dataclass(frozen=True, eq=False)
class Trial:
    """Shapes in an addend: what is known of their coefficients, by fold."""

    base: Base
    sums: Mapping[str, Products]

    def reduced(self, left_out: str = "") -> Reduced:
        """The fit's coordinates eliminated."""
        kept = self.base.kept[left_out]
        none = next(iter(self.sums.values())).times(0.0)
        own = (p for fold, p in self.sums.items() if fold in kept.folds)
        total = reduce(Products.__add__, own, none)
        cross = np.linalg.solve(kept.factor, total.cross)
        pull = -total.pull - cross.T @ kept.pull
        return Reduced(total.square - cross.T @ cross, pull, kept.cost)

    @property
    def falls(self) -> Array:
        """By which -2 log likelihood falls with each shape by itself (n,)."""
        reduced = self.reduced()
        size = np.diag(reduced.square)
        return np.asarray(np.where(size > 0, reduced.pull**2 / np.maximum(size, 1e-300), 0.0))

    def solved(self, prior: Array, left_out: str = "") -> Estimate:
        """Joint least squares with the fit's coordinates under priors; prior: precision (n, n)."""
        return self.reduced(left_out).solved(prior)

    def best(self, priors: Sequence[Array]) -> tuple[int, Estimate]:
        """The prior of the largest evidence."""
        reduced = self.reduced()
        answers = [reduced.solved(p) for p in priors]
        index = int(np.argmin([a.cost for a in answers]))
        return index, answers[index]

    def gain(self, prior: Array) -> float:
        """Fall of -2 log density of each fold as predicted by the others."""
        return self.base.plain - self.base.predicted(lambda out: self.solved(prior, out).cost)


def trial_of(response: Response, series: Mapping[str, Array]) -> Trial:
    """Of shapes over each record (rows, n); row by row where replies are."""
    found: dict[Cell, dict[str, Products]] = {}
    for cell in response.products:
        reply = response.replies[cell]
        if reply.fine:
            columns = response.base.whitened_all(cell, reply.told(_rows(series[cell[1]])))
            found[cell] = response.base.products(cell, columns)
        else:
            found[cell] = response.over(cell, response.shapes(cell, series))
    return _trial(response, found)


def trial_over(response: Response, shapes: Mapping[Cell, Array]) -> Trial:
    """Of shapes over the blocks of each cell (blocks, n)."""
    return _trial(response, {c: response.over(c, shapes[c]) for c in response.products})


def _trial(response: Response, products: Mapping[Cell, Mapping[str, Products]]) -> Trial:
    found: dict[str, Products] = {}
    for own in products.values():
        for fold, p in own.items():
            made = p.times(response.factor)
            found[fold] = found[fold] + made if fold in found else made
    return Trial(response.base, found)


def _rows(series: Array) -> Array:
    """(rows, n)"""
    return series if series.ndim > 1 else series[:, None]
