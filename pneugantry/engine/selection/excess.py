"""What a fit leaves beyond the sensors' noise.

The quoted noise of every sensor that a view reads, brought through the view, has a size and a
colour of its own. Whitened by that colour, the residuals of a sound rig all have about one size:
how much noisier its sensors are than quoted. A view that stands out from the others holds something
that the model lacks.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.fitting.noise import (
    LARGEST_DRAW,
    LONGEST,
    MUCH,
    Whitener,
    drifting,
    level_of,
    spread,
    usual_size,
)
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.threads import on_threads
from pneugantry.engine.views.simulation import Cell
from pneugantry.engine.views.synthetic import changes_of

__all__ = ["Channel", "Excess", "Floors", "excess_of", "floors_of", "unexplained"]

Channel = tuple[str, str]  # view, signal
Floors = dict[tuple[Channel, str], Whitener]  # by channel and record
DRAWS = 3
EVENT = 3.0  # times the spread of its stretch beyond which a residual counts no further: a mistimed
# event is over before half of a stretch is
LARGEST = 10.0  # noise levels beyond which a stretch counts no further
# The same where an error is quoted, of the model or of a coarse converter: its RMS is one over all
# stretches, and most of it may lie in a few.
UNEVEN = 3.0


@dataclass(frozen=True)
class Excess:
    """Sizes of residuals in units of the quoted noise, brought through each view."""

    level: float  # of the rig: how much noisier its sensors are than quoted
    bulk: Mapping[Channel, float]  # of most rows
    whole: Mapping[Channel, float]  # RMS over stretches of the size of most of their rows
    by_record: Mapping[tuple[Channel, str], float]  # the same
    # share of the quoted noise that coarse converters have
    converter_shares: Mapping[Channel, float] = field(default_factory=dict)

    def usual(self, channel: Channel) -> float:
        """Size of a channel that holds nothing but noise."""
        return usual_size(self.level, self.converter_shares.get(channel, 0.0))

    def ratio(self, channel: Channel) -> float:
        """How far a channel stands out: 1 where it holds nothing but noise."""
        return self.whole[channel] / self.usual(channel)


def unexplained(fitter: Fitter, fit: Fit) -> list[str]:
    """Views in which a fit leaves what would be called unknown, were it all: what stands out as the
    excess of an answer does, or stays down only because the fit has bent a parameter so far.
    """
    return list(fitter.stands_out.of(fit, lambda: _unexplained(fitter, fit)))


def _unexplained(fitter: Fitter, fit: Fit) -> list[str]:
    loud, bent = fitter.loud(fit), fitter.bent(fit)
    others = [v for v in loud if v not in bent]
    if not others:
        return loud
    left = excess_of(fitter, fit, floors_of(fitter, fit, others), fitter.noise.level)
    out = {c[0] for c in left.whole if left.ratio(c) > fitter.rules.unexplained}
    return [v for v in loud if v in bent or v in out]


def floors_of(fitter: Fitter, fit: Fit, views: Collection[str] | None = None) -> Floors:
    """Colour and size of the quoted noise in each view and record; views: in these alone."""
    cells = [c for c in fitter.simulation.cells if views is None or c[0] in views]

    def drawn(record: str) -> list[Record]:
        return [fitter.noise.noisier(record, f", draw {k}") for k in range(DRAWS)]

    made = on_threads(lambda c: _floors_in(fitter, fit, c, drawn(c[1])), cells)
    return {key: floor for own in made for key, floor in own.items()}


def _floors_in(fitter: Fitter, fit: Fit, cell: Cell, others: Sequence[Record]) -> Floors:
    """Of one cell, from the record with other draws of noise."""
    name, record = cell
    view, read = fitter.simulation.views[name], fitter.simulation.records[record]
    signals = list(zip(view.signals, view.sigmas, strict=True))
    if not any(view.shows(other) for other in others):  # no sensor's noise reaches it
        return {((name, s), record): Whitener(np.zeros(0), sigma) for s, sigma in signals}
    changes = changes_of(view, read, others, fit.values(record))
    changes = [r for r in changes if len(r) > 4 * LONGEST]
    if not changes:
        return {}
    found: Floors = {}
    for c, (signal, sigma) in enumerate(signals):
        # an event that one more draw of noise moves is no noise
        bound = LARGEST_DRAW * max(spread([r[:, c] for r in changes]), sigma)
        clipped = [np.clip(r[:, c], -bound, bound) for r in changes]
        known = fitter.noise.erring(cell)[c]
        found[(name, signal), record] = known or drifting(clipped, sigma)
    return found


def excess_of(fitter: Fitter, fit: Fit, floors: Floors, level: float | None = None) -> Excess:
    """Sizes of what a fit leaves; cells without a floor are left out. level: the rig's, where it is
    known.
    """
    white = {
        ((view, signal), record): floors[(view, signal), record](residual[:, c])
        for (view, record), residual in fit.residuals.items()
        for c, signal in enumerate(fitter.simulation.views[view].signals)
        if ((view, signal), record) in floors
    }
    own = {ch: [w for (other, _), w in white.items() if other == ch] for ch, _ in white}
    bulk = {ch: spread(rows) for ch, rows in own.items()}
    erring, shares = _erring(fitter), _converter_shares(fitter, own)
    if level is None:
        told = [(size, shares[ch]) for ch, size in bulk.items() if ch not in erring]
        # what errs must not stand out because the others are quiet
        level = level_of(told, 1.0 if erring else fitter.rules.quietest)
    sizes: dict[tuple[Channel, str], Array] = {}
    for (channel, record), rows in white.items():
        own_sizes = _sizes(rows, fitter.noise.pieces((channel[0], record), len(rows)))
        uneven = channel in erring or shares[channel] > MUCH
        most = usual_size(level, shares[channel]) * (UNEVEN if uneven else LARGEST)
        sizes[channel, record] = np.minimum(own_sizes, most)
    return Excess(
        level,
        bulk,
        {ch: _rms(np.concatenate([s for (c, _), s in sizes.items() if c == ch])) for ch in own},
        {key: _rms(of_record) for key, of_record in sizes.items()},
        shares,
    )


def _erring(fitter: Fitter) -> set[Channel]:
    """Channels of which an error of the model is quoted: they show as much of it as they like."""
    return {
        (cell[0], signal)
        for cell in fitter.simulation.cells
        for signal, known in zip(
            fitter.simulation.views[cell[0]].signals, fitter.noise.erring(cell), strict=True
        )
        if known is not None
    }


def _converter_shares(fitter: Fitter, channels: Collection[Channel]) -> dict[Channel, float]:
    """Of each channel's quoted noise the share that coarse converters have."""
    views = fitter.simulation.views
    return {
        (view, signal): fitter.noise.share_in(view, views[view].signals.index(signal))
        for view, signal in channels
    }


def _sizes(rows: Array, stretches: int) -> Array:
    """Of each stretch the RMS of its rows, events left out: what moves only now and then stands out
    there, however long it rests in between.
    """
    parts = np.array_split(rows, stretches)
    bounds = [EVENT * spread([part]) for part in parts]
    return np.array(
        [np.sqrt(np.mean(np.clip(p, -b, b) ** 2)) for p, b in zip(parts, bounds, strict=True)]
    )


def _rms(sizes: Array) -> float:
    return float(np.sqrt(np.mean(sizes**2)))
