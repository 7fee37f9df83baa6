"""How sure the diagnosis of an own plant is: intervals of parameters and of the shrink, and effects
that the logs could not tell.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from pneugantry.diagnosis.own_bench import BLOCK, OwnBench, Trial
from pneugantry.diagnosis.own_plant import OwnLog
from pneugantry.engine.catalogue import Effect

__all__ = ["at_bounds", "intervals", "shrink", "shrink_interval", "untold"]

FELT = 3.0  # standard deviations by which an effect of usual size must show to be told
# share of an effect's signature that no other one can imitate, below which it cannot be told apart
ALIKE = 0.03


def intervals(bench: OwnBench, best: Trial) -> dict[str, tuple[float, float]]:
    """95 % intervals: the wider of the fit's own and of one that lets the noise's size vary along
    the record (blocks of rows).
    """
    coordinates, (residual, *columns) = bench.jacobian(best)
    if not coordinates:
        return {}
    jacobian = np.column_stack(columns)
    inverse = np.linalg.pinv(
        jacobian.T @ jacobian + np.diag([1 / c.spread**2 for c in coordinates])
    )
    parts = np.array_split(np.arange(len(residual)), max(1, len(residual) // BLOCK))
    pulls = np.array([jacobian[rows].T @ residual[rows] for rows in parts])
    sandwich = inverse @ (pulls.T @ pulls) @ inverse
    sigma = np.sqrt(np.maximum(np.diag(inverse), np.diag(sandwich)))
    return {
        c.name: c.interval(c.theta(best.values[c.name]), float(s))
        for c, s in zip(coordinates, sigma, strict=True)
    }


def at_bounds(best: Trial, ends: Mapping[str, tuple[float, float]]) -> list[str]:
    """Parameters of effects whose interval reaches a bound."""
    return [
        c.name
        for c in best.fit.coordinates
        if c.effect and (ends[c.name][0] <= c.low or ends[c.name][1] >= c.high)
    ]


def untold(bench: OwnBench, best: Trial, catalogue: Mapping[str, Effect]) -> list[str]:
    """Effects that these logs could not show, or not apart from what was found."""
    notes = []
    names = {e.name for e, _ in best.hypothesis.effects}
    _, (residual, *columns) = bench.jacobian(best)
    known = np.linalg.qr(np.column_stack(columns))[0] if columns else np.zeros((len(residual), 0))
    for key, effect in catalogue.items():
        if key in best.keys or not set(effect.refines) <= names:
            continue
        form = effect.forms[0]
        coordinates, (_, *moved) = bench.jacobian(
            best, best.hypothesis.plus(effect, form), chord=1.0
        )
        of_effect = {p.name for p in form.parameters}
        new = [column for c, column in zip(coordinates, moved, strict=True) if c.name in of_effect]
        column = max(new, key=lambda m: float(m @ m))
        apart = column - known @ (known.T @ column)
        felt, share = (
            math.sqrt(float(apart @ apart)),
            float(apart @ apart) / max(float(column @ column), 1e-300),
        )
        if felt < FELT:
            notes.append(
                f"{key} could not be told: of usual size it shows by {felt:.1f} standard "
                f"deviations in these logs"
            )
        elif share < ALIKE:
            notes.append(
                f"{key} can hardly be told from what was found: {100 * share:.1f} % of "
                f"its signature is its own"
            )
    return notes


def shrink_interval(
    bench: OwnBench, log: OwnLog, best: Trial, seed: int = 0
) -> tuple[float, float]:
    """95 % interval of the shrink on a log, by a bootstrap over its blocks of rows."""
    before, after = (
        np.mean(bench.residual(log, values) ** 2, axis=1) for values in ({}, best.values)
    )
    parts = np.array_split(np.arange(len(before)), max(2, len(before) // BLOCK))
    means = np.array([[before[rows].mean(), after[rows].mean()] for rows in parts])
    draws = np.random.default_rng(seed).integers(0, len(parts), (500, len(parts)))
    drawn = means[draws].mean(axis=1)
    ends = np.quantile([shrink(b, a) for b, a in drawn], [0.025, 0.975])
    return float(ends[0]), float(ends[1])


def shrink(before: float, after: float) -> float:
    """1 - (after - floor) / (before - floor), of mean squares; floor 1."""
    return 1 - (after - 1) / (before - 1) if abs(before - 1) > 1e-9 else 0.0
