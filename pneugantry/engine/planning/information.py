"""What records can tell of effects before anything is fitted: Fisher information of every effect
beside the nuisances, at the nominal point.

An effect's columns are slopes of the residuals at its neutral value, per usual size (the whole
difference where settings switch it on), whitened by the noise of the sensors as it comes through
each view. Their Gram matrices, one a view and record, add
up; what nuisances can imitate within their priors is projected out (a Schur complement).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.fitting.noise import LONGEST, Whitener, drifting
from pneugantry.engine.hypotheses.catalogue import Effect, Form
from pneugantry.engine.hypotheses.hypothesis import Coordinate, effect_coordinate
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.views.simulation import Cell
from pneugantry.engine.views.synthetic import changes_of

__all__ = ["SEEN", "Information", "Sight", "Size", "gather", "score", "sights", "sizes"]

SEEN = (
    3.0  # standard deviations from which on an effect is seen, or told from another (field: usual)
)
STEP = 0.5  # prior standard deviations by which a nuisance is moved for its slope
SHARE = 0.1  # of its usual size by which an effect's parameter is moved for its slope
DRAWN = 3  # records over which the noise of a view is drawn


@dataclass(frozen=True)
class Size:
    """Usual size of an effect's first parameter."""

    parameter: str
    usual: float  # difference from the value without the effect, in `unit`
    unit: str


@dataclass(frozen=True, eq=False)
class Information:
    """Gram matrices of whitened columns. The first columns are the nuisances', in units of their
    own; those of an effect are at its usual size.
    """

    precisions: Array  # (nuisances,) 1/variance of each prior
    effects: Mapping[str, tuple[int, ...]]  # effect -> its columns
    cells: Mapping[Cell, tuple[tuple[int, ...], Array]]  # columns, Gram matrix of these
    prior: float  # spread of an effect that imitates another, in usual sizes
    failed: frozenset[str] = field(default_factory=frozenset)  # effects that no run could do

    def total(self, records: Iterable[str] | None = None) -> Array:
        """Gram matrix (columns, columns) of some records; None: all."""
        n = len(self.precisions) + sum(map(len, self.effects.values()))
        chosen = None if records is None else set(records)
        result = np.zeros((n, n))
        for (_, record), (index, gram) in self.cells.items():
            if chosen is None or record in chosen:
                result[np.ix_(index, index)] += gram
        return result


@dataclass(frozen=True)
class Sight:
    """What records tell of one effect of its usual size."""

    effect: str
    sigma: float  # standard deviations by which it stands out of noise and nuisances
    told: float  # the same after the best imitation by one other effect
    rival: str | None  # that other effect
    rivals: tuple[str, ...]  # others that it is not told from, though it is seen
    seen_by: tuple[tuple[str, str, float], ...]  # view, record, share of its signature

    @property
    def visible(self) -> bool:
        return self.sigma >= SEEN

    @property
    def smallest(self) -> float:
        """Smallest size that is seen, in usual sizes; infinite where nothing shows it."""
        return SEEN / self.sigma if self.sigma > 0 else math.inf

    @property
    def own_share(self) -> float:
        """Share of its signature that no other single effect imitates."""
        return (self.told / self.sigma) ** 2 if self.sigma > 0 else 0.0


def sights(information: Information, records: Iterable[str] | None = None) -> list[Sight]:
    """Of each effect, in order."""
    chosen = None if records is None else set(records)
    rest = _projected(information, information.total(chosen))
    left = _left(information, rest)
    return [_sight(information, left, key, chosen) for key in information.effects]


def score(found: Iterable[Sight]) -> float:
    """How many effects of usual size are told from noise, nuisances and every other one; an effect
    told at less than SEEN counts in part.
    """
    return sum(min(s.told / SEEN, 1.0) for s in found)


def _projected(information: Information, total: Array) -> Array:
    """Information about the effects' columns that nuisances leave."""
    n = len(information.precisions)
    if n == 0:
        return total
    own, cross = total[:n, :n] + np.diag(information.precisions), total[:n, n:]
    return np.asarray(total[n:, n:] - cross.T @ np.linalg.solve(own, cross))


def _sight(
    information: Information, left: Mapping[str, Mapping[str, float]], key: str, by: set[str] | None
) -> Sight:
    """left: sigma of each effect beside each other one (beside none under its own name)."""
    own = left[key]
    sigma = own[key]
    others = {k: v for k, v in own.items() if k != key and v < sigma * (1 - 1e-9)}
    rival = min(others, key=lambda k: others[k]) if others else None
    rivals = tuple(k for k, v in others.items() if v < SEEN <= sigma)
    told = others[rival] if rival is not None else sigma
    return Sight(key, sigma, told, rival, rivals, _seen_by(information, key, by))


def _left(information: Information, rest: Array) -> dict[str, dict[str, float]]:
    """Sigma of each effect when another is free within its prior, by effect and other effect."""
    n = len(information.precisions)
    at = {k: np.array(v, dtype=int) - n for k, v in information.effects.items()}
    energy = np.diag(rest)
    found: dict[str, dict[str, float]] = {k: {} for k in at}
    for other, index in at.items():
        inner = rest[np.ix_(index, index)] + np.eye(len(index)) / information.prior**2
        imitated = (rest[index] * np.linalg.solve(inner, rest[index])).sum(axis=0)
        for key, own in at.items():
            lost = 0.0 if key == other else float(imitated[own].sum())
            found[key][other] = math.sqrt(max(float(energy[own].sum()) - lost, 0.0))
    return found


def _seen_by(
    information: Information, key: str, chosen: set[str] | None
) -> tuple[tuple[str, str, float], ...]:
    """Views and records with their shares of an effect's signature, largest first."""
    columns = set(information.effects[key])
    found: dict[Cell, float] = {}
    for cell, (index, gram) in information.cells.items():
        if chosen is None or cell[1] in chosen:
            found[cell] = sum(float(gram[i, i]) for i, c in enumerate(index) if c in columns)
    total = sum(found.values())
    ranked = sorted(found.items(), key=lambda item: -item[1])
    return tuple((v, r, s / total) for (v, r), s in ranked if s > 0) if total > 0 else ()


# ---- from simulations


Values = dict[str, float]


def sizes(fitter: Fitter, effects: Mapping[str, Effect]) -> dict[str, Size]:
    """Usual size of each effect."""
    found = {}
    for key, effect in effects.items():
        parameter = effect.forms[0].parameters[0]
        c = effect_coordinate(parameter, fitter.coordinates.neutral(parameter.name), 1.0)
        usual = (
            abs(_moved(c, 1.0)[0] - c.value(0.0)) if not effect.forms[0].settings else c.value(0.0)
        )
        found[key] = Size(parameter.name, float(usual), parameter.unit)
    return found


def gather(
    fitter: Fitter,
    effects: Mapping[str, Effect],
    noisy: Callable[[Record], Record] | None = None,
) -> Information:
    """Simulates every column in every view and record of a fitter.

    noisy: a record with one more draw of its sensors' noise (None: white noise as quoted).
    """
    nuisances = [
        replace(c, spread=fitter.rules.tolerance) if c.scales else c
        for c in fitter.coordinates.nuisances()
    ]
    columns = {key: _points(fitter, e.forms[0]) for key, e in effects.items()}
    places, start = {}, len(nuisances)
    for key, points in columns.items():
        places[key] = tuple(range(start, start + len(points)))
        start += len(points)
    shared = {
        n: v for points in columns.values() for p, _ in points if len(p) == 1 for n, v in p.items()
    }
    moves = [_Move(i, *_nudged(c, shared), c.record) for i, c in enumerate(nuisances)]
    moves += [
        _Move(i, point, step, None)
        for key, points in columns.items()
        for i, (point, step) in zip(places[key], points, strict=True)
    ]
    found = _differences(fitter, _base(nuisances), moves)
    whiteners = _whiteners(fitter, noisy)
    bad = {i for index, d in found.values() for i, x in zip(index, d, strict=True) if _lost(x)}
    cells = {c: (index, _gram(d, whiteners[c[0]])) for c, (index, d) in found.items()}
    failed = frozenset(k for k, own in places.items() if bad & set(own))
    precisions = np.array([1 / c.spread**2 for c in nuisances])
    return Information(precisions, places, cells, fitter.rules.effect_prior, failed)


def _base(nuisances: Sequence[Coordinate]) -> dict[str | None, Values]:
    """Nuisance values without error, by record; None: those of all records."""
    values: dict[str | None, Values] = {}
    for c in nuisances:
        values.setdefault(c.record, {})[c.parameter] = c.value(0.0)
    return values


@dataclass(frozen=True)
class _Move:
    """A run off the nominal point, for one column."""

    column: int
    values: Values
    step: float  # in units of the column
    record: str | None  # where alone it counts


def _nudged(c: Coordinate, shared: Values) -> tuple[Values, float]:
    """A nuisance off its centre: as far as the effect that moves the same parameter, so that both
    columns are the same where the residual bends.
    """
    value = shared.get(c.parameter, c.value(STEP)) if c.record is None else c.value(STEP)
    return {c.parameter: value}, c.theta(value)


def _points(fitter: Fitter, form: Form) -> list[tuple[Values, float]]:
    """Where a form is simulated, in usual sizes off its neutral value: each parameter by itself,
    or all at once where settings switch the form on.
    """
    own = [effect_coordinate(p, fitter.coordinates.neutral(p.name), 1.0) for p in form.parameters]
    if not form.settings:
        moved = [(c.parameter, *_moved(c, SHARE)) for c in own]
        return [({name: value}, step) for name, value, step in moved]
    together = {
        c.parameter: c.value(0.0) if c.logarithmic or p.relative else _moved(c, 1.0)[0]
        for c, p in zip(own, form.parameters, strict=True)
    }
    return [({**form.settings, **together}, 1.0)]


def _moved(c: Coordinate, share: float) -> tuple[float, float]:
    """An effect's parameter at a share of its usual size, downwards where its bounds ask for it."""
    step = share if c.value(share) != c.value(0.0) else -share
    return c.value(step), step


def _differences(
    fitter: Fitter,
    base: Mapping[str | None, Values],
    moves: Sequence[_Move],
) -> dict[Cell, tuple[tuple[int, ...], list[Array]]]:
    """Columns (rows, signals) of each cell: of those parameters that its view reads."""
    jobs: dict[Cell, list[Values]] = {}
    kept: dict[Cell, list[tuple[int, float]]] = {}
    for cell in fitter.simulation.cells:
        view = fitter.simulation.views[cell[0]]
        values = {**base.get(None, {}), **base.get(cell[1], {})}
        jobs[cell], kept[cell] = [values], []
        for move in moves:
            if move.record in (None, cell[1]) and any(view.depends_on(n) for n in move.values):
                jobs[cell].append({**values, **move.values})
                kept[cell].append((move.column, move.step))
    found = fitter.simulation.run(jobs)
    return {
        cell: (
            tuple(i for i, _ in own),
            [
                (r - found[cell][0]) / step
                for r, (_, step) in zip(found[cell][1:], own, strict=True)
            ],
        )
        for cell, own in kept.items()
    }


def _lost(column: Array) -> bool:
    return not bool(np.isfinite(column).all())


def _gram(columns: Sequence[Array], whiteners: Sequence[Whitener]) -> Array:
    """Gram matrix of a cell's whitened columns; a column that could not be simulated counts as
    none.
    """
    if not columns:
        return np.zeros((0, 0))
    whole = np.vstack(
        [
            np.column_stack([whiten(np.nan_to_num(column[:, c])) for column in columns])
            for c, whiten in enumerate(whiteners)
        ]
    )
    return np.asarray(whole.T @ whole)


def _whiteners(
    fitter: Fitter, noisy: Callable[[Record], Record] | None
) -> dict[str, tuple[Whitener, ...]]:
    """Of each view and signal: white noise as quoted, or as coloured and as large as the noise of
    all the sensors that the view reads makes it. Where an error of the model is quoted, as that.
    """
    found = dict(fitter.noise.quoted())
    if noisy is None:
        return found
    base = _base(fitter.coordinates.nuisances())
    for name, view in fitter.simulation.views.items():
        own: list[Array] = []
        for cell in fitter.simulation.cells:
            if cell[0] != name or len(own) == DRAWN:
                continue
            record = fitter.simulation.records[cell[1]]
            values = {**base.get(None, {}), **base.get(cell[1], {})}
            changes = changes_of(view, record, [noisy(record)], values)
            own += [change for change in changes if len(change) > 4 * LONGEST]
        if own:
            found[name] = tuple(
                known or drifting([r[:, c] for r in own], sigma)
                for c, (sigma, known) in enumerate(
                    zip(view.sigmas, fitter.noise.erring_in(name), strict=True)
                )
            )
    return found
