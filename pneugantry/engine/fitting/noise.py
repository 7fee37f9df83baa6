"""Noise of residuals: Student's t with an estimated size and colour.

An event that the model mistimes makes a few large residuals. Under a normal distribution they would
decide a fit and make it rough in the parameters; under Student's t each counts a bounded amount.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pneugantry.engine.fitting.autoregression import (
    LONGEST,
    Whitener,
    drifting,
    quoted,
    whitener_of,
)
from pneugantry.engine.plant import Array

__all__ = [
    "LARGEST_DRAW",
    "LONGEST",
    "MUCH",
    "NOISIEST",
    "Noise",
    "Whitener",
    "coloured",
    "doubted",
    "drifting",
    "flat",
    "grown",
    "level_of",
    "loss",
    "pure",
    "quoted",
    "spread",
    "surely_above",
    "usual_size",
    "weights",
    "whitener_of",
]

# By view and record, one for each signal of the view. A colour of a view's own would be that of the
# records that it fits worst, and blind to a constant error in the others.
Noise = Mapping[tuple[str, str], tuple[Whitener, ...]]
LARGEST_DRAW = 6.0  # noise levels; what a draw of noise moves further is an event
CLIPPED = 5.0  # spreads beyond which a residual says nothing of the noise's colour
MUCH = 1 / 3  # share of a channel's noise from which on what its converter does is seen in it
NOISIEST = 2.0  # times its quoted noise that a sensor may have; more is no noise
NORMAL = 1.4826  # standard deviation of a normal distribution over its median absolute value
SCATTER = 1.17  # relative standard error of a spread, times the root of its rows (normal, white)


def loss(innovations: Array, freedom: float) -> Array:
    """-2 log density of each innovation, up to a constant."""
    return np.asarray((freedom + 1) * np.log1p(innovations**2 / freedom))


def weights(innovations: Array, freedom: float) -> Array:
    """Weights of the squares that have the same gradient."""
    return np.asarray((freedom + 1) / (freedom + innovations**2))


def doubted(falls: Array, doubt: float) -> float:
    """Fall of a cost over stretches, `doubt` standard errors nearer to none: what a few stretches
    carry alone is neither gain nor loss.
    """
    fall = float(falls.sum())
    sure = max(abs(fall) - doubt * float(np.sqrt(falls @ falls)), 0.0)
    return math.copysign(sure, fall)


def spread(residuals: Sequence[Array]) -> float:
    """Standard deviation of the bulk of some residuals about 0."""
    return NORMAL * float(np.median(np.abs(np.concatenate(residuals))))


def usual_size(level: float, share: float) -> float:
    """Of residuals in units of the quoted noise, where sensors are `level` times as noisy. share:
    of the quoted variance, what converters have: that is as large on any rig.
    """
    return math.sqrt((1 - share) * level**2 + share)


def level_of(sizes: Sequence[tuple[float, float]], least: float) -> float:
    """How much noisier the rig's sensors are than quoted: that of most of them. sizes: of residuals
    in units of the quoted noise, and the share of that which converters have (`usual_size`); where
    that is `MUCH` of it, it tells nothing. 1 where none tells anything.
    """
    told = [
        math.sqrt(max(size**2 - share, 0.0) / (1 - share)) for size, share in sizes if share < MUCH
    ]
    return float(np.clip(np.median(told), least, NOISIEST)) if told else 1.0


def surely_above(size: float, residuals: Sequence[Array], doubt: float) -> bool:
    """Whether the spread of white residuals is above a size by more than so many of its standard
    errors.
    """
    rows = sum(r.size for r in residuals)
    return rows > 0 and spread(residuals) > size * (1 + doubt * SCATTER / np.sqrt(rows))


def flat(residuals: Sequence[Array], sigma: float) -> Whitener:
    """White noise of the residuals' own size, at least `sigma`."""
    return Whitener(np.zeros(0), max(spread(residuals), sigma) if residuals else sigma)


def grown(whitener: Whitener, residual: Array) -> Whitener:
    """Noise of a known colour, as large as a residual's (N,) bulk has it, at least as known."""
    white = whitener(residual)
    bound = CLIPPED * max(spread([white]), 1.0)
    size = float(np.sqrt(np.mean(np.clip(white, -bound, bound) ** 2)))
    return replace(whitener, sigma=whitener.sigma * max(size, 1.0))


def coloured(
    residuals: Sequence[Array], least: float, slow: float, lasting: float = 0.0
) -> Whitener:
    """Autoregression of the bulk of the residuals; `least`: bound of its innovations' size; `slow`:
    of the noise at frequency 0; `lasting`: of its drift (see `whitener_of`).
    """
    if not residuals:
        return Whitener(np.zeros(0), least)
    return whitener_of(_bulk(residuals, least), least, slow, lasting)


def pure(residuals: Sequence[Array], least: float, jumps: bool = False) -> Whitener:
    """Autoregression of the bulk of what is noise and nothing else, with its drift. jumps: all of
    it, for a converter's error rests most of the time and jumps then.
    """
    if not residuals:
        return Whitener(np.zeros(0), least)
    return drifting(list(residuals) if jumps else _bulk(residuals, least), least)


def _bulk(residuals: Sequence[Array], least: float) -> list[Array]:
    bound = CLIPPED * max(spread(residuals), least)
    return [np.clip(r, -bound, bound) for r in residuals]
