"""Where the model is cut: at what is measured well enough.

A measured signal that a view takes as known brings its noise into the view. Where that outweighs
the noise of the signal that the view computes, the cut reaches further upstream instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pneugantry.engine.plant import Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.synthetic import changes_of, noisy
from pneugantry.engine.views import SubsystemView, build_views

__all__ = ["sharp_views"]

TRIED = 2  # records whose noise is drawn
CLIPPED = 20.0  # quoted noises beyond which a row counts no further


def sharp_views(
    plant: Plant, measured: Sequence[str], cache: Path, records: Sequence[Record], rules: Rules
) -> list[SubsystemView]:
    """Views of the signals, none of them much noisier than its own sensors.

    The noisiest known signal of each view that is (`Rules.coarse`) is taken as not measured there,
    and the model cut again.
    """
    coarse: dict[str, frozenset[str]] = {}
    while True:
        views = build_views(plant, measured, cache, records[0].period, rules, coarse)
        dropped = {name: worst for v in views for name, worst in _noisiest(v, records, rules)}
        if not dropped:
            return views
        for name, worst in dropped.items():
            coarse[name] = coarse.get(name, frozenset()) | {worst}


def _noisiest(
    view: SubsystemView, records: Sequence[Record], rules: Rules
) -> list[tuple[str, str]]:
    """Signals of a view, each with the known signal that is too noisy for it; none where the view's
    noise is about its sensors' own.
    """
    shown = [r for r in records if view.shows(r)][:TRIED]
    if not shown:
        return []
    shares = {n: _share(view, shown, n) for n in sorted(view.known - set(view.signals))}
    if np.sqrt(sum(s**2 for s in shares.values())) < rules.coarse:
        return []
    worst = max(shares, key=lambda n: shares[n])
    return [(signal, worst) for signal in view.signals]


def _share(view: SubsystemView, records: Sequence[Record], name: str) -> float:
    """Noise that one known signal brings, in units of the quoted noise of what the view computes;
    rows that stand out are clipped, for an event that is moved is no noise.
    """
    found = [
        np.clip(change / np.array(view.sigmas), -CLIPPED, CLIPPED).ravel()
        for record in records
        for change in changes_of(view, record, [noisy(view.plant, record, name)], {})
    ]
    return float(np.sqrt(np.mean(np.concatenate(found) ** 2))) if found else 0.0
