"""Known effects as part of a learnt curve: friction that jumps where the speed changes its sign,
beside drag that nobody knows.

An effect whose action on the residuals some curve of the same variable has as well may be a part of
the curve that was learnt; what is then left of it may have a form, and neither alone has one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.plant import Array
from pneugantry.learn.curves.curve import Knots
from pneugantry.learn.screening.candidate import Candidate
from pneugantry.learn.terms.forms import Distilled, distances, doubted

__all__ = ["Composite", "composites"]

ALIKE = 0.8  # share of an effect's action that a curve must have


@dataclass(frozen=True, eq=False)
class Composite:
    """An effect with a form beside it."""

    effect: Fit  # alone
    form: Distilled
    starts: dict[str, float]  # of the effect's parameters


def composites(
    candidate: Candidate, curve: tuple[Array, Array], effects: Iterable[Fit]
) -> list[Composite]:
    """Effects and forms by their distance from a curve (coefficients and their covariance) over a
    candidate's knots, the closest first.
    """
    assert isinstance(candidate.basis, Knots)
    found: list[Composite] = []
    for fit in effects:
        names = [c.name for c in fit.point.coordinates if c.effect]
        part = _as_curves(candidate, fit, names)
        if part is None:
            continue
        for form in distances(candidate.basis, *curve, beside=part):
            pairs = zip([c for c in fit.point.coordinates if c.effect], form.beside, strict=True)
            starts = {c.parameter: c.value(share) for c, share in pairs}
            found.append(Composite(fit, form, starts))
    if not found:
        return []
    costs = doubted([c.form for c in found], len(curve[0]))
    made = [replace(c, form=replace(c.form, cost=p)) for c, p in zip(found, costs, strict=True)]
    return sorted(made, key=lambda c: c.form.cost)


def _as_curves(candidate: Candidate, fit: Fit, names: list[str]) -> Array | None:
    """Curves (coefficients, n) that change the residuals as coordinates of a fit do, as far as
    tolerance does not; None: there are none.
    """
    base, own = candidate.base, candidate.columns
    cells = [c for c in base.white if c in own]
    if not cells or not any((c, n) in fit.columns for c in cells for n in names):
        return None
    nuisances = np.concatenate([base.columns[c] for c in cells])
    curves = np.concatenate([own[c] for c in cells])
    wanted = np.column_stack(
        [
            np.concatenate(
                [
                    base.whitened(c, fit.columns[c, n])
                    if (c, n) in fit.columns
                    else np.zeros(len(base.white[c]))
                    for c in cells
                ]
            )
            for n in names
        ]
    )
    prior = candidate.basis.prior(candidate.size, candidate.bend)
    both = np.column_stack([nuisances, curves])
    square = both.T @ both + 1e-9 * np.eye(both.shape[1])
    n = nuisances.shape[1]
    square[:n, :n] += np.diag(base.precision)
    square[n:, n:] += 1e-3 * prior  # of a shape, not of a size
    found = np.linalg.solve(square, both.T @ wanted)
    plain = np.linalg.solve(square[:n, :n], nuisances.T @ wanted)
    left = float(((wanted - both @ found) ** 2).sum())
    before = float(((wanted - nuisances @ plain) ** 2).sum())
    return np.asarray(found[n:]) if before > 0 and left < (1 - ALIKE) * before else None
