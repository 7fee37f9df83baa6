"""Which effects: tolerance first, then every effect of the catalogue where something is left, then pairs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from diagnosis.bench import FLOOR, Bench, Choice, Outcome
from diagnosis.catalogue import Effect

__all__ = ["Search", "Trial", "search"]

SCATTER = 3.0  # standard deviations of the floor's sum of squares
QUIET = 8.0  # what a view's misfit and strained tolerance may hold together without asking for an effect
KEEP = 3  # single effects that pairs within the same views are built on


@dataclass
class Trial:
    """A hypothesis with its gain over tolerance alone: difference of -2 log evidence, larger is better."""

    choice: Choice
    outcome: Outcome
    gain: float


@dataclass
class Search:
    """All that was tried."""

    null: dict[str, Outcome]  # by view: tolerance alone
    singles: list[Trial] = field(default_factory=list)
    pairs: list[Trial] = field(default_factory=list)
    lengths: dict[str, float] = field(default_factory=dict)
    evaluations: int = 0


def search(bench: Bench, catalogue: Mapping[str, Effect]) -> Search:
    null = {name: bench.fit(Choice(), (name,)) for name in bench.views}
    troubled = {name for name, outcome in null.items() if _trouble(outcome, name) > QUIET}
    found = Search(null)
    for effect in catalogue.values():
        outcome = try_effect(bench, effect, Choice(), troubled, null)
        if outcome is not None:
            found.singles.append(Trial(outcome.choice, outcome, 0.0))
    _score(found, found.singles)
    for base in _kept(found.singles):
        for effect in catalogue.values():
            if effect.key in base.choice.keys:
                continue
            touched = bench.touched([p.name for form in effect.forms for p in form.parameters])
            if not set(touched) & set(base.outcome.views) or not set(touched) & troubled:
                continue
            outcome = try_effect(bench, effect, base.choice, troubled, null, base.outcome)
            if outcome is not None:
                found.pairs.append(Trial(outcome.choice, outcome, 0.0))
    _score(found, found.singles + found.pairs)
    found.evaluations = bench.evaluations
    return found


def _trouble(outcome: Outcome, view: str) -> float:
    """What is left in a view under tolerance alone: misfit, and tolerance strained beyond its size."""
    return misfit(outcome, view) + outcome.fit.penalty - len(outcome.fit.coordinates)


def misfit(outcome: Outcome, view: str) -> float:
    """Sum of squares beyond the floor and its own scatter, in independent samples."""
    n, length = outcome.counts[view], outcome.lengths[view]
    if n == 0:
        return 0.0
    excess = outcome.squares[view] / FLOOR.get(view, 1.0) ** 2 - n
    return max(0.0, excess - SCATTER * math.sqrt(2 * n * length)) / length


def _kept(singles: list[Trial]) -> list[Trial]:
    best = [t for t in singles if t.gain > QUIET][:KEEP]
    return [t for t in best if any(misfit(t.outcome, v) > QUIET for v in t.outcome.views)]


def try_effect(bench: Bench, effect: Effect, base: Choice, troubled: set[str], null: Mapping[str, Outcome], before: Outcome | None = None) -> Outcome | None:
    """Best fit of `base` plus one effect over its forms and starts; None where it touches nothing that needs explaining."""
    best: Outcome | None = None
    for form in effect.forms:
        choice = base.plus(effect, form)
        views = bench.touched(choice.parameter_names + tuple(choice.settings))
        if not set(views) & troubled:
            continue
        known = {name: value for v in views for name, value in null[v].values.items()} | (before.values if before else {})
        for p in form.parameters:
            known.pop(p.name, None)
        for starts in _starts(form.parameters):
            outcome = bench.fit(choice, views, starts, known)
            if best is None or outcome.evidence(outcome.lengths) < best.evidence(outcome.lengths):
                best = outcome
    return best


def _starts(parameters: Iterable) -> list[dict[str, float]]:
    several = [p for p in parameters if p.starts]
    return [{p.name: p.starts[i] for p in several if i < len(p.starts)} for i in range(max((len(p.starts) for p in several), default=1))]


def _score(found: Search, trials: list[Trial]) -> None:
    """Gains with one correlation length per view, that of the hypothesis which leaves least."""
    lengths = {view: outcome.lengths[view] for view, outcome in found.null.items()}
    least = {view: outcome.squares[view] for view, outcome in found.null.items()}
    for trial in trials:
        for view in trial.outcome.views:
            if trial.outcome.squares[view] < least[view]:
                least[view], lengths[view] = trial.outcome.squares[view], trial.outcome.lengths[view]
    found.lengths = lengths
    for trial in trials:
        nothing = sum(found.null[v].evidence(lengths) for v in trial.outcome.views)
        trial.gain = nothing - trial.outcome.evidence(lengths)
    found.singles.sort(key=lambda t: -t.gain)
    found.pairs.sort(key=lambda t: -t.gain)
