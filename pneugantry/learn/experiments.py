"""Which further run would tell two terms apart that the logs do not: runs made of logged inputs,
simulated with both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pneugantry.engine.answer.confirm import replays, values_on
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.plant import Array, Plant, Record

__all__ = ["Rival", "TellingRun", "telling", "variants"]

REST = 2.0  # s before a delayed run
WEAKER = 0.6  # of the inputs' size
MANY = 20  # coordinates, beyond which only the effects' directions are told
SIMULATED = 4000.0  # s of records, for all runs that are compared
VARIANTS = (
    "once more",
    f"after a rest of {REST:g} s",
    "at half its speed",
    "at twice its speed",
    "with its inputs reversed",
    f"with its inputs at {100 * WEAKER:.0f} %",
)
LARGEST = 1e9  # evidence; more is as good


@dataclass(frozen=True)
class TellingRun:
    """A run that tells two terms apart."""

    what: str
    separates: tuple[str, str]  # the terms
    evidence: float  # expected -2 log evidence of the right one over the other


@dataclass(frozen=True, eq=False)
class Rival:
    """A plant with one of the terms, and its fit."""

    name: str
    plant: Plant
    fit: Fit


def telling(a: Rival, b: Rival, records: Sequence[Record], cache: Path) -> TellingRun | None:
    """The run of the largest expected evidence, whichever of both is right; None: none can be
    simulated. Runs are made of the shortest records, as long as their simulation is affordable.
    """
    best: TellingRun | None = None
    runs = sum(len(_moves(r.fit)) + 2 for r in (a, b)) * len(VARIANTS)
    left = SIMULATED
    for record in sorted(records, key=lambda r: r.rows):
        left -= runs * record.rows * record.period
        if left < 0 and best is not None:
            break
        for what, varied in variants(record).items():
            evidence = min(_evidence(a, b, varied, cache), _evidence(b, a, varied, cache))
            if best is None or evidence > best.evidence:
                best = TellingRun(f"{record.name} {what}", (a.name, b.name), evidence)
    return best if best is not None and best.evidence > 0 else None


def variants(record: Record) -> dict[str, Record]:
    """Runs made of a logged one, by what is done to its inputs; they hold over rows then. Those
    that never change their sign (a switch, a supply) keep their size.
    """
    signed = {n for n, u in record.inputs.items() if np.min(u) < 0 < np.max(u)}
    delay = round(REST / record.period)
    at = np.arange(record.rows, dtype=float)

    def scaled(factor: float) -> Record:
        inputs = {n: factor * u if n in signed else u for n, u in record.inputs.items()}
        return replace(record, inputs=inputs, within={})

    def read(rows: Array) -> Callable[[Array], Array]:
        return lambda values: np.interp(rows, at, np.asarray(values, dtype=float))

    later = np.concatenate([np.zeros(delay), at])
    slower, faster = read(np.arange(0, record.rows - 1, 0.5)), read(at[::2])
    made = [record, _moved(record, read(later)), _moved(record, slower), _moved(record, faster)]
    made += [scaled(-1.0), scaled(WEAKER)] if signed else []
    return dict(zip(VARIANTS, made, strict=False))  # the last two: of inputs with a sign


def _moved(record: Record, read: Callable[[Array], Array]) -> Record:
    inputs = {n: read(u) for n, u in record.inputs.items()}
    signals = {n: read(y) for n, y in record.signals.items()}
    return replace(record, inputs=inputs, signals=signals, judged=None, within={})


def _moves(fit: Fit) -> Array:
    """Directions (n, coordinates) in which a fit leaves its values open, one standard deviation
    each; of many coordinates those of its effects, along which the others move.
    """
    own = [i for i, c in enumerate(fit.point.coordinates) if c.effect]
    if len(fit.covariance) <= MANY or not own:
        level, vectors = np.linalg.eigh(fit.covariance)
        return np.asarray((vectors * np.sqrt(np.maximum(level, 0.0))).T)
    among, vectors = np.linalg.eigh(fit.covariance[np.ix_(own, own)])
    scale = vectors / np.sqrt(np.maximum(among, 1e-12 * among.max()))
    return np.asarray((fit.covariance[:, own] @ scale).T)


def _evidence(right: Rival, wrong: Rival, record: Record, cache: Path) -> float:
    """Expected -2 log evidence against `wrong` where the other is right: its distance, but for what
    its own fit leaves open, in the sensors' noise.
    """
    true = replays(right.plant, record, [values_on(right.fit, record)], cache)[0]
    point, fit = wrong.fit.point, wrong.fit
    own = [values_on(fit, record)]
    own += [
        values_on(replace(fit, point=point.moved(point.theta + m)), record) for m in _moves(fit)
    ]
    told = replays(wrong.plant, record, own, cache)
    if true is None or told[0] is None:
        return 0.0
    base, sigma = told[0].simulated, true.sigma
    apart = ((true.simulated - base) / sigma).ravel()
    columns = [((t.simulated - base) / sigma).ravel() for t in told[1:] if t is not None]
    c = np.array(columns).reshape(len(columns), apart.size).T
    pull = c.T @ apart
    left = float(apart @ apart - pull @ np.linalg.solve(np.eye(c.shape[1]) + c.T @ c, pull))
    return min(max(left, 0.0), LARGEST) if np.isfinite(left) else 0.0
