"""Which effects of a user's catalogue a user's plant needs: forward selection by evidence, a backward step, and how sure that is.

Effects that stand for themselves come first; one that refines others (a Stribeck curve, friction that differs by direction) is offered
once those are in and no plain effect improves any more.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from diagnosis.catalogue import Effect
from diagnosis.own_bench import Hypothesis, OwnBench, Trial

__all__ = ["OwnSearch", "Step", "search"]

ENTRY = 6.0  # fall of -2 log evidence that an effect must bring (strong evidence), besides what its number costs
SURE = 2.0  # standard deviations, over blocks of rows, by which that fall must exceed 0
SCREENED = 4  # effects that are fitted in full at each step: those that promise most
DRAWS = 400  # of the bootstrap over blocks
MOST = 8  # effects
NEAR = 30.0  # a loser that came as near as this to a step's winner is tried in its place at the end


@dataclass(frozen=True)
class Step:
    """One step of the search."""

    effect: str
    taken: bool  # False: dropped
    gain: float  # of evidence, by having the effect
    trial: Trial  # after the step


@dataclass
class OwnSearch:
    """All that was tried."""

    null: Trial
    best: Trial
    steps: list[Step] = field(default_factory=list)
    trials: list[Trial] = field(default_factory=list)
    probabilities: list[tuple[Trial, float]] = field(default_factory=list)  # falling


def search(bench: OwnBench, catalogue: Mapping[str, Effect]) -> OwnSearch:
    """Tolerance first, then effect by effect."""
    null = bench.fit(Hypothesis())
    found = OwnSearch(null, null, trials=[null])
    rivals: dict[str, set[str]] = {}
    while len(found.best.keys) < MOST:
        winner = None
        for refined in (False, True):
            tried = _extended(bench, found.best, [e for e in _offered(found.best, catalogue) if bool(e.refines) == refined])
            found.trials += tried
            winner = min((t for t in tried if convincing(found.best, t)), key=lambda t: t.evidence, default=None)
            if winner is not None:
                near = (t.keys[-1] for t in tried if t is not winner and t.evidence < winner.evidence + NEAR)
                rivals[winner.keys[-1]] = set(near)
                break
        if winner is None:
            break
        found.steps.append(Step(winner.keys[-1], True, found.best.evidence - winner.evidence, winner))
        found.best = winner
    _drop(bench, found)
    _swap(bench, found, catalogue, rivals)
    found.probabilities = probabilities(found.trials)
    return found


def convincing(without: Trial, trial: Trial) -> bool:
    """The fall of -2 log evidence is large, and not the luck of a few blocks."""
    gain = without.evidence - trial.evidence
    difference = without.blocks - trial.blocks
    return gain > ENTRY and gain > SURE * np.sqrt(len(difference)) * float(np.std(difference))


def _offered(best: Trial, catalogue: Mapping[str, Effect]) -> Iterator[Effect]:
    """Effects not in yet whose own effects are."""
    names = {effect.name for effect, _ in best.hypothesis.effects}
    for key, effect in catalogue.items():
        if key not in best.keys and set(effect.refines) <= names:
            yield effect


def _extended(bench: OwnBench, base: Trial, effects: list[Effect]) -> list[Trial]:
    """The base with each of the most promising effects added, in its best form."""
    promises: list[tuple[float, Effect]] = []
    for effect in effects:
        gains = [bench.promise(base.hypothesis.plus(effect, form), base, starts) for form in effect.forms for starts in _starts(form.parameters)]
        promises.append((max(gains), effect))
    promises.sort(key=lambda item: -item[0])
    return [fit_effect(bench, base, effect) for promise, effect in promises[:SCREENED] if promise > ENTRY]


def fit_effect(bench: OwnBench, base: Trial, effect: Effect) -> Trial:
    """The base with one effect added, in its best form, from its starting values."""
    fits = [bench.fit(base.hypothesis.plus(effect, form), base, starts) for form in effect.forms for starts in _starts(form.parameters)]
    return min(fits, key=lambda t: t.evidence)


def _starts(parameters) -> list[dict[str, float]]:  # type: ignore[no-untyped-def]
    """Combinations of the starting values that a form lists; one, empty, where it lists none."""
    listed = [[(p.name, value) for value in p.starts] for p in parameters if p.starts]
    return [dict(chosen) for chosen in itertools.product(*listed)]


def _drop(bench: OwnBench, found: OwnSearch) -> None:
    """Backward: effects that the later ones have made needless go, the least needed first."""
    while found.best.keys:
        effects = found.best.hypothesis.effects
        needed = {name for effect, _ in effects for name in effect.refines}
        tried = {e.key: bench.fit(found.best.hypothesis.without(e.key), found.best) for e, _ in effects if e.name not in needed}
        found.trials += tried.values()
        key, trial = min(tried.items(), key=lambda item: item[1].evidence)
        if convincing(trial, found.best):
            return
        found.steps.append(Step(key, False, trial.evidence - found.best.evidence, trial))
        found.best = trial


def _swap(bench: OwnBench, found: OwnSearch, catalogue: Mapping[str, Effect], rivals: Mapping[str, set[str]]) -> None:
    """Near losers in their winner's place; the best of all is kept."""
    base = found.best
    for key in base.keys:
        rest = base.hypothesis.without(key)
        names = {e.name for e, _ in rest.effects}
        for rival in sorted(rivals.get(key, set()) - set(base.keys)):
            effect = catalogue[rival]
            if not {n for e, _ in rest.effects for n in e.refines} | set(effect.refines) <= names | {effect.name}:
                continue
            without = next((t for t in found.trials if set(t.keys) == set(rest.keys)), None) or bench.fit(rest, base)
            trial = fit_effect(bench, without, effect)
            found.trials.append(trial)
            if trial.evidence < found.best.evidence:
                found.best = trial


def probabilities(trials: list[Trial], seed: int = 0) -> list[tuple[Trial, float]]:
    """Probability of each hypothesis: its share of the evidence, averaged over Bayesian bootstrap draws of the blocks of rows.

    What rests on a few blocks alone is thereby not taken for certain, as plain evidence would where the noise is not quite the
    assumed one.
    """
    best: dict[frozenset[str], Trial] = {}
    for trial in trials:
        key = frozenset(trial.keys)
        if key not in best or trial.evidence < best[key].evidence:
            best[key] = trial
    chosen = list(best.values())
    blocks, costs = np.array([t.blocks for t in chosen]), np.array([t.cost for t in chosen])
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet(np.ones(blocks.shape[1]), DRAWS) * blocks.shape[1]
    total = weights @ blocks.T + costs
    shares = np.exp(-0.5 * (total - total.min(axis=1, keepdims=True)))
    mean = (shares / shares.sum(axis=1, keepdims=True)).mean(axis=0)
    return sorted(((t, float(p)) for t, p in zip(chosen, mean, strict=True)), key=lambda item: -item[1])
