"""Which further run would tell two terms apart that the logs do not: runs made of logged inputs,
simulated with both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pneugantry.engine.confirm import replays, values_on
from pneugantry.engine.fitter import Fit
from pneugantry.engine.plant import Array, Plant, Record

__all__ = ["Experiment", "Rival", "telling", "variants"]

REST = 2.0  # s before a delayed run
WEAKER = 0.6  # of the inputs' size
LARGEST = 1e9  # evidence; more is as good


@dataclass(frozen=True)
class Experiment:
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


def telling(a: Rival, b: Rival, records: Sequence[Record], cache: Path) -> Experiment | None:
    """The run of the largest expected evidence, whichever of both is right; None: none can be
    simulated.
    """
    best: Experiment | None = None
    for record in records:
        for what, varied in variants(record).items():
            evidence = min(_evidence(a, b, varied, cache), _evidence(b, a, varied, cache))
            if best is None or evidence > best.evidence:
                best = Experiment(f"{record.name} {what}", (a.name, b.name), evidence)
    return best if best is not None and best.evidence > 0 else None


def variants(record: Record) -> dict[str, Record]:
    """Runs made of a logged one, by what is done to its inputs. Those that never change their sign
    (a switch, a supply) keep their size.
    """
    signed = {n for n, u in record.inputs.items() if np.min(u) < 0 < np.max(u)}
    delay = round(REST / record.period)
    at = np.arange(record.rows, dtype=float)

    def scaled(factor: float) -> Record:
        inputs = {n: factor * u if n in signed else u for n, u in record.inputs.items()}
        return replace(record, inputs=inputs)

    def read(rows: Array) -> Callable[[Array], Array]:
        return lambda values: np.interp(rows, at, np.asarray(values, dtype=float))

    later = np.concatenate([np.zeros(delay), at])
    found = {
        "once more": record,
        f"after a rest of {REST:g} s": _moved(record, read(later)),
        "at half its speed": _moved(record, read(np.arange(0, record.rows - 1, 0.5))),
        "at twice its speed": _moved(record, read(at[::2])),
    }
    if signed:
        found["with its inputs reversed"] = scaled(-1.0)
        found[f"with its inputs at {100 * WEAKER:.0f} %"] = scaled(WEAKER)
    return found


def _moved(record: Record, read: Callable[[Array], Array]) -> Record:
    inputs = {n: read(u) for n, u in record.inputs.items()}
    signals = {n: read(y) for n, y in record.signals.items()}
    return replace(record, inputs=inputs, signals=signals, judged=None)


def _evidence(right: Rival, wrong: Rival, record: Record, cache: Path) -> float:
    """Expected -2 log evidence against `wrong` where the other is right: its distance, but for what
    its own fit leaves open, in the sensors' noise.
    """
    true = replays(right.plant, record, [values_on(right.fit, record)], cache)[0]
    point, fit = wrong.fit.point, wrong.fit
    level, vectors = np.linalg.eigh(fit.covariance)
    moves = (vectors * np.sqrt(np.maximum(level, 0.0))).T
    own = [values_on(fit, record)]
    own += [values_on(replace(fit, point=point.moved(point.theta + m)), record) for m in moves]
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
