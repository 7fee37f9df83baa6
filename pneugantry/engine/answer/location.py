"""Where a gap lies: which block, in which records, in which regime of the motion.

Everything is counted as -2 log likelihood. What an effect explains counts for the effect's block;
what the answer leaves above the noise counts for the block of the view that shows it. A view may
have its own nuisances first: in a joint fit one view that is wrong bends those that it shares, and
sound views misfit with it. Where each view by itself is at the noise, and all together are not,
the joint misfit counts.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pneugantry.engine.answer.regimes import regime_of
from pneugantry.engine.fitting import noise
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.fitting.noise import Whitener
from pneugantry.engine.fitting.weighing import Weighing
from pneugantry.engine.plant import Array
from pneugantry.engine.selection.search import Search
from pneugantry.engine.views.simulation import Cell
from pneugantry.engine.views.synthetic import changes_of, noisy

__all__ = ["Floor", "Place", "floor_below", "where"]

DOUBT = 1.0  # standard errors over stretches by which a view's misfit is lowered
ROUNDS = 4  # reweighted least squares of a view by itself
QUIETER = 0.25  # share of the stretches that are no worse than the quieter ones
LEVEL = 0.05  # share by which the size of the noise may be other than said
LARGE = 0.15  # share of a block's misfit from which on a record is named


@dataclass(frozen=True)
class Place:
    """One block's share of what tolerance alone does not explain."""

    block: str
    share: float  # of all blocks'; they sum to 1
    records: tuple[str, ...]  # those that hold most of it, the largest first
    regime: str  # in words
    explained: float  # fall of -2 log evidence by the answer's effects
    left: float  # -2 log likelihood that the answer leaves above the noise


@dataclass(frozen=True, eq=False)
class Floor:
    """What the sensors' noise alone makes of each view, by its name."""

    whiteners: Mapping[str, tuple[Whitener, ...]]  # one for each of its signals
    per_row: Mapping[str, Array]  # -2 log likelihood of a row, (signals,)
    quiet: Mapping[str, Array]  # the same in the quieter stretches, (signals,)


@dataclass(frozen=True)
class _Share:
    """What one cell says of a block, in -2 log likelihood."""

    block: str
    cell: Cell
    explained: float = 0.0
    left: float = 0.0

    @property
    def total(self) -> float:
        return self.explained + self.left


def where(
    fitter: Fitter,
    found: Search,
    answer: Fit,
    levels: Mapping[str, float] | None = None,
    unknown: float = 1.0,
) -> tuple[Place, ...]:
    """Blocks by their share, the largest first; none where nothing stands out of the noise.

    answer: the fit whose effects are claimed; `found.null` where none is, so that all that
    tolerance leaves counts for the views that show it. levels: as for `floor_below`. unknown:
    probability that what is left has a cause at all, by which it counts.
    """
    floor = floor_below(fitter, answer, levels)
    left = [replace(s, left=unknown * s.left) for s in _left(fitter, answer, floor)]
    shares = [*_explained(fitter, found, answer), *left]
    whole = max(sum(s.total for s in shares), 1e-300)
    blocks = dict.fromkeys(s.block for s in shares)
    places = []
    for block in blocks:
        own = [s for s in shares if s.block == block]
        cells: dict[Cell, float] = {}
        for s in own:
            cells[s.cell] = cells.get(s.cell, 0.0) + s.total
        places.append(
            Place(
                block,
                sum(cells.values()) / whole,
                _records(cells),
                _regime(fitter, found.null, floor, cells),
                sum(s.explained for s in own),
                sum(s.left for s in own),
            )
        )
    return tuple(sorted(places, key=lambda p: -p.share))


def floor_below(fitter: Fitter, fit: Fit, levels: Mapping[str, float] | None = None) -> Floor:
    """One more draw of every sensor's noise, brought through each view at a fit's values.

    levels: noise by signal, in units of the quoted one (1 where not given).
    """
    rules, sim, drawn = fitter.rules, fitter.simulation, _drawn(fitter, fit, levels or {})
    whiteners: dict[str, tuple[Whitener, ...]] = {}
    per_row: dict[str, Array] = {}
    quiet: dict[str, Array] = {}
    for name, view in sim.views.items():
        own = {cell: r for cell, r in drawn.items() if cell[0] == name}
        whiteners[name] = tuple(
            known or noise.pure([r[:, c] for r in own.values()], rules.quietest * sigma)
            for c, (sigma, known) in enumerate(
                zip(view.sigmas, fitter.noise.erring_in(name), strict=True)
            )
        )
        terms = {cell: _terms(r, whiteners[name], rules.tails) for cell, r in own.items()}
        if terms:
            per_row[name] = np.concatenate(list(terms.values())).mean(axis=0)
            means = [_means(x, fitter.noise.pieces(c, len(x))) for c, x in terms.items()]
            quiet[name] = np.quantile(np.concatenate(means), QUIETER, axis=0)
        else:  # what normal noise of the quoted size costs, near enough
            per_row[name] = np.array([1.0 + 2 * math.log(w.sigma) for w in whiteners[name]])
            quiet[name] = per_row[name]
    return Floor(whiteners, per_row, quiet)


def _drawn(fitter: Fitter, fit: Fit, levels: Mapping[str, float]) -> dict[Cell, Array]:
    """Noise (rows, signals) of each cell."""
    sim, plant = fitter.simulation, fitter.plant
    louder = [replace(s, sigma=s.sigma * levels.get(s.name, 1.0)) for s in plant.signals]
    plant = replace(plant, signals=tuple(louder))
    drawn: dict[Cell, Array] = {}
    for cell in sim.cells:
        view, record = sim.views[cell[0]], sim.records[cell[1]]
        for change in changes_of(view, record, [noisy(plant, record)], fit.values(record.name)):
            drawn[cell] = change + _errors(fitter, cell, len(change))
    return drawn


def _errors(fitter: Fitter, cell: Cell, rows: int) -> Array:
    """One draw (rows, signals) of what a right model is quoted to leave, sensors' noise in it."""
    draw = np.random.default_rng(zlib.crc32("".join(cell).encode()))
    return np.column_stack(
        [
            np.zeros(rows) if w is None else w.drawn(draw.standard_normal(rows))
            for w in fitter.noise.erring(cell)
        ]
    )


def _means(terms: Array, stretches: int) -> Array:
    """(stretches, signals) means of terms (rows, signals)."""
    return np.array([part.mean(axis=0) for part in np.array_split(terms, stretches)])


def _terms(residual: Array, of_view: Sequence[Whitener], freedom: float) -> Array:
    """-2 log likelihood (rows, signals) of a cell."""
    return np.column_stack(
        [
            noise.loss(w(residual[:, c]), freedom) + 2 * math.log(w.sigma)
            for c, w in enumerate(of_view)
        ]
    )


def _explained(fitter: Fitter, found: Search, answer: Fit) -> list[_Share]:
    """What each effect explains beside the others, in the cells where the likelihood rises."""
    sim, shares = fitter.simulation, []
    for effect, form in answer.hypothesis.effects:
        rest = set(answer.keys) - {effect.key}
        without = [f.evidence for f in (*found.tried, found.null) if set(f.keys) == rest]
        base = min(without, default=found.null.evidence)
        gain = max(base - answer.evidence, 0.0)
        names = {*form.settings, *(p.name for p in form.parameters)}
        cells = [c for c in sim.cells if any(sim.views[c[0]].depends_on(n) for n in names)]
        fall = {
            c: max(float(found.null.stretches[c].sum() - answer.stretches[c].sum()), 0.0)
            for c in cells
        }
        total = sum(fall.values())
        for c in cells:
            part = fall[c] / total if total > 0 else 1 / len(cells)
            shares.append(_Share(effect.block, c, explained=gain * part))
    return shares


def _left(fitter: Fitter, answer: Fit, floor: Floor) -> list[_Share]:
    """What views have left above the noise, each with nuisances of its own; all together, where
    no view by itself has anything left.
    """
    joint = answer.residuals
    own = {c: r for name in fitter.simulation.views for c, r in alone(fitter, answer, name).items()}
    for residuals in (own, joint):
        shares = [
            share
            for name in fitter.simulation.views
            for share in _left_in(
                fitter, {c: r for c, r in residuals.items() if c[0] == name}, floor
            )
        ]
        if shares:
            return shares
    return []


def _left_in(fitter: Fitter, residuals: Mapping[Cell, Array], floor: Floor) -> list[_Share]:
    """Of one view; what a few stretches carry alone is nothing."""
    if not residuals:
        return []
    name = next(iter(residuals))[0]
    view, per_row = fitter.simulation.views[name], floor.per_row[name]
    means, lengths = {}, {}
    for cell, r in residuals.items():
        terms = _terms(r, floor.whiteners[name], fitter.rules.tails)
        means[cell] = _means(terms, fitter.noise.pieces(cell, len(terms)))
        lengths[cell] = len(terms) / len(means[cell])
    quiet = np.quantile(np.concatenate(list(means.values())), QUIETER, axis=0)
    shift = np.clip(quiet - floor.quiet[name], 0.0, 2 * math.log(1 + LEVEL))
    excess = {c: (m - per_row - shift) * lengths[c] for c, m in means.items()}
    shares = []
    for block in dict.fromkeys(view.blocks):
        own = [b == block for b in view.blocks]
        shares += _sure(block, {c: e[:, own].sum(axis=1) for c, e in excess.items()})
    return shares


def _sure(block: str, excess: Mapping[Cell, Array]) -> list[_Share]:
    """Of a block, from the excess of each stretch."""
    every = np.concatenate(list(excess.values()))
    sure = float(every.sum() - DOUBT * np.sqrt(every @ every))
    rising = {c: max(float(e.sum()), 0.0) for c, e in excess.items()}
    total = sum(rising.values())
    if sure <= 0 or total <= 0:
        return []
    return [_Share(block, c, left=sure * r / total) for c, r in rising.items()]


def alone(fitter: Fitter, fit: Fit, name: str) -> dict[Cell, Array]:
    """Residuals of one view with nuisances of its own, by the columns of a fit."""
    residuals = {c: r for c, r in fit.residuals.items() if c[0] == name}
    columns = {k: c for k, c in fit.columns.items() if k[0][0] == name}
    precision = np.array([1 / c.spread**2 for c in fit.point.coordinates])
    names = [c.name for c in fit.point.coordinates]
    weighing = Weighing({c: fit.noise[c] for c in residuals}, fitter.rules)
    moved, theta = dict(residuals), fit.point.theta
    for _ in range(ROUNDS):
        point = fit.point.moved(theta)
        normal, gradient = weighing.normal(point, moved, columns)
        step = -np.linalg.solve(normal + np.diag(precision), gradient + precision * theta)
        step = np.where(np.diag(normal) > 0, step, 0.0)
        tried = {
            c: r
            + sum(
                (columns[c, n] * s for n, s in zip(names, step, strict=True) if (c, n) in columns),
                0.0,
            )
            for c, r in moved.items()
        }
        if sum(weighing.costs(tried).values()) > sum(weighing.costs(moved).values()):
            break
        moved, theta = tried, theta + step
    return moved


def _records(cells: Mapping[Cell, float]) -> tuple[str, ...]:
    by_record: dict[str, float] = {}
    for (_, record), value in cells.items():
        by_record[record] = by_record.get(record, 0.0) + value
    total = sum(by_record.values())
    ranked = sorted(by_record, key=lambda r: -by_record[r])
    return tuple(r for r in ranked if by_record[r] > LARGE * total)


def _regime(fitter: Fitter, null: Fit, floor: Floor, cells: Mapping[Cell, float]) -> str:
    """Of the rows that tolerance alone does not explain, in the view that shows most of them."""
    by_view: dict[str, float] = {}
    for (shown, _), value in cells.items():
        by_view[shown] = by_view.get(shown, 0.0) + value
    name = max(by_view, key=lambda v: by_view[v])
    view, own = fitter.simulation.views[name], floor.whiteners[name]
    chosen = [c for c in cells if c[0] == name and c[1] in _records(cells) and cells[c] > 0]
    rows, residuals = [], alone(fitter, null, name)
    for cell in chosen:
        terms = _terms(residuals[cell], own, fitter.rules.tails) - floor.per_row[name]
        rows.append((fitter.simulation.records[cell[1]], np.maximum(terms.sum(axis=1), 0.0)))
    return regime_of(fitter.plant, view, rows)
