"""Records that the nominal model makes: what sensors would say where nothing was measured."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from modelica_fmu.batch import Drive, Subsystem
from modelica_fmu.errors import RunError
from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.engine.views.model_parts import longest_step, part_of
from pneugantry.engine.views.view import View

__all__ = ["Nominal", "changes_of", "noisy"]


class Nominal:
    """The whole plant, driven by a record's inputs alone."""

    def __init__(self, plant: Plant, variables: Sequence[str], cache: Path) -> None:
        self.plant, self.variables = plant, tuple(variables)
        self.part = part_of(plant, self.variables, (), cache)
        self._subsystem = Subsystem(self.part, often=False)

    def run(self, record: Record) -> dict[str, Array]:
        """Variables (N,) by name. Raises RunError where the model cannot be simulated."""
        known = set(self.part.of("parameter"))
        given: dict[str, float] = {"solver.max_step": longest_step(record.period)}
        given |= {**self.plant.settings, **self.plant.parameters, **record.parameters}
        given = {k: v for k, v in given.items() if k in known}
        inputs = {n: record.driving(n) for n in self.part.of("input")}
        found = self._subsystem.run(
            list(given),
            np.array([list(given.values())]),
            Drive(inputs),
            self.variables,
            record.period,
        )[0]
        if not np.isfinite(found).all():
            row = int(np.flatnonzero(~np.isfinite(found).all(axis=1))[0])
            raise RunError(
                f"{record.name}: the nominal model stops after {row * record.period:g} s of the "
                "record's inputs"
            )
        return dict(zip(self.variables, found.T, strict=True))

    def record(self, record: Record, keep: Mapping[str, Array] | None = None) -> Record:
        """The record with all signals of the plant simulated, but those to keep."""
        found = self.run(record)
        signals = {s.name: found[s.variable] for s in self.plant.signals}
        return replace(record, signals={**signals, **(keep or {})}, judged=None)


def noisy(plant: Plant, record: Record, only: str | None = None) -> Record:
    """The record with one more draw of every sensor's quoted noise, or of one sensor's."""
    draw = np.random.default_rng(zlib.crc32(record.name.encode()))
    known = {s.name: s for s in plant.signals if only in (None, s.name)}
    signals = {}
    for n, v in sorted(record.signals.items()):
        white, step = (known[n].white, known[n].step) if n in known else (0.0, 0.0)
        more = white * draw.standard_normal(len(v))
        signals[n] = v + more
        if step:
            signals[n] += _converted(v, more, step, draw.random())
    return replace(record, name=f"{record.name}, {only or 'all'} noisier", signals=signals)


def _converted(values: Array, more: Array, step: float, moved: float) -> Array:
    """Error (N,) of a converter whose grid is moved by a share of its step. What it reads is taken
    to pass from cell to cell evenly, with more noise (N,): at rest its error lasts, no average
    makes it smaller, and noise that reaches no other cell is not read.
    """
    at = np.flatnonzero(np.diff(values))
    true = values
    if len(at):
        true = np.interp(np.arange(len(values)), at + 0.5, 0.5 * (values[at] + values[at + 1]))
    true = true + more
    return np.asarray(step * (np.round(true / step + moved) - moved) - true)


def changes_of(
    view: View, record: Record, others: Sequence[Record], values: Mapping[str, float]
) -> list[Array]:
    """What other readings of a record change in a view's residual, (rows, signals) each; those that
    the view does not show or cannot simulate are left out.
    """
    shown = [other for other in others if view.shows(other)]
    if not shown:
        return []
    quiet, *made = view.residuals([(r, values) for r in (record, *shown)])
    return [other - quiet for other in made if np.isfinite(other - quiet).all()]
