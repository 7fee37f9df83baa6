"""Which effects: tolerance first, then every effect of the catalogue where something is left, then
pairs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from pneugantry.diagnosis.bench import Bench, Choice, Outcome, joined
from pneugantry.diagnosis.candidates import (
    Candidate,
    additions,
    chosen_seconds,
    joining,
    most_promising,
    other_forms,
    relieves,
    strained_in,
    weigh,
)
from pneugantry.diagnosis.evidence import (
    QUIET,
    Search,
    Trial,
    advantage,
    least_left,
    leftover,
    misfit,
    rough,
    score,
    trouble,
)
from pneugantry.diagnosis.parallel import each
from pneugantry.diagnosis.tight_lead import first_fit, is_of, large_misfits, tightly_led
from pneugantry.engine.catalogue import Effect

__all__ = ["search"]

BASES = 3  # single effects per troubled view that pairs are built on
MOST_BASES = 5
RIVAL = 0.25  # share of its view's best gain from which on a single effect is a base too
FIT_LED = (
    6  # effects of one friction view alone that are fitted from where a tight lead has brought them
)
# second effects per base that are fitted in full, by what one step promises or a tight lead leaves
FIT_PAIRS = 3
# and those that are, whatever they promise: the best single effects of the views in which something
# is left, and no other
LEADERS = 3
REFINED = 3  # leading trials of each troubled view that are fitted to the end
RETRIED = 2  # the first so many of all of them are tried under a tighter lead too
PAIRS_REFINED = 3
# evidence over its members that a pair must have before it is refined: less than a second effect
# costs
PROSPECT = 10.0


def search(bench: Bench, catalogue: Mapping[str, Effect]) -> Search:
    found = Search(bench.settle(name for name in bench.views if name.startswith("valve")), set())
    found.troubled = _troubled(found)
    valves = {key: effect for key, effect in catalogue.items() if effect.block.startswith("valve")}
    found.singles = _singles(bench, valves, found)
    score(found)
    _refine(bench, found, _leading(found))
    bench.drive(
        {
            name: value
            for view in found.null
            for name, value in least_left(found, view).values.items()
        }
    )
    found.null |= bench.settle(name for name in bench.views if name not in found.null)
    found.troubled = _troubled(found)
    rest = {key: effect for key, effect in catalogue.items() if key not in valves}
    found.singles += _singles(bench, rest, found)
    _renull(bench, found)
    _refine(bench, found, [t for t in _leading(found) if t.choice.keys[0] not in valves])
    _relay(bench, found)
    _renull(bench, found)
    tried: set[str] = set()
    for base in _bases(found):
        found.pairs += _seconds(bench, catalogue, found, base)
        tried.add(base.choice.keys[0])
    score(found)
    for key in [
        k for t in _prospects(found)[:1] for k in t.choice.keys if k not in tried
    ]:  # the leading pair's other effect as base
        found.pairs += [
            p
            for t in found.singles
            if t.choice.keys == (key,)
            for p in _seconds(bench, catalogue, found, t)
        ]
    score(found)
    found.pairs = _distinct(found.pairs)
    prospects = _prospects(found)
    _refine(bench, found, [*prospects, *(t for t in _valve_pairs(found) if t not in prospects)])
    _resingle(bench, found)
    _rejoin(found)
    return found


def _distinct(pairs: Iterable[Trial]) -> list[Trial]:
    """The first of each pair, whatever the order of its effects."""
    first: dict[frozenset[str], Trial] = {}
    for trial in pairs:
        first.setdefault(frozenset(trial.choice.keys), trial)
    return list(first.values())


def _renull(bench: Bench, found: Search) -> None:
    """Tolerance alone once more from where the best hypotheses have left it: a fit that had stuck
    must not count for them.
    """
    score(found)
    for view in found.null:
        for trial in [t for t in found.singles if view in t.outcome.views][:2]:
            again = bench.fit(Choice(), (view,), start_values=trial.outcome.values)
            if again.objective < found.null[view].objective:
                found.null[view] = again
    found.troubled = _troubled(found)
    score(found)


def _relay(bench: Bench, found: Search) -> None:
    """Where a view's leader strains tolerance it may have found another effect's minimum: the
    others once more, from there, but for those that a tight lead has brought to theirs.
    """
    for view in sorted(found.troubled):
        mine = [t for t in found.singles if view in t.outcome.views]
        if mine and strained_in(mine[0].outcome.fit) & set(bench.views[view].tolerance):
            others = [
                t
                for t in mine[1:]
                if found.troubled.intersection(t.outcome.views) <= set(mine[0].outcome.views)
            ]
            _again(bench, found, [(t, mine[0]) for t in others if not t.led])


def _resingle(bench: Bench, found: Search) -> None:
    """The members of the leading pairs once more, alone, from where the pair has left the
    tolerance, for the same reason.
    """
    _again(
        bench,
        found,
        [
            (t, pair)
            for pair in found.pairs[:2]
            for t in found.singles
            if t.choice.keys[0] in pair.choice.keys
        ],
    )


def _rejoin(found: Search) -> None:
    """Pairs in views of their own each as their members stand now."""
    alone = {t.choice.keys: t for t in found.singles}
    for pair in (p for p in found.pairs if p.apart):
        first, second = (alone[(key,)].outcome for key in pair.choice.keys)
        if not set(first.views) & set(second.views):
            pair.outcome = joined(first, second)
            pair.choice = pair.outcome.choice
    score(found)


def _again(bench: Bench, found: Search, entries: Sequence[tuple[Trial, Trial]]) -> None:
    """The first trial of each entry fitted carefully from where the second one stands, and kept
    where that is better.
    """

    def fitted(entry: tuple[Trial, Trial]) -> Outcome:
        trial, start = entry
        return bench.fit(
            trial.choice,
            trial.outcome.views,
            start_values=start.outcome.values,
            base=trial.outcome,
            careful=True,
        )

    for (trial, _), outcome in zip(entries, each(fitted, entries, bench.workers), strict=True):
        if outcome.objective < trial.outcome.objective:
            trial.outcome = outcome
    score(found)


def _troubled(found: Search) -> set[str]:
    return {name for name, outcome in found.null.items() if trouble(outcome, name) > QUIET}


def _singles(bench: Bench, catalogue: Mapping[str, Effect], found: Search) -> list[Trial]:
    """Every effect that touches a troubled view, fitted in full on all views that it touches."""
    if not found.troubled:
        return []
    candidates = list(additions(bench, catalogue, found, None))
    led = tightly_led(
        bench, candidates, large_misfits({v: found.null[v] for v in found.troubled}), None
    )
    candidates = [
        c for c in candidates if c.choice.keys not in {known.choice.keys for known in led}
    ]
    weigh(
        bench, found, [c for c in candidates if not c.choice.settings and not c.starts]
    )  # another law has no small step
    chosen = most_promising(candidates, found.troubled)
    for view in sorted(found.troubled):
        chosen += [c for c in led if view in c.views][:FIT_LED]
    return _fitted(bench, chosen)


def _bases(found: Search) -> list[Trial]:
    """Single effects that pairs are built on: the best of each troubled view, and what comes near
    them.
    """
    bases: list[Trial] = []
    known = [t for t in found.singles if not t.choice.outside]
    for view in sorted(found.troubled):
        mine = [t for t in known if view in t.outcome.views and t.gain > QUIET]
        near = [t for t in mine if t.gain > RIVAL * mine[0].gain][:BASES] if mine else []
        bases += [t for t in near if t not in bases]
    return sorted(bases, key=lambda t: -t.gain)[:MOST_BASES]


def _seconds(
    bench: Bench, catalogue: Mapping[str, Effect], found: Search, base: Trial
) -> list[Trial]:
    """Pairs that add an effect to `base` where it leaves something."""
    mine = set(base.outcome.views)
    left = {v for v in found.troubled if v not in mine} | {
        v for v in mine if leftover(bench, base.outcome, v, found.null[v]) > QUIET
    }
    if not left:
        return []
    apart = []
    for t in found.singles:
        if (
            not mine & set(t.outcome.views)
            and left & set(t.outcome.views)
            and t.gain > QUIET
            and not t.choice.outside
        ):
            both = joined(base.outcome, t.outcome)
            apart.append(Trial(both.choice, both, apart=True))
    beside = {t.choice.keys[-1] for t in apart}
    rest = {
        key: effect for key, effect in catalogue.items() if key not in beside and not effect.outside
    }
    candidates = [
        c
        for c in additions(bench, rest, found, base, left)
        if mine & set(bench.touched_by(c.choice.effects[-1][1]))
    ]
    far_off = large_misfits(
        {v: least_left(found, v) for v in left & mine}
    )  # elsewhere a single effect's own fit is a start
    led = tightly_led(bench, candidates, far_off, base)
    candidates = [
        c for c in candidates if c.choice.keys not in {known.choice.keys for known in led}
    ]
    weigh(bench, found, [c for c in candidates if not c.starts])
    leaders: dict[str, Trial] = {}
    for view in left:
        inside = (
            t
            for t in found.singles
            if view in t.outcome.views and left.issuperset(t.outcome.views) and not t.choice.outside
        )
        mine_alone = [t for t in inside if t.gain > QUIET]
        leaders |= {t.choice.keys[0]: t for t in mine_alone[:LEADERS]}
    chosen = chosen_seconds(candidates, FIT_PAIRS, leaders)
    for view in far_off:
        ranked = [c for c in led if is_of(bench, c.choice.effects[-1][1], view)]
        chosen += [
            c
            for i, c in enumerate(ranked)
            if i < FIT_PAIRS or c.choice.keys[-1] in leaders or relieves(c)
        ]
    chosen += [
        c for key, t in leaders.items() if key not in beside for c in joining(bench, base, t)
    ]
    return apart + _fitted(bench, chosen)


def _refine(bench: Bench, found: Search, trials: list[Trial]) -> None:
    """Leading trials fitted to the end, and with the other forms of their effects."""
    ranked = [(rank, trial) for rank, trial in enumerate(trials) if not trial.apart]
    outcomes = each(lambda entry: _to_the_end(bench, *entry), ranked, bench.workers)
    for (_, trial), outcome in zip(ranked, outcomes, strict=True):
        trial.outcome = outcome
    for i in range(max((len(trial.choice.effects) for _, trial in ranked), default=0)):
        _reform(bench, found, [trial for _, trial in ranked], i)
    score(found)


def _to_the_end(bench: Bench, rank: int, trial: Trial) -> Outcome:
    o = trial.outcome
    best = min(
        o,
        bench.fit(trial.choice, o.views, start_values=o.values, base=o, careful=True),
        key=lambda o: o.objective,
    )
    if rank < RETRIED and any(rough(best, v) for v in o.views if v.startswith("friction")):
        best = min(
            best,
            bench.fit_by_tighter_lead(trial.choice, o.views, best.values, best),
            key=lambda o: o.objective,
        )
    return best


def _reform(bench: Bench, found: Search, trials: Sequence[Trial], i: int) -> None:
    """Tries the other forms of each trial's effect `i` from where its own fit stands."""
    tries = [
        (trial, candidate)
        for trial in trials
        if i < len(trial.choice.effects)
        for candidate in other_forms(bench, trial, i)
    ]
    outcomes = each(lambda entry: _fit(bench, entry[1]), tries, bench.workers)
    for (trial, candidate), outcome in zip(tries, outcomes, strict=True):
        if outcome.evidence(found.lengths) < trial.outcome.evidence(found.lengths):
            trial.choice, trial.outcome = candidate.choice, outcome


def _prospects(found: Search) -> list[Trial]:
    """The best pairs, of those that have something over both their members."""
    alone = {t.choice.keys: advantage(found, t.outcome, None) for t in found.singles}
    ahead = [
        t
        for t in found.pairs
        if advantage(found, t.outcome, None) - max(alone.get((key,), 0.0) for key in t.choice.keys)
        > PROSPECT
    ]
    return ahead[:PAIRS_REFINED]


def _valve_pairs(found: Search) -> list[Trial]:
    """Of each valve in which something is left the pair that leaves least: its fits are cheap, and
    other forms may explain all that plain ones do not.
    """
    pairs = []
    for view in sorted(
        v
        for v in found.troubled
        if v.startswith("valve") and misfit(least_left(found, v), v) > QUIET
    ):
        mine = [t for t in found.pairs if t.outcome.views == (view,)]
        pairs += sorted(mine, key=lambda t: t.outcome.squares[view])[:1]
    return pairs


def _leading(found: Search) -> list[Trial]:
    """The best single effects of each troubled view."""
    leading: list[Trial] = []
    for view in sorted(found.troubled):
        mine = [t for t in found.singles if view in t.outcome.views]
        least = min(mine, key=lambda t: t.outcome.squares[view], default=None)
        if not view.startswith(
            "valve"
        ):  # whose fits are cheap, and where another form may explain all that a plain one does not
            mine = [t for t in mine if t.gain > QUIET][:REFINED]
            mine += (
                [least] if least is not None else []
            )  # a misfit in one place is hardly evidence, but a place to go on from
        for trial in mine:
            if trial not in leading:
                leading.append(trial)
    return leading


def _fitted(bench: Bench, candidates: Iterable[Candidate]) -> list[Trial]:
    """Best fit per hypothesis over its forms and starts."""
    best: dict[tuple[str, ...], Trial] = {}
    candidates = list(candidates)
    outcomes = each(lambda c: _fit(bench, c), candidates, bench.workers)
    for c, outcome in zip(candidates, outcomes, strict=True):
        held = best.get(c.choice.keys)
        if held is None or outcome.objective < held.outcome.objective:
            best[c.choice.keys] = Trial(c.choice, outcome, led=c.led)
    return list(best.values())


def _fit(bench: Bench, c: Candidate) -> Outcome:
    """A candidate's fit; where it strains tolerance, once more from its eased start."""
    known = c.known | first_fit(bench, c).values if c.tight else c.known
    cheap = all(view.startswith("valve") for view in c.views)
    outcome = bench.fit(c.choice, c.views, c.starts, known, c.base, careful=cheap)
    if c.eased is not None and strained_in(outcome.fit):
        outcome = min(
            outcome,
            bench.fit(c.choice, c.views, c.starts, c.eased, c.base),
            key=lambda o: o.objective,
        )
    return outcome
