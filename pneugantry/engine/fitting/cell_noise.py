"""What noise a simulation's cells have: as the sensors' is quoted, brought through their views, and
as residuals show it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pneugantry.engine.fitting import noise
from pneugantry.engine.fitting.noise import Noise, Whitener
from pneugantry.engine.fitting.weighing import FAILED
from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.engine.recent import Recent
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.simulation import Cell, Residuals, Simulation
from pneugantry.engine.views.synthetic import changes_of, noisy

__all__ = ["CellNoise"]

KEPT = 256  # residuals of cells whose colour is kept
MORE = 3  # draws of noise beside the first where converters are coarse
DRAWN = 64  # records with one more draw of noise that are kept


class CellNoise:
    """Tells what noise the cells of one plant's views and records have. level: how much noisier the
    rig's sensors are than quoted, until a fit has told.
    """

    def __init__(self, plant: Plant, simulation: Simulation, rules: Rules, level: float) -> None:
        self.plant, self.simulation, self.rules, self.level = plant, simulation, rules, level
        self._floors: dict[Cell, tuple[Whitener, ...]] = {}
        self._shares: dict[Cell, tuple[float, ...]] = {}
        self._coarse = any(s.step for s in plant.signals)
        self._erring = {cell: self._quoted_errors(cell) for cell in simulation.cells}
        self._colours: Recent[tuple[Array, tuple[Whitener, ...]]] = Recent(KEPT)  # by array
        self._drawn: Recent[Record] = Recent(DRAWN)

    def quoted(self) -> dict[str, tuple[Whitener, ...]]:
        """White noise as the sensors are said to have, with the quoted errors of a right model."""
        return {
            name: tuple(
                known or Whitener(np.zeros(0), s)
                for s, known in zip(view.sigmas, self.erring_in(name), strict=True)
            )
            for name, view in self.simulation.views.items()
        }

    def coloured(self, residuals: Residuals) -> Noise:
        """Noise of the size and colour that residuals have: what they leave counts as noise."""
        return {cell: self.colour(cell, r) for cell, r in residuals.items()}

    def colour(self, cell: Cell, residual: Array) -> tuple[Whitener, ...]:
        """The same of one cell, by signal; found once as long as the residual is the same array."""
        key = cell, id(residual)  # of an array that is kept, so that no other has it
        return self._colours.of(key, lambda: (residual, self._colour(cell, residual)))[1]

    def _colour(self, cell: Cell, residual: Array) -> tuple[Whitener, ...]:
        """A converter's error has the colour in which it is drawn: what rests shows nothing of it,
        and a residual that an effect makes up for less than there is.
        """
        finite, found = bool(np.isfinite(residual).all()), []
        for c, sigma in enumerate(self.simulation.views[cell[0]].sigmas):
            known, own = self.erring(cell)[c], residual[:, c]
            if known is None and self.converter_share(cell)[c] > noise.MUCH:
                known = self.floor(cell)[c]
            if known is not None:
                found.append(noise.grown(known, own) if finite else known)
                continue
            least, slow = self.rules.quietest * sigma, self.rules.slowest * sigma
            lasting = self.floor(cell)[c].lasting
            found.append(noise.coloured([own] if finite else [], least, slow, lasting))
        return tuple(found)

    def floor(self, cell: Cell) -> tuple[Whitener, ...]:
        """Colour and size of the sensors' quoted noise, brought through a view once."""
        if cell not in self._floors:
            view, record = self.simulation.views[cell[0]], self.simulation.records[cell[1]]
            values: dict[str, float] = dict(record.parameters)
            # where a converter rests its error lasts: one draw tells little of it
            more = [f", draw {k}" for k in range(MORE)] if self._coarse else []
            changes = changes_of(
                view, record, [self.noisier(cell[1], d) for d in ("", *more)], values
            )
            self._floors[cell] = tuple(
                known or noise.pure([c[:, i] for c in changes], sigma, self._coarse)
                for i, (sigma, known) in enumerate(zip(view.sigmas, self.erring(cell), strict=True))
            )
        return self._floors[cell]

    def converter_share(self, cell: Cell) -> tuple[float, ...]:
        """Of each signal of a view, the share of its quoted noise (`floor`) that coarse converters
        have, its own or those of what it reads: it does not grow with the sensors' noise. All of it
        where no noise reaches the view, for that tells nothing of the sensors'.
        """
        if cell not in self._shares:
            signals = self.simulation.views[cell[0]].signals
            self._shares[cell] = self._share(cell) if self._coarse else (0.0,) * len(signals)
        return self._shares[cell]

    def _share(self, cell: Cell) -> tuple[float, ...]:
        view, record = self.simulation.views[cell[0]], self.simulation.records[cell[1]]
        alone = (replace(s, sigma=s.step / math.sqrt(12)) for s in self.plant.signals)
        errors = noisy(replace(self.plant, signals=tuple(alone)), record)
        draws = [self.noisier(cell[1]), errors]
        changes = changes_of(view, record, draws, dict(record.parameters))
        if len(changes) < len(draws):
            return (1.0,) * len(view.signals)
        floor = self.floor(cell)
        whole, own = ([_power(w(r)) for w, r in zip(floor, c.T, strict=True)] for c in changes)
        return tuple(min(o / w, 1.0) if w else 1.0 for o, w in zip(own, whole, strict=True))

    def noisier(self, record: str, draw: str = "") -> Record:
        """A record with one more draw of its sensors' quoted noise: the same whenever it is asked
        for, so that views read it once.
        """
        own = self.simulation.records[record]
        named = replace(own, name=own.name + draw)
        return self._drawn.of((record, draw), lambda: noisy(self.plant, named))

    def erring(self, cell: Cell) -> tuple[Whitener | None, ...]:
        """Of each signal of a cell's view: noise with the quoted error of a right model; None where
        none is quoted.
        """
        return self._erring[cell]

    def erring_in(self, view: str) -> tuple[Whitener | None, ...]:
        """The same in a view's first record."""
        none = (None,) * len(self.simulation.views[view].signals)
        return next((own for cell, own in self._erring.items() if cell[0] == view), none)

    def _quoted_errors(self, cell: Cell) -> tuple[Whitener | None, ...]:
        view, record = self.simulation.views[cell[0]], self.simulation.records[cell[1]]
        row = record.period * view.decimation
        signals = {s.name: s for s in self.plant.signals}
        return tuple(
            noise.quoted(sigma, own.error, own.lasting / row) if own and own.error > 0 else None
            for sigma, own in zip(view.sigmas, map(signals.get, view.signals), strict=True)
        )

    @staticmethod
    def white(residuals: Residuals, floors: Noise) -> dict[tuple[Cell, int], Array]:
        """Residuals in units of the noise that is brought through, whitened by its colour."""
        return {
            (cell, c): w(r[:, c])
            for cell, r in residuals.items()
            if np.isfinite(r).all()
            for c, w in enumerate(floors[cell])
        }

    def plain(self, residuals: Residuals) -> Noise:
        """Noise of the colour that the sensors' has behind the views, in each view of its
        residuals' own size: what is missing is no noise.
        """
        floors = {c: self.floor(c) for c in residuals}
        white, found = self.white(residuals, floors), {}
        for cell, own in floors.items():
            rows = [
                [w for (other, k), w in white.items() if (other[0], k) == (cell[0], c)]
                for c in range(len(own))
            ]
            sizes = [max(noise.spread(r), 1.0) if r else 1.0 for r in rows]  # none: it failed
            found[cell] = tuple(
                replace(w, sigma=w.sigma * size) for w, size in zip(own, sizes, strict=True)
            )
        return found

    def stretches(self, cell: Cell, residual: Array, of_view: Sequence[Whitener]) -> Array:
        """-2 log likelihood of a cell, by stretch of its record."""
        found = [np.zeros(0)]
        for c, w in enumerate(of_view):
            terms = noise.loss(w(residual[:, c]), self.rules.tails) + 2 * math.log(w.sigma)
            found.append(self.by_stretch(cell, np.nan_to_num(terms, nan=FAILED, posinf=FAILED)))
        return np.concatenate(found)

    def by_stretch(self, cell: Cell, terms: Array) -> Array:
        """Sums of a cell's terms (rows,) by stretch of its record."""
        parts = np.array_split(terms, self.pieces(cell, len(terms)))
        return np.array([p.sum() for p in parts])

    def pieces(self, cell: Cell, rows: int) -> int:
        """Stretches into which so many rows of a cell are parted: `Rules.block` long, shorter ones
        where a record lasts for few of these.
        """
        view, record = self.simulation.views[cell[0]], self.simulation.records[cell[1]]
        return max(1, rows // self.rules.stretch(record.period * view.decimation, rows))

    def loudness(self, of_views: Sequence[Residuals]) -> float:
        """How much noisier the rig's sensors are than quoted (`noise.level_of`)."""
        sizes = [
            (noise.spread([w]), self.share_in(cell[0], c))
            for residuals in of_views
            for (cell, c), w in self.white(
                residuals, {cell: self.floor(cell) for cell in residuals}
            ).items()
        ]
        return noise.level_of(sizes, self.rules.quietest)

    def share_in(self, view: str, c: int) -> float:
        """Share of a view's signal (`converter_share`) over its records."""
        own = [self.converter_share(cell)[c] for cell in self.simulation.cells if cell[0] == view]
        return float(np.mean(own))

    def usual(self, cell: Cell) -> float:
        """Of the residuals of a cell's signals, in units of the quoted noise: the largest."""
        return max(noise.usual_size(self.level, share) for share in self.converter_share(cell))


def _power(white: Array) -> float:
    """Mean square; an event that one more draw of noise moves is no noise."""
    return float(np.mean(np.clip(white, -noise.LARGEST_DRAW, noise.LARGEST_DRAW) ** 2))
