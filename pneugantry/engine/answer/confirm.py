"""How far a gap shrinks: the whole plant driven by a record's inputs alone, beside its readings.

No fit has seen the record that is replayed. A replay can part from it for good at one missed event
(a break-away), though every part of the plant is right: where it does so, and how much the gap
depends on that, stands beside the gap.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from modelica_fmu.batch import Subsystem
from modelica_fmu.errors import RunError
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.noise import NOISIEST
from pneugantry.engine.hypotheses.hypothesis import Coordinate
from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.signals.commands import drives_of
from pneugantry.engine.signals.sensors import PREFIX, leaks, sensed
from pneugantry.engine.threads import THREADS, on_threads
from pneugantry.engine.views.foreign import ForeignPlant, foreign_signals
from pneugantry.engine.views.model_parts import longest_step, part_of

__all__ = [
    "Gap",
    "Replay",
    "draws",
    "floor_of",
    "gap_of",
    "noise_levels",
    "replay",
    "replays",
    "shrink_of",
    "values_on",
]

Values = Mapping[str, float]
BOOTSTRAPS = 400
NOTHING = 0.05  # mean square beyond the floor's, below which there is no gap to shrink
PARTED = 10.0  # times the misfit so far by which a stretch and all later ones have parted
DRAWS = 13  # replays under values drawn from what a fit leaves open; with three more, full lanes
LEAKS = 6  # rounds until readings that leak into each other agree


@dataclass(frozen=True, eq=False)
class Replay:
    """A record beside its simulation."""

    record: str
    signals: tuple[str, ...]
    simulated: Array  # (rows, signals) readings without noise, in the signals' units
    residuals: Array  # (rows, signals) measured - simulated, in quoted sigma; NaN: does not count
    measured: Array  # (rows, signals), in the signals' units
    sigma: Array  # (signals,) quoted noise, in the signals' units
    period: float  # s, between rows

    @property
    def squares(self) -> Array:
        """Mean squares (rows that count,) over the signals."""
        rows = ~np.isnan(self.residuals).any(axis=1)
        return np.asarray((self.residuals[rows] ** 2).mean(axis=1))

    @property
    def gap(self) -> float:
        """RMS over signals and time."""
        return float(np.sqrt(self.squares.mean()))

    def until(self, end: float | None) -> Replay:
        """What of it lies before a time in s; None: all."""
        if end is None:
            return self
        rows = slice(round(end / self.period))
        cut = (v[rows] for v in (self.simulated, self.residuals, self.measured))
        simulated, residuals, measured = cut
        return replace(self, simulated=simulated, residuals=residuals, measured=measured)

    @property
    def by_signal(self) -> dict[str, float]:
        """RMS over time."""
        means = np.nanmean(self.residuals**2, axis=0)
        return {n: float(np.sqrt(m)) for n, m in zip(self.signals, means, strict=True)}


@dataclass(frozen=True)
class Gap:
    """RMS over signals and time of (measured - simulated)/sigma of one record; sigma as quoted."""

    nominal: float
    augmented: float  # under the fitted values
    floor: float  # what noise alone leaves
    shrink: float  # 1 - (augmented^2 - floor^2)/(nominal^2 - floor^2)
    ci95: tuple[float, float]  # of the shrink, from a bootstrap over stretches
    record: str
    by_signal: Mapping[str, tuple[float, float]]  # nominal, augmented
    spread: tuple[float, float] | None = None  # augmented gap: 5 % and 95 % of the draws
    parted: float | None = None  # s, from where on the augmented replay has left the record
    open: float = 0.0  # RMS distance of the draws' replays from the augmented one, as the gaps
    early: Gap | None = None  # of the record up to there
    leaving: float = 0.0  # share of the draws' replays that leave the record for good, too

    @property
    def bifurcates(self) -> bool:
        """Whether values that the fit does not tell apart replay the record quite differently."""
        return self.spread is not None and self.spread[1] > 2 * max(self.spread[0], self.floor)


def replay(plant: Plant, record: Record, values: Values, cache: Path) -> Replay:
    """One record under one set of values: see `replays`. Raises RunError where the model stops."""
    found = replays(plant, record, [values], cache)[0]
    if found is None:
        raise RunError(f"{record.name}: the model stops under these values")
    return found


def replays(
    plant: Plant, record: Record, values: Sequence[Values], cache: Path
) -> list[Replay | None]:
    """The whole plant driven by the record's inputs alone, its sensors' errors applied, under each
    set of values; None where the model stops. Values that are none of the model's (a controller's)
    change nothing.
    """
    names, true = _simulated(plant, record, values, cache)
    return [
        _beside(plant, record, names, given, true[i]) if np.isfinite(true[i]).all() else None
        for i, given in enumerate(values)
    ]


def _simulated(
    plant: Plant, record: Record, values: Sequence[Values], cache: Path
) -> tuple[tuple[str, ...], Array]:
    """Signals of a record, and what the whole plant makes of them (len(values), rows, signals)."""
    if isinstance(plant, ForeignPlant):
        return foreign_signals(plant, record, values)
    signals = [s for s in plant.signals if s.name in record.signals]
    outputs = list(dict.fromkeys(s.variable for s in signals))
    part = part_of(plant, outputs, (), cache)
    known = {v.name: v.start or 0.0 for v in part.variables if v.kind == "parameter"}
    base = {"solver.max_step": longest_step(record.period), **plant.settings}
    base |= {**plant.parameters, **record.parameters}
    own = [{k: v for k, v in {**base, **given}.items() if k in known} for given in values]
    names = sorted({n for given in own for n in given})
    table = np.array([[given.get(n, known[n]) for n in names] for given in own])
    drives, which = drives_of(record, {n: n for n in part.of("input")}, values)
    subsystem = Subsystem(part, often=False)

    def run(rows: NDArray[np.int_]) -> list[Array]:
        own = [which[i] for i in rows]
        return subsystem.runs(names, table[rows], drives, outputs, record.period, own)

    parts = on_threads(run, np.array_split(np.arange(len(table)), min(THREADS, len(table))))
    true = np.stack([found for part in parts for found in part])
    columns = [outputs.index(s.variable) for s in signals]
    return tuple(s.name for s in signals), true[:, :, columns]


def _beside(
    plant: Plant, record: Record, names: tuple[str, ...], values: Values, true: Array
) -> Replay:
    quoted = {s.name: s.sigma for s in plant.signals}
    sigma = np.array([quoted[n] for n in names])
    simulated = _readings(names, true, record, values)
    measured = np.column_stack([record.signals[n] for n in names])
    residuals = (measured - simulated) / sigma
    residuals[: record.first] = np.nan
    return Replay(record.name, names, simulated, residuals, measured, sigma, record.period)


def _readings(names: Sequence[str], true: Array, record: Record, values: Values) -> Array:
    """What sensors with errors, but no noise, say of true signals (rows, signals). What leaks in is
    another simulated reading, not a measured one.
    """
    errors = {k: v for k, v in values.items() if k.startswith(PREFIX)}
    leaking = any(leaks(k) and v for k, v in errors.items())
    said = true
    for _ in range(LEAKS if leaking else 1):
        heard = dict(zip(names, said.T, strict=True))
        said = np.column_stack(
            [sensed(n, true[:, i], _hearing(record, n, heard), errors) for i, n in enumerate(names)]
        )
    return said


def _hearing(record: Record, own: str, heard: Mapping[str, Array]) -> Record:
    """The record with other signals as simulated: its own still tells the sensor's range."""
    return replace(record, signals={**record.signals, **heard, own: record.signals[own]})


def gap_of(
    nominal: Replay,
    augmented: Replay,
    rules: Rules,
    period: float,
    *,
    floor: float = 1.0,
    others: Sequence[Replay | None] = (),
) -> Gap:
    """The gap before and after. period: s, between rows. floor: RMS over signals of the noise in
    units of the quoted one (`noise_levels`). others: the record under `draws` of the values.
    """
    length = rules.stretch(period, len(nominal.squares))
    found = _gap_of(nominal, augmented, length, period, floor, others)
    if found.parted is None:
        return found
    first, second, *rest = (r and r.until(found.parted) for r in (nominal, augmented, *others))
    assert first is not None
    assert second is not None
    early = _gap_of(first, second, length, period, floor, rest)
    return replace(found, early=replace(early, parted=None))


def _gap_of(
    nominal: Replay,
    augmented: Replay,
    length: int,
    period: float,
    floor: float,
    others: Sequence[Replay | None],
) -> Gap:
    """length: rows that are drawn together."""
    before, after = nominal.squares, augmented.squares
    told = [r.gap for r in others if r is not None]
    ends = np.quantile(told, (0.05, 0.95)) if told else None
    start = int(np.isnan(augmented.residuals).any(axis=1).sum())
    at = _parted(after, length, floor)
    by = nominal.by_signal, augmented.by_signal
    return Gap(
        nominal.gap,
        augmented.gap,
        floor,
        shrink_of(nominal.gap, augmented.gap, floor),
        _interval(before, after, length, floor),
        augmented.record,
        {n: (by[0][n], by[1][n]) for n in augmented.signals},
        None if ends is None else (float(ends[0]), float(ends[1])),
        None if at is None else (start + at) * period,
        _apart(augmented, [r for r in others if r is not None]),
        leaving=_leaving([r for r in others if r is not None], length, floor),
    )


def _leaving(others: Sequence[Replay], length: int, floor: float) -> float:
    """Share of replays that leave their record for good."""
    gone = [_parted(r.squares, length, floor) is not None for r in others]
    return sum(gone) / len(gone) if gone else 0.0


def _apart(augmented: Replay, others: Sequence[Replay]) -> float:
    """RMS distance of replays of one record from another one of it, in quoted noise."""
    squares = [
        float(np.nanmean(((r.simulated - augmented.simulated) / augmented.sigma) ** 2))
        for r in others
    ]
    return float(np.sqrt(np.mean(squares))) if squares else 0.0


def shrink_of(nominal: float, augmented: float, floor: float) -> float:
    """Share of a gap (RMS) that is gone, of squares beyond the floor's; 0 where there is none."""
    gap, left = nominal**2 - floor**2, augmented**2 - floor**2
    return 0.0 if gap < NOTHING else 1.0 - max(left, 0.0) / gap


def _interval(before: Array, after: Array, length: int, floor: float) -> tuple[float, float]:
    """95 % interval of the shrink: stretches are drawn anew, both replays of a stretch together."""
    n = max(len(before) // length, 1)
    a, b = (v[: n * (len(v) // n)].reshape(n, -1).mean(axis=1) for v in (before, after))
    picks = np.random.default_rng(0).integers(0, n, (BOOTSTRAPS, n))
    squares = ((a[p].mean(), b[p].mean()) for p in picks)
    found = [shrink_of(math.sqrt(m), math.sqrt(n), floor) for m, n in squares]
    low, high = np.quantile(found, (0.025, 0.975))
    return float(low), float(high)


def _parted(squares: Array, length: int, floor: float) -> int | None:
    """Row from which on every stretch is far beyond all before it; None: no such row."""
    n = len(squares) // length
    if n < 3:
        return None
    stretch = squares[: n * length].reshape(n, length).mean(axis=1)
    for k in range(1, n):
        usual = max(float(stretch[:k].max()), floor**2)
        if stretch[k:].min() > PARTED * usual:
            return k * length
    return None


def noise_levels(plant: Plant, record: Record, rules: Rules) -> dict[str, float]:
    """Size of each sensor's white noise in units of the quoted one: of fourth differences, which
    hardly show the motion, in the middle one of all stretches. Not less than a sensor may have, nor
    more than noise can be; with what even a right model leaves.
    """
    length = max(16, rules.stretch(record.period, record.rows))
    found = {}
    for s in plant.signals:
        if s.name not in record.signals or s.sigma <= 0:
            continue
        fourth = np.diff(record.signals[s.name], 4) / np.sqrt(70.0)
        parts = np.array_split(fourth, max(1, len(fourth) // length))
        sizes = [np.sqrt(np.mean(p**2)) / s.sigma for p in parts]
        level = float(np.median(sizes))
        level = min(max(level, rules.quietest), NOISIEST)
        found[s.name] = float(np.hypot(level, s.error / s.sigma))
    return found


def floor_of(levels: Mapping[str, float]) -> float:
    """RMS over the signals."""
    return float(np.sqrt(np.mean([v**2 for v in levels.values()]))) if levels else 1.0


def values_on(fit: Fit, record: Record) -> dict[str, float]:
    """A fit's values on a record that it may not have seen.

    What belongs to one record alone is taken from the fitted ones as far as they agree: their mean
    error, drawn towards none by how much they scatter; but for what has been read from it.
    """
    values = {n: v for n, v in fit.values(record.name).items() if n not in record.told}
    own: dict[str, list[tuple[float, float]]] = {}  # parameter -> errors, prior spreads
    given = record.parameters.keys() - record.told - values.keys()
    for c, theta in zip(fit.point.coordinates, fit.point.theta, strict=True):
        if c.record is not None and c.parameter in given:
            error = c.value(theta) - c.centre
            own.setdefault(c.parameter, []).append((error, c.unit * c.spread))
    for parameter, found in own.items():
        errors = np.array([e for e, _ in found])
        prior = float(np.mean([s for _, s in found])) ** 2
        scatter = float(errors.var(ddof=1)) if len(errors) > 1 else prior
        share = prior / (prior + scatter / len(errors))
        values[parameter] = record.parameters[parameter] + share * float(errors.mean())
    return record.read(values)


def draws(
    fit: Fit, record: Record, unseen: Sequence[Coordinate], count: int = DRAWS
) -> list[dict[str, float]]:
    """Values on a record as the fit leaves them open: draws from its normal distribution. unseen:
    coordinates that no fitted record shows, drawn from their priors.
    """
    size = len(fit.point.theta)
    normal = np.random.default_rng(0).standard_normal((count, size + len(unseen)))
    level, vectors = np.linalg.eigh(fit.covariance)
    moves = normal[:, :size] @ (vectors * np.sqrt(np.maximum(level, 0.0))).T
    found = []
    for move, own in zip(moves, normal[:, size:], strict=True):
        moved = replace(fit, point=fit.point.moved(fit.point.theta + move))
        free = {c.parameter: c.value(float(z) * c.spread) for c, z in zip(unseen, own, strict=True)}
        found.append({**free, **values_on(moved, record)})
    return found
