"""Where the model is cut: at what is measured well enough.

A measured signal that a view takes as known brings its noise into the view, and what it does
between two rows is lost. Where either outweighs what the view's own sensors say, or what a right
model leaves of them, the cut reaches further upstream instead.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from modelica_fmu.errors import RunError
from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.build import Measured, build_views
from pneugantry.engine.views.subsystem import SubsystemView
from pneugantry.engine.views.synthetic import Nominal, changes_of, noisy

__all__ = ["sharp_views"]

TRIED = 2  # records whose noise is drawn
CLIPPED = 20.0  # quoted noises beyond which a row counts no further


def sharp_views(
    plant: Plant,
    measured: Sequence[str],
    cache: Path,
    records: Sequence[Record],
    rules: Rules,
    held: Sequence[Collection[str]] = (),
) -> list[SubsystemView]:
    """Views of the signals, none of them much noisier than its own sensors, nor wrong by more than
    is material where the nominal model itself is measured without noise.

    Of a view that is (`Rules.coarse`, `Rules.material`) the known signal that is most to blame is
    taken as not measured there, and the model cut again. held: as of `Measured`.
    """
    coarse: dict[str, frozenset[str]] = {}
    ideal = _ideal(plant, measured, cache, records)
    while True:
        known = Measured(coarse, held)
        views = build_views(plant, measured, cache, records[0].period, rules, known)
        dropped = {
            name: worst
            for view in views
            for worst in [_noisiest(view, records, rules) or _coarsest(view, ideal, rules)]
            if worst is not None
            for name in view.signals
        }
        if not dropped:
            return views
        for name, worst in dropped.items():
            coarse[name] = coarse.get(name, frozenset()) | {worst}


def _ideal(
    plant: Plant, measured: Sequence[str], cache: Path, records: Sequence[Record]
) -> list[Record]:
    """Records as the nominal model would make them, without noise; none where it cannot."""
    own = replace(plant, signals=tuple(s for s in plant.signals if s.name in measured))
    try:
        nominal = Nominal(own, [s.variable for s in own.signals], cache)
        made = [nominal.record(r) for r in records[:TRIED]]
    except RunError:
        return []
    return [replace(r, name=f"{r.name}, nominal") for r in made]


def _noisiest(view: SubsystemView, records: Sequence[Record], rules: Rules) -> str | None:
    """The known signal that is too noisy for a view; None where the view's noise is about its
    sensors' own.
    """
    shown = [r for r in records if view.shows(r)][:TRIED]
    shares = {n: _changed(view, shown, [noisy(view.plant, r, n) for r in shown]) for n in _of(view)}
    if np.sqrt(sum(s**2 for s in shares.values())) < rules.coarse:
        return None
    return max(shares, key=lambda n: shares[n])


def _coarsest(view: SubsystemView, ideal: Sequence[Record], rules: Rules) -> str | None:
    """The known signal that moves too fast for the rows it is read in; None where the view is right
    about its own model.
    """
    shown = [r for r in ideal if view.shows(r)]
    left = [r / _levels(view) for r in view.residuals([(r, {}) for r in shown])]
    if not left or _rms(left) < rules.material:
        return None
    shares = {n: _changed(view, shown, [_rarer(r, n) for r in shown]) for n in _of(view)}
    return max(shares, key=lambda n: shares[n], default=None)


def _of(view: SubsystemView) -> list[str]:
    """Signals that it takes as known."""
    return sorted(view.known - set(view.signals))


def _rarer(record: Record, name: str) -> Record:
    """The record with one signal read in every other row, and drawn straight between."""
    rows = np.arange(record.rows)
    values = np.interp(rows, rows[::2], record.signals[name][::2])
    signals = {**record.signals, name: values}
    return replace(record, name=f"{record.name}, {name} rarer", signals=signals)


def _changed(view: SubsystemView, records: Sequence[Record], others: Sequence[Record]) -> float:
    """What other readings change in a view, RMS, in units of what a right model leaves of what it
    computes; rows that stand out are clipped, for an event that is moved is no noise.
    """
    found = [
        change / _levels(view)
        for record, other in zip(records, others, strict=True)
        for change in changes_of(view, record, [other], {})
    ]
    return _rms(found) if found else 0.0


def _levels(view: SubsystemView) -> Array:
    """Quoted noise of a view's signals, with the errors of a right model."""
    errors = {s.name: s.error for s in view.plant.signals}
    return np.hypot(view.sigmas, [errors[n] for n in view.signals])


def _rms(changes: Sequence[Array]) -> float:
    clipped = [np.clip(c, -CLIPPED, CLIPPED).ravel() for c in changes]
    return float(np.sqrt(np.nanmean(np.concatenate(clipped) ** 2)))
