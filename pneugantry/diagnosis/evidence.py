"""What was tried, and what it is worth: misfit beyond the floor, evidence counted by the stretches
that bear it out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pneugantry.diagnosis.bench import BLOCK, FLOOR_LENGTH, FLOOR_MOST, Bench, Choice, Outcome

__all__ = [
    "QUIET",
    "Search",
    "Trial",
    "advantage",
    "borne_out",
    "excess",
    "least_left",
    "leftover",
    "misfit",
    "rough",
    "score",
    "steady_strength",
    "strength",
    "trouble",
]

Array = NDArray[np.float64]
SCATTER = 3.0  # standard deviations of the floor's sum of squares
OUTSTANDING = 0.05  # share of the stretches that may stand out by a break-away that was missed
# what a view's misfit and strained tolerance may hold together without asking for an effect
QUIET = 8.0
NEGLIGIBLE = 0.01  # share of a view's misfit that may stay without asking for a second effect
ROUGH = 1.03  # RMS over the floor from which on a fit of friction may have stuck


@dataclass
class Trial:
    """A hypothesis with its gain over tolerance alone: difference of -2 log evidence, larger is
    better.
    """

    choice: Choice
    outcome: Outcome
    gain: float = 0.0
    led: bool = False  # fitted from where a tight lead had brought it
    apart: bool = False  # a pair in views of its own each: its members' fits are its fit
    held_out: Outcome | None = None  # what it leaves on the log that no fit has seen


@dataclass
class Search:
    """All that was tried."""

    null: dict[str, Outcome]  # by view: tolerance alone
    troubled: set[str]
    singles: list[Trial] = field(default_factory=list)
    pairs: list[Trial] = field(default_factory=list)
    lengths: dict[str, float] = field(default_factory=dict)
    held_out: Outcome | None = None  # what tolerance alone leaves on the log that no fit has seen

    @property
    def plain(self) -> dict[str, float]:
        """Values under tolerance alone, of all views."""
        return {
            name: value for outcome in self.null.values() for name, value in outcome.values.items()
        }


def trouble(outcome: Outcome, view: str) -> float:
    """What is left in a view under tolerance alone: misfit, and tolerance strained beyond its size.

    An offset or a drift is no less of a misfit for being one and the same all along: it counts in
    samples of the floor.
    """
    beyond = _beyond(outcome, view, 0.0 if view in FLOOR_MOST else SCATTER)
    return (
        beyond / FLOOR_LENGTH.get(view, outcome.lengths[view])
        + outcome.fit.penalty
        - len(outcome.fit.coordinates)
    )


def leftover(bench: Bench, outcome: Outcome, view: str, null: Outcome) -> float:
    """Trouble that a hypothesis leaves in one of its views; next to nothing of a large misfit
    counts as none: forms differ a little.
    """
    of_view = [
        (c, theta)
        for c, theta in zip(outcome.fit.coordinates, outcome.fit.theta, strict=True)
        if c.name in bench.views[view].tolerance
    ]
    strain = sum((theta / c.spread) ** 2 - 1 for c, theta in of_view if not c.effect)
    floor = outcome.floor.get(view, 1.0) ** 2 * outcome.counts[view]
    negligible = outcome.squares[view] - floor < NEGLIGIBLE * (null.squares[view] - floor)
    return strain + (0.0 if negligible else misfit(outcome, view))


def misfit(outcome: Outcome, view: str) -> float:
    """Sum of squares beyond the floor and its own scatter, in independent samples."""
    return _beyond(outcome, view) / outcome.lengths[view]


def _beyond(outcome: Outcome, view: str, scatter: float = SCATTER) -> float:
    """Sum of squares beyond the floor and its own scatter, in standard deviations."""
    n = outcome.counts[view]
    if n == 0:
        return 0.0
    beyond = outcome.squares[view] / outcome.floor.get(view, 1.0) ** 2 - n
    return max(
        0.0, beyond - scatter * math.sqrt(2 * n * FLOOR_LENGTH.get(view, outcome.lengths[view]))
    )


def rough(outcome: Outcome, view: str) -> bool:
    """Whether a fit of friction may have stuck."""
    return outcome.rms(view) > ROUGH * outcome.floor.get(view, 1.0)


def least_left(found: Search, view: str) -> Outcome:
    """The outcome that leaves least of a view."""
    outcomes = [t.outcome for t in found.singles if view in t.outcome.views]
    return min([found.null[view], *outcomes], key=lambda outcome: outcome.squares[view])


def score(found: Search) -> None:
    """Gains with one correlation length per view, that of the hypothesis which leaves least."""
    lengths = {view: outcome.lengths[view] for view, outcome in found.null.items()}
    least = {view: outcome.squares[view] for view, outcome in found.null.items()}
    trials = found.singles + found.pairs
    for trial in trials:
        for view in trial.outcome.views:
            if trial.outcome.squares[view] < least[view]:
                least[view], lengths[view] = (
                    trial.outcome.squares[view],
                    trial.outcome.lengths[view],
                )
    found.lengths = lengths
    for trial in trials:
        trial.gain = sum(
            found.null[v].evidence(lengths) for v in trial.outcome.views
        ) - trial.outcome.evidence(lengths)
    found.singles.sort(key=lambda t: -t.gain)
    found.pairs.sort(key=lambda t: -t.gain)


def advantage(found: Search, better: Outcome, worse: Outcome | None) -> float:
    """Evidence of one hypothesis over another (None: tolerance alone), counted in stretches of the
    logs that agree on it.

    A difference of -2 log likelihood of the size G that every stretch bears out has the spread 2
    sqrt(G); one that comes from few stretches (a break-away that one of the two happens to miss)
    has a larger one and is worth the G that has the same ratio to its spread. Each view's evidence
    is cut by itself. Occam factors are cut down with it. What tolerance is strained less is not,
    unless the likelihood says the contrary: a fit strains tolerance for a likelihood that is not
    cut.
    """
    whole, cut, relief, occam = 0.0, 0.0, 0.0, 0.0
    for view, nothing in found.null.items():
        a = better if view in better.views else nothing
        b = worse if worse is not None and view in worse.views else nothing
        if a is not b:
            difference = b.surprise(view, found.lengths[view]) - a.surprise(
                view, found.lengths[view]
            )
            whole, cut = whole + float(difference.sum()), cut + strength(difference)
    for outcome, sign in ((better, -1.0), (worse, 1.0)):
        if outcome is not None:
            relief += sign * (
                outcome.fit.penalty - sum(found.null[v].fit.penalty for v in outcome.views)
            )
            occam += sign * (outcome.volume() - sum(found.null[v].volume() for v in outcome.views))
    share = min(max(cut / whole, 0.0), 1.0) if abs(whole) > 1e-9 else 1.0
    return cut + share * occam + (relief if whole * relief >= 0 else share * relief)


def strength(differences: Array) -> float:
    """Sum of the differences, cut down to what their spread over the stretches lets it be worth;
    keeps its sign.
    """
    return float(differences.sum()) * borne_out(differences)


def steady_strength(differences: Array) -> float:
    """The same where what stands out of the stretches may be cut to the size of the others first,
    at the level that leaves most: one stretch that is far ahead does not make the others say less.
    """
    sizes = np.sort(np.abs(differences))[::-1]
    levels = sizes[: max(3, len(sizes) // 4)]
    return max(
        (strength(np.clip(differences, -level, level)) for level in levels), key=abs, default=0.0
    )


def borne_out(differences: Array) -> float:
    """Share of a sum of differences that its spread over the stretches lets stand."""
    total, spread = abs(float(differences.sum())), float(differences @ differences)
    return min(1.0, 4.0 * total / spread) if spread > 0 else 1.0


def excess(outcome: Outcome, view: str) -> Array:
    """Sum of squares beyond the floor, stretch by stretch, in independent samples; what stands out
    of the stretches is cut to their top.
    """
    n, blocks = outcome.counts[view], outcome.blocks[view]
    share = np.minimum(BLOCK, n - BLOCK * np.arange(len(blocks)))
    beyond = (blocks / outcome.floor.get(view, 1.0) ** 2 - share) / outcome.lengths[view]
    return np.minimum(beyond, np.quantile(beyond, 1 - OUTSTANDING)) if len(beyond) else beyond
