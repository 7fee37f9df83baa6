"""A root locus made ready to draw: branches as far as the axes go, gains to label, the limit."""

from __future__ import annotations

import numpy as np

from pneugantry.analysis.plots_linear import LocusPicture, window
from pneugantry.analysis.root_locus import RootLocus, branches, thesis_gains, with_pade

__all__ = ["locus_picture"]

GAINS = 400  # on a branch, before it is refined
SHARES = (0.3, 3.0, 10.0, 30.0)  # of the limit gain, labelled


def locus_picture(locus: RootLocus) -> LocusPicture:
    """Poles, zeros and branches of a locus, with the limit gain and a few gains marked; where no
    gain makes the continuous loop unstable, multiples of Table 4.6's.
    """
    rational = with_pade(locus.loop, locus.pade.order if locus.pade else 1)
    own = thesis_gains(locus.loop.axis)[0]
    limit = locus.limit
    base = limit.gain if limit else 10.0 * own
    gains, lines = branches(rational, 1e4 * base, GAINS)
    words = (
        f"limit gain {limit.gain:.4f} V/N at {limit.frequency:.1f} rad/s"
        if limit
        else "no gain makes the continuous loop unstable"
    )
    picture = LocusPicture(
        locus.poles,
        locus.zeros,
        lines,
        gains,
        (limit.gain, limit.frequency) if limit else None,
        tuple(share * base for share in SHARES),
        locus.loop.delay,
        words,
    )
    left, right, top = window(picture)
    inside = (lines.real > 3 * left) & (lines.real < 3 * right) & (np.abs(lines.imag) < 3 * top)
    cut = np.where(inside, lines, np.nan)
    return LocusPicture(**{**vars(picture), "branches": cut})
