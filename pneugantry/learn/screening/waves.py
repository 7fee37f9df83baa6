"""Periods in time of an addend that residuals ask for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pneugantry.engine.plant import Array
from pneugantry.engine.views.simulation import Cell
from pneugantry.learn.screening.linear import Response

__all__ = ["periods_of"]

MOST = 2  # periods that are tried
FINE = 8  # frequencies per resolution of the longest record
LEAST = 3.0  # periods in the longest record
RESOLVED = 2.5  # blocks of rows in a period, at least: their means hold 0.76 of such a wave
APART = 3.0  # resolutions between two periods


def periods_of(
    response: Response, times: Mapping[str, Array], factors: Mapping[str, Array] | None
) -> list[float]:
    """Periods (s) of the waves that make squares of residuals fall most, with a phase of its own in
    each record. times: of rows, s; factors: what a wave is multiplied by, by record.
    """
    blocks: dict[Cell, tuple[Array, Array]] = {}  # times of blocks of rows, and their factors
    for cell in response.replies:
        at = response.shapes(cell, times)[:, 0]
        if len(at) > 1:
            factor = np.ones(len(at)) if factors is None else response.shapes(cell, factors)[:, 0]
            blocks[cell] = at, factor
    if not blocks:
        return []
    longest = max(len(at) * (at[1] - at[0]) for at, _ in blocks.values())
    highest = min(1 / (RESOLVED * (at[1] - at[0])) for at, _ in blocks.values())
    frequencies = np.arange(LEAST / longest, highest, 1 / (FINE * longest))
    falls = np.zeros(len(frequencies))
    for record in {c[1] for c in blocks}:
        own = {c: b for c, b in blocks.items() if c[1] == record}
        falls += _falls(response, own, frequencies)
    found: list[float] = []
    while len(found) < MOST and falls.any():
        best = float(frequencies[np.argmax(falls)])
        found.append(1 / best)
        falls[np.abs(frequencies - best) < APART / longest] = 0.0
    return found


def _falls(
    response: Response, blocks: Mapping[Cell, tuple[Array, Array]], frequencies: Array
) -> Array:
    """Falls of squares in the cells of one record with a sine and a cosine of each frequency."""
    square = np.zeros((len(frequencies), 2, 2))
    pull = np.zeros((len(frequencies), 2))
    for cell, (at, factor) in blocks.items():
        for p in response.products[cell].values():
            both = factor[:, None] * p.square * factor
            square += response.factor**2 * _squares(both, at, frequencies)
            told = _spectrum(factor * p.pull, at[0], at[1] - at[0], frequencies)
            pull += response.factor * np.column_stack([told.imag, told.real])
    ridge = 1e-9 * np.trace(square, axis1=1, axis2=2) + 1e-300
    solved = np.linalg.solve(square + ridge[:, None, None] * np.eye(2), pull[..., None])
    return np.asarray((pull[..., None] * solved).sum(axis=(1, 2)))


def _squares(matrix: Array, at: Array, frequencies: Array) -> Array:
    """Of a symmetric form (n, n) over times: its values (frequencies, 2, 2) for a sine and a
    cosine. They depend on sums of times and on differences alone.
    """
    n, step = len(at), at[1] - at[0]
    k = np.arange(n)
    sums = np.bincount(np.add.outer(k, k).ravel(), matrix.ravel()).astype(float)
    apart = np.bincount((np.subtract.outer(k, k) + n - 1).ravel(), matrix.ravel()).astype(float)
    added = _spectrum(sums, 2 * at[0], step, frequencies)
    taken = _spectrum(apart, -(n - 1) * step, step, frequencies).real
    found = np.empty((len(frequencies), 2, 2))
    found[:, 0, 0], found[:, 1, 1] = (taken - added.real) / 2, (taken + added.real) / 2
    found[:, 0, 1] = found[:, 1, 0] = added.imag / 2
    return found


def _spectrum(values: Array, first: float, step: float, frequencies: Array) -> Array:
    """Sums of values times exp(2 pi i f t), t = first, first + step, ..."""
    from scipy.signal import czt  # its import is dear, for who learns

    turn = 2j * np.pi * step
    apart = frequencies[1] - frequencies[0] if len(frequencies) > 1 else 0.0
    told = czt(values, len(frequencies), np.exp(turn * apart), np.exp(-turn * frequencies[0]))
    return np.asarray(told * np.exp(2j * np.pi * first * frequencies))
