"""Which effects of a user's catalogue a user's plant needs: forward selection, a backward step, and
how sure that is.

Of the effects that pass three gates the one that shrinks the gap most is taken. The gates: evidence
under whitened noise, the same over most of the record, and a material share of what is left above
the sensors' noise (a record of a thousand times its noise makes any effect significant). To stay,
an effect needs evidence only. The noise's colour is that of the richer hypothesis: a poorer one
must not call its misfit noise.

Effects that stand for themselves come first; one that refines others (a Stribeck curve, friction
that differs by direction) is offered once those are in and no plain effect passes any more.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pneugantry.diagnosis.own_bench import Hypothesis, OwnBench, Trial
from pneugantry.engine.catalogue import Effect, Parameter

__all__ = ["OwnSearch", "Step", "search"]

# fall of -2 log evidence that an effect must bring (strong evidence), besides what the number of
# effects costs
ENTRY = 6.0
SURE = 2.0  # standard deviations, over blocks of rows, by which that fall must exceed 0
MATERIAL = 0.1  # share of the mean square above the noise that an effect must explain
SCREENED = (
    3  # effects that are fitted in full at each step: those that promise to shrink the gap most
)
# the same as a share of what tolerance alone leaves: 1 % of the gap, below which forms of one
# effect differ, too
LEAST = 1e-4
DRAWS = 400  # of the bootstrap over blocks
MOST = 10  # effects


@dataclass(frozen=True)
class Step:
    """One step of the search."""

    effect: str
    taken: bool  # False: dropped
    gain: float  # of -2 log evidence, by having the effect
    trial: Trial  # after the step
    instead_of: str = ""  # the effect whose place it takes


@dataclass
class OwnSearch:
    """All that was tried."""

    null: Trial
    best: Trial
    steps: list[Step] = field(default_factory=list)
    gains: dict[str, float] = field(
        default_factory=dict
    )  # of each effect of the best hypothesis: what dropping it costs
    losers: list[Trial] = field(
        default_factory=list
    )  # the last effects that did not pass, each added to the effects before it
    probabilities: list[tuple[Trial, float]] = field(default_factory=list)  # falling


def search(bench: OwnBench, catalogue: Mapping[str, Effect]) -> OwnSearch:
    """Tolerance first, then effect by effect."""
    null = bench.fit(Hypothesis())
    found = OwnSearch(null, null)
    rivals: dict[str, set[str]] = {}
    losers: list[Trial] = []
    while len(found.best.keys) < MOST:
        taken, losers = _forward(bench, null, found.best, catalogue)
        if taken is None:
            break
        rivals[taken.effect] = {t.keys[-1] for t in losers}
        found.steps.append(taken)
        found.best = taken.trial
    while True:
        best = found.best
        drops = {
            e.key: _refit(bench, best.hypothesis.without(e.key), best)
            for e, _ in best.hypothesis.effects
            if _droppable(best, e)
        }
        found.gains = {key: trial.evidence - best.evidence for key, trial in drops.items()}
        needless = [key for key, trial in drops.items() if not convincing(trial, best)]
        if needless:
            key = min(needless, key=lambda k: found.gains[k])
            found.steps.append(Step(key, False, found.gains[key], drops[key]))
            found.best = bench.fit(drops[key].hypothesis, drops[key])
            continue
        swapped = {
            key: _swapped(bench, drop, best, catalogue, rivals.get(key, set()))
            for key, drop in drops.items()
        }
        swaps = [t for trials in swapped.values() for t in trials]
        better = min(
            (t for t in swaps if t.evidence < best.evidence), key=lambda t: t.evidence, default=None
        )
        if better is None or len(found.steps) > 4 * MOST:
            break
        gone = next(key for key, trials in swapped.items() if better in trials)
        found.steps.append(
            Step(better.keys[-1], True, best.evidence - better.evidence, better, gone)
        )
        found.best = bench.fit(better.hypothesis, better)
    found.losers = losers
    added = [
        _refit(bench, t.hypothesis, t, best)
        for t in losers
        if set(best.keys) < set(t.keys) and len(t.keys) == len(best.keys) + 1
    ]
    pool = [best, *drops.values(), *swaps, *(t for t in added if material(bench, null, best, t))]
    pool += [_refit(bench, Hypothesis(), null, best)] if len(best.keys) > 1 else []
    found.probabilities = probabilities(pool)
    return found


def convincing(without: Trial, trial: Trial) -> bool:
    """The first two gates: strong evidence, and not the luck of a few blocks. Both trials under the
    same whiteners.
    """
    gain = without.evidence - trial.evidence
    difference = without.blocks - trial.blocks
    return gain > ENTRY and gain > SURE * np.sqrt(len(difference)) * float(np.std(difference))


def material(bench: OwnBench, null: Trial, without: Trial, trial: Trial) -> bool:
    """The third gate."""
    before = bench.excess(without)
    return before - bench.excess(trial) > max(MATERIAL * before, LEAST * bench.excess(null))


def probabilities(trials: Sequence[Trial], seed: int = 0) -> list[tuple[Trial, float]]:
    """Probability of each hypothesis: its share of the evidence, averaged over Bayesian bootstrap
    draws of the blocks of rows.

    What rests on a few blocks alone is thereby not taken for certain, as plain evidence would where
    the noise is not quite the assumed one.
    """
    best: dict[frozenset[str], Trial] = {}
    for trial in trials:
        key = frozenset(trial.keys)
        if key not in best or trial.evidence < best[key].evidence:
            best[key] = trial
    chosen = list(best.values())
    blocks, costs = np.array([t.blocks for t in chosen]), np.array([t.cost for t in chosen])
    weights = (
        np.random.default_rng(seed).dirichlet(np.ones(blocks.shape[1]), DRAWS) * blocks.shape[1]
    )
    total = weights @ blocks.T + costs
    shares = np.exp(-0.5 * (total - total.min(axis=1, keepdims=True)))
    mean = (shares / shares.sum(axis=1, keepdims=True)).mean(axis=0)
    return sorted(
        ((t, float(p)) for t, p in zip(chosen, mean, strict=True)), key=lambda item: -item[1]
    )


def _forward(
    bench: OwnBench, null: Trial, base: Trial, catalogue: Mapping[str, Effect]
) -> tuple[Step | None, list[Trial]]:
    """The next effect, if any passes; and the others that were fitted."""
    losers: list[Trial] = []
    names = {effect.name for effect, _ in base.hypothesis.effects}
    offered = [
        e for key, e in catalogue.items() if key not in base.keys and set(e.refines) <= names
    ]
    for refining in (False, True):
        tried = _extended(bench, base, [e for e in offered if bool(e.refines) == refining])
        for trial in sorted(tried, key=bench.excess):
            without = _refit(bench, base.hypothesis, base, trial)
            if convincing(without, trial) and material(bench, null, without, trial):
                return Step(trial.keys[-1], True, without.evidence - trial.evidence, trial), [
                    t for t in tried if t is not trial
                ]
        losers += tried
    return None, losers


def _extended(bench: OwnBench, base: Trial, effects: Sequence[Effect]) -> list[Trial]:
    """The base with each of the most promising effects added, in its best form."""
    plain = bench.plain(base.values)
    promises: list[tuple[float, Effect]] = []
    for effect in effects:
        gains = [
            bench.promise(base.hypothesis.plus(effect, form), base, plain, starts)
            for form in effect.forms
            for starts in _starts(form.parameters)
        ]
        promises.append((max(gains), effect))
    promises.sort(key=lambda item: -item[0])
    return [_added(bench, base, effect) for promise, effect in promises[:SCREENED] if promise > 0]


def _added(bench: OwnBench, base: Trial, effect: Effect, under: Trial | None = None) -> Trial:
    """The base with one effect added, in its best form, from its starting values. `under`: whose
    noise is taken.
    """
    fits = [
        bench.fit(
            base.hypothesis.plus(effect, form), base, starts, under.whiteners if under else None
        )
        for form in effect.forms
        for starts in _starts(form.parameters)
    ]
    return min(fits, key=lambda t: t.evidence)


def _refit(
    bench: OwnBench, hypothesis: Hypothesis, start: Trial, under: Trial | None = None
) -> Trial:
    """A hypothesis under the noise of another, `start` if none is named."""
    return bench.fit(hypothesis, start, whiteners=(under or start).whiteners)


def _droppable(best: Trial, effect: Effect) -> bool:
    """No other effect refines it."""
    return all(effect.name not in other.refines for other, _ in best.hypothesis.effects)


def _swapped(
    bench: OwnBench, drop: Trial, best: Trial, catalogue: Mapping[str, Effect], rivals: set[str]
) -> list[Trial]:
    """Near losers in the place of the dropped effect."""
    names = {e.name for e, _ in drop.hypothesis.effects}
    fit = [
        catalogue[r]
        for r in sorted(rivals)
        if r not in best.keys and set(catalogue[r].refines) <= names
    ]
    return [_added(bench, drop, effect, best) for effect in fit]


def _starts(parameters: Sequence[Parameter]) -> list[dict[str, float]]:
    """Combinations of the starting values that a form lists; one, empty, where it lists none."""
    listed = [[(p.name, value) for value in p.starts] for p in parameters if p.starts]
    return [dict(chosen) for chosen in itertools.product(*listed)]
