"""Which effects: tolerance first, then every effect of the catalogue where something is left, then pairs."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.bench import BLOCK, FLOOR_LENGTH, Bench, Choice, Outcome, joined
from diagnosis.catalogue import Effect, Form, Parameter
from diagnosis.delays import estimate_delays
from diagnosis.fit import Fit
from diagnosis.parallel import each
from diagnosis.waviness import estimate_waviness

__all__ = ["QUIET", "Search", "Trial", "advantage", "excess", "misfit", "search", "strength"]

SCATTER = 3.0  # standard deviations of the floor's sum of squares
OUTSTANDING = 0.05  # share of the stretches that may stand out by a break-away that was missed
Array = NDArray[np.float64]
QUIET = 8.0  # what a view's misfit and strained tolerance may hold together without asking for an effect
BASES = 3  # single effects per troubled view that pairs are built on
MOST_BASES = 5
RIVAL = 0.25  # share of its view's best gain from which on a single effect is a base too
FIT_SINGLES = 8  # effects per troubled view that are fitted, by what one step promises
FIT_OWN = 5  # and of those that touch no other troubled view
FIT_LED = 6  # and effects of one friction view alone by a first fit under a tight lead, where its misfit is large
LARGE = 1.3  # RMS over the floor from which on it is: led loosely, so bad a carriage misses break-aways, and slopes lead astray
TIGHT = (0.1, 0.3)  # shares of the usual time in which carriages are led for such a first fit, one after the other
FIT_PAIRS = 3  # second effects per base that are fitted in full, by what one step promises
LEADERS = 3  # and those that are, whatever they promise: the best single effects of the views in which something is left, and no other
NEGLIGIBLE = 0.01  # share of a view's misfit that may stay without asking for a second effect
RETRIED = 2  # of them, those that are tried under a tighter lead too
PAIRS_REFINED = 3
PROSPECT = 10.0  # evidence over its members that a pair must have before it is refined: less than half of what a second effect costs
STRAINED = 4.0  # standard deviations of tolerance beyond which it stands in for an effect
ROUGH = 1.03  # RMS over the floor from which on a fit of friction may have stuck
REFINED = 3  # leading trials, of each troubled view and among pairs, that are fitted to the end


@dataclass
class Trial:
    """A hypothesis with its gain over tolerance alone: difference of -2 log evidence, larger is better."""

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
        return {name: value for outcome in self.null.values() for name, value in outcome.values.items()}


@dataclass
class _Candidate:
    choice: Choice
    views: tuple[str, ...]
    starts: dict[str, float]
    known: dict[str, float]
    base: Outcome | None = None
    eased: dict[str, float] | None = None  # a second start, without tolerance that has stood in for an effect
    promise: float = math.inf
    tight: str = ""  # friction view on which its last effect is first fitted under a tight lead
    led: bool = False  # its start is such a fit


def search(bench: Bench, catalogue: Mapping[str, Effect]) -> Search:
    found = Search(bench.settle(name for name in bench.views if name.startswith("valve")), set())
    found.troubled = _troubled(found)
    valves = {key: effect for key, effect in catalogue.items() if effect.block.startswith("valve")}
    found.singles = _singles(bench, valves, found)
    _score(found)
    _refine(bench, found, _leading(found))
    bench.drive({name: value for view in found.null for name, value in _best(found, view).values.items()})
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
    _score(found)
    for key in [k for t in _prospects(found)[:1] for k in t.choice.keys if k not in tried]:  # the leading pair's other effect as base
        found.pairs += [p for t in found.singles if t.choice.keys == (key,) for p in _seconds(bench, catalogue, found, t)]
    _score(found)
    found.pairs = _distinct(found.pairs)
    _refine(bench, found, _prospects(found))
    _resingle(bench, found)
    return found


def _distinct(pairs: Iterable[Trial]) -> list[Trial]:
    """The first of each pair, whatever the order of its effects."""
    first: dict[frozenset[str], Trial] = {}
    for trial in pairs:
        first.setdefault(frozenset(trial.choice.keys), trial)
    return list(first.values())


def _renull(bench: Bench, found: Search) -> None:
    """Tolerance alone once more from where the best hypotheses have left it: a fit that had stuck must not count for them."""
    _score(found)
    for view in found.null:
        for trial in [t for t in found.singles if view in t.outcome.views][:2]:
            again = bench.fit(Choice(), (view,), start_values=trial.outcome.values)
            if again.objective < found.null[view].objective:
                found.null[view] = again
    found.troubled = _troubled(found)
    _score(found)


def _relay(bench: Bench, found: Search) -> None:
    """Where a view's leader strains tolerance it may have found another effect's minimum: the others once more, from there, but for
    those that a tight lead has brought to theirs."""
    for view in sorted(found.troubled):
        mine = [t for t in found.singles if view in t.outcome.views]
        if mine and _strained_in(mine[0].outcome.fit) & set(bench.views[view].tolerance):
            others = [t for t in mine[1:] if found.troubled.intersection(t.outcome.views) <= set(mine[0].outcome.views)]
            _again(bench, found, [(t, mine[0]) for t in others if not t.led])


def _resingle(bench: Bench, found: Search) -> None:
    """The members of the leading pairs once more, alone, from where the pair has left the tolerance, for the same reason."""
    _again(bench, found, [(t, pair) for pair in found.pairs[:2] for t in found.singles if t.choice.keys[0] in pair.choice.keys])


def _again(bench: Bench, found: Search, entries: Sequence[tuple[Trial, Trial]]) -> None:
    """The first trial of each entry fitted carefully from where the second one stands, and kept where that is better."""

    def fitted(entry: tuple[Trial, Trial]) -> Outcome:
        trial, start = entry
        return bench.fit(trial.choice, trial.outcome.views, start_values=start.outcome.values, base=trial.outcome, careful=True)

    for (trial, _), outcome in zip(entries, each(fitted, entries, bench.workers), strict=True):
        if outcome.objective < trial.outcome.objective:
            trial.outcome = outcome
    _score(found)


def _troubled(found: Search) -> set[str]:
    return {name for name, outcome in found.null.items() if trouble(outcome, name) > QUIET}


def _best(found: Search, view: str) -> Outcome:
    """The outcome that leaves least of a view."""
    outcomes = [t.outcome for t in found.singles if view in t.outcome.views]
    return min([found.null[view], *outcomes], key=lambda outcome: outcome.squares[view])


def _singles(bench: Bench, catalogue: Mapping[str, Effect], found: Search) -> list[Trial]:
    """Every effect that touches a troubled view, fitted in full on all views that it touches."""
    if not found.troubled:
        return []
    candidates = list(_candidates(bench, catalogue, found, None))
    led = _led(bench, candidates, {v: found.null[v] for v in found.troubled}, None)
    candidates = [c for c in candidates if c.choice.keys not in {known.choice.keys for known in led}]
    _weigh(bench, found, [c for c in candidates if not c.choice.settings and not c.starts])  # another law has no small step
    chosen = _promising(candidates, found.troubled)
    for view in sorted(found.troubled):
        chosen += [c for c in led if view in c.views][:FIT_LED]
    return _fitted(bench, chosen)


def _led(bench: Bench, candidates: Sequence[_Candidate], left: Mapping[str, Outcome], base: Trial | None) -> list[_Candidate]:
    """Candidates whose last effect is of one friction view alone, in which much is left, by view and by what they leave under a tight
    lead, starting from the values that they have there.

    Tightly led no simulated carriage sticks where the measured one moves: the misfit is smooth as far as any effect reaches.
    """
    result: list[_Candidate] = []
    for view in _large(left):
        held = _held(bench, base.choice, base.outcome.values, view) if base is not None else Choice()
        values = _tight(bench, held, view, {}, {}).values  # its Jacobian of tolerance serves all
        mine = [replace(c, tight=view, known=c.known | values) for c in candidates if _is_of(bench, c.choice.effects[-1][1], view)]
        mine = [c for c in mine if not c.starts or c.choice.settings]  # nothing but another law needs several starts there
        best: dict[tuple[str, ...], tuple[float, _Candidate]] = {}
        for c, outcome in zip(mine, each(lambda c: _first_fit(bench, c), mine, bench.workers), strict=True):
            if c.choice.keys not in best or outcome.objective < best[c.choice.keys][0]:
                best[c.choice.keys] = (outcome.objective, replace(c, tight="", led=True, starts={}, known=c.known | outcome.values))
        result += [c for _, c in sorted(best.values(), key=lambda entry: entry[0])]
    return result


def _large(left: Mapping[str, Outcome]) -> list[str]:
    """Friction views in which so much is left that a loosely led carriage tells little."""
    return sorted(v for v, o in left.items() if v.startswith("friction") and o.rms(v) > LARGE * o.floor.get(v, 1.0))


def _is_of(bench: Bench, form: Form, view: str) -> bool:
    """Whether a form touches this view and no other."""
    return bench.touched_by(form) == (view,)


def _first_fit(bench: Bench, c: _Candidate) -> Outcome:
    """The candidate on its tightly led view alone, its other effects held."""
    others = _held(bench, Choice(c.choice.effects[:-1]), c.known, "")
    return _tight(bench, others.plus(*c.choice.effects[-1]), c.tight, c.starts, {name: c.known[name] for name in others.parameter_names})


def _held(bench: Bench, choice: Choice, values: Mapping[str, float], free: str) -> Choice:
    """Effects set to their values, but for those of the view `free` and those that are a tolerance's, which are fitted anyway."""
    result = []
    tolerance = {name for view in bench.views.values() for name in view.tolerance}
    for effect, form in choice.effects:
        if not _is_of(bench, form, free) and not any(p.name in tolerance for p in form.parameters):
            form = replace(form, parameters=(), settings={**form.settings, **{p.name: values[p.name] for p in form.parameters}})
        result.append((effect, form))
    return Choice(tuple(result))


def _tight(bench: Bench, choice: Choice, view: str, starts: Mapping[str, float], known: Mapping[str, float]) -> Outcome:
    """A fit of one friction view under one tight lead after the other."""
    for share in TIGHT:
        with bench.led_tighter((view,), share):
            outcome = bench.fit(choice, (view,), starts, known)
        known = outcome.values
    return outcome


def _bases(found: Search) -> list[Trial]:
    """Single effects that pairs are built on: the best of each troubled view, and what comes near them."""
    bases: list[Trial] = []
    known = [t for t in found.singles if not t.choice.outside]
    for view in sorted(found.troubled):
        mine = [t for t in known if view in t.outcome.views and t.gain > QUIET]
        near = [t for t in mine if t.gain > RIVAL * mine[0].gain][:BASES] if mine else []
        bases += [t for t in near if t not in bases]
    return sorted(bases, key=lambda t: -t.gain)[:MOST_BASES]


def _seconds(bench: Bench, catalogue: Mapping[str, Effect], found: Search, base: Trial) -> list[Trial]:
    """Pairs that add an effect to `base` where it leaves something."""
    mine = set(base.outcome.views)
    left = {v for v in found.troubled if v not in mine} | {v for v in mine if _left(bench, base.outcome, v, found.null[v]) > QUIET}
    if not left:
        return []
    apart = [
        Trial(Choice((*base.choice.effects, *t.choice.effects)), joined(base.outcome, t.outcome), apart=True)
        for t in found.singles
        if not mine & set(t.outcome.views) and left & set(t.outcome.views) and t.gain > QUIET and not t.choice.outside
    ]
    beside = {t.choice.keys[-1] for t in apart}
    rest = {key: effect for key, effect in catalogue.items() if key not in beside and not effect.outside}
    candidates = [c for c in _candidates(bench, rest, found, base, left) if mine & set(bench.touched_by(c.choice.effects[-1][1]))]
    dark = _large({v: _best(found, v) for v in left & mine})  # where some effect alone explains most, its own fit is a better start
    led = _led(bench, candidates, dict.fromkeys(dark, base.outcome), base)
    candidates = [c for c in candidates if c.choice.keys not in {known.choice.keys for known in led}]
    _weigh(bench, found, [c for c in candidates if not c.starts])
    leaders: dict[str, Trial] = {}
    for view in left:
        mine_alone = [t for t in found.singles if view in t.outcome.views and left.issuperset(t.outcome.views) and t.gain > QUIET]
        leaders |= {t.choice.keys[0]: t for t in mine_alone[:LEADERS]}
    chosen = _chosen(candidates, FIT_PAIRS, leaders)
    for view in dark:
        ranked = [c for c in led if _is_of(bench, c.choice.effects[-1][1], view)]
        chosen += [c for i, c in enumerate(ranked) if i < FIT_PAIRS or c.choice.keys[-1] in leaders]
    chosen += [c for key, t in leaders.items() if key not in beside for c in _joining(bench, base, t)]
    return apart + _fitted(bench, chosen)


def _joining(bench: Bench, base: Trial, second: Trial) -> Iterator[_Candidate]:
    """Two single effects as a pair, from the first one's values and the second one's."""
    effect, form = second.choice.effects[0]
    if effect.key not in base.choice.keys and not _clash(base.choice, form):
        views = tuple(v for v in bench.views if v in base.outcome.views or v in second.outcome.views)
        yield _Candidate(base.choice.plus(effect, form), views, {}, base.outcome.values | second.outcome.values, base.outcome)


def _refine(bench: Bench, found: Search, trials: list[Trial]) -> None:
    """Leading trials fitted to the end, and with the other forms of their effects."""
    ranked = [(rank, trial) for rank, trial in enumerate(trials) if not trial.apart]
    outcomes = each(lambda entry: _to_the_end(bench, *entry), ranked, bench.workers)
    for (_, trial), outcome in zip(ranked, outcomes, strict=True):
        trial.outcome = outcome
    for i in range(max((len(trial.choice.effects) for _, trial in ranked), default=0)):
        _reform(bench, found, [trial for _, trial in ranked], i)
    _score(found)


def _to_the_end(bench: Bench, rank: int, trial: Trial) -> Outcome:
    o = trial.outcome
    best = min(o, bench.fit(trial.choice, o.views, start_values=o.values, base=o, careful=True), key=lambda o: o.objective)
    if rank < RETRIED and any(_rough(best, v) for v in o.views if v.startswith("friction")):
        best = min(best, bench.fit_by_tighter_lead(trial.choice, o.views, best.values, best), key=lambda o: o.objective)
    return best


def _rough(outcome: Outcome, view: str) -> bool:
    return outcome.rms(view) > ROUGH * outcome.floor.get(view, 1.0)


def _reform(bench: Bench, found: Search, trials: Sequence[Trial], i: int) -> None:
    """Tries the other forms of each trial's effect `i` from where its own fit stands."""
    tries = [(trial, candidate) for trial in trials if i < len(trial.choice.effects) for candidate in _forms(bench, trial, i)]
    outcomes = each(lambda entry: _fit(bench, entry[1]), tries, bench.workers)
    for (trial, candidate), outcome in zip(tries, outcomes, strict=True):
        if outcome.evidence(found.lengths) < trial.outcome.evidence(found.lengths):
            trial.choice, trial.outcome = candidate.choice, outcome


def _forms(bench: Bench, trial: Trial, i: int) -> Iterator[_Candidate]:
    """The other forms of a trial's effect `i`; where its plain form may have led astray, also from the form's own starts alone."""
    effect, held = trial.choice.effects[i]
    last = i == len(trial.choice.effects) - 1  # a pair's first effect has been through this alone
    astray = last and any(_rough(trial.outcome, view) for view in trial.outcome.views)
    for form in effect.forms[1:]:
        rest = Choice(tuple(pair for j, pair in enumerate(trial.choice.effects) if j != i))
        if form.name == held.name or form.estimator or _clash(rest, form):
            continue
        choice = Choice(tuple((effect, form) if j == i else pair for j, pair in enumerate(trial.choice.effects)))
        views = tuple(v for v in bench.views if v in set(bench.touched_by(form)) | set(trial.outcome.views))
        own = {p.name for p in (*held.parameters, *form.parameters)}
        for starts in _starts(form.parameters) or [{}]:
            known = {k: v for k, v in trial.outcome.values.items() if k not in held.settings and k not in form.settings}
            yield _Candidate(choice, views, starts, starts | known, trial.outcome)
            if astray:
                others = {k: v for k, v in known.items() if k not in own}
                alone = views[0] if len(choice.effects) == 1 and len(views) == 1 and views[0].startswith("friction") else ""
                yield _Candidate(choice, views, starts, others | starts, trial.outcome, tight=alone)


def _prospects(found: Search) -> list[Trial]:
    """The best pairs, of those that have something over both their members."""
    alone = {t.choice.keys: advantage(found, t.outcome, None) for t in found.singles}
    ahead = [
        t for t in found.pairs if advantage(found, t.outcome, None) - max(alone.get((key,), 0.0) for key in t.choice.keys) > PROSPECT
    ]  # fmt: skip
    return ahead[:PAIRS_REFINED]


def _leading(found: Search) -> list[Trial]:
    """The best single effects of each troubled view."""
    leading: list[Trial] = []
    for view in sorted(found.troubled):
        mine = [t for t in found.singles if view in t.outcome.views]
        least = sorted(mine, key=lambda t: t.outcome.squares[view])[
            :1
        ]  # a misfit in one place is hardly evidence, but a place to go on from
        if not view.startswith("valve"):  # whose fits are cheap, and where another form may explain all that a plain one does not
            mine = [t for t in mine if t.gain > QUIET][:REFINED] + least
        for trial in mine:
            if trial not in leading:
                leading.append(trial)
    return leading


def trouble(outcome: Outcome, view: str) -> float:
    """What is left in a view under tolerance alone: misfit, and tolerance strained beyond its size."""
    return misfit(outcome, view) + outcome.fit.penalty - len(outcome.fit.coordinates)


def _left(bench: Bench, outcome: Outcome, view: str, null: Outcome) -> float:
    """Trouble that a hypothesis leaves in one of its views; next to nothing of a large misfit counts as none: forms differ a little."""
    of_view = [
        (c, theta) for c, theta in zip(outcome.fit.coordinates, outcome.fit.theta, strict=True) if c.name in bench.views[view].tolerance
    ]
    strain = sum((theta / c.spread) ** 2 - 1 for c, theta in of_view if not c.effect)
    floor = outcome.floor.get(view, 1.0) ** 2 * outcome.counts[view]
    negligible = outcome.squares[view] - floor < NEGLIGIBLE * (null.squares[view] - floor)
    return strain + (0.0 if negligible else misfit(outcome, view))


def misfit(outcome: Outcome, view: str) -> float:
    """Sum of squares beyond the floor and its own scatter, in independent samples."""
    n, length = outcome.counts[view], outcome.lengths[view]
    if n == 0:
        return 0.0
    excess = outcome.squares[view] / outcome.floor.get(view, 1.0) ** 2 - n
    return max(0.0, excess - SCATTER * math.sqrt(2 * n * FLOOR_LENGTH.get(view, length))) / length


def _candidates(
    bench: Bench, catalogue: Mapping[str, Effect], found: Search, base: Trial | None, left: set[str] | None = None
) -> Iterator[_Candidate]:
    """Every form and start of every effect that touches a view in which something is left."""
    left = found.troubled if left is None else left
    before = base.outcome if base else None
    plain = base.choice if base else Choice()
    known = found.plain | (before.values if before else {})
    for effect in catalogue.values():
        if effect.key in plain.keys:
            continue
        for declared in effect.forms[:1]:  # the others are tried where the first one leads
            form = _estimated(bench, declared, known, left)
            if form is None or _clash(plain, form):
                continue
            touched = bench.touched_by(form)
            if not set(touched) & left:
                continue
            choice = plain.plus(effect, form)
            views = tuple(v for v in bench.views if v in touched or (before is not None and v in before.views))
            own = {p.name for p in form.parameters if not p.relative}
            strained = {name for name in _strained(found, before) if any(bench.views[v].depends_on(name) for v in touched)}
            start = {name: value for name, value in known.items() if name not in own}
            eased = {name: value for name, value in start.items() if name not in strained} if strained else None
            yield _Candidate(choice, views, {}, start, before, eased)
            fresh = dict(before.values) if before is not None else {k: v for k, v in known.items() if k.startswith("valve_")}
            for starts in _starts(form.parameters):  # from the nominal plant: tolerance alone may have stuck in explaining the effect
                yield _Candidate(choice, views, starts, {name: value for name, value in fresh.items() if name not in own}, before)


def _strained(found: Search, base: Outcome | None) -> set[str]:
    """Tolerance that has stood in for an effect: further off than any rig's."""
    outcomes = [*found.null.values(), *([base] if base is not None else [])]
    return {name for outcome in outcomes for name in _strained_in(outcome.fit)}


def _strained_in(fit: Fit) -> set[str]:
    return {c.name for c, theta in zip(fit.coordinates, fit.theta, strict=True) if not c.effect and abs(theta) > STRAINED * c.spread}


def _estimated(bench: Bench, form: Form, known: Mapping[str, float], troubled: set[str]) -> Form | None:
    """A form whose parameters the data give; a converter's grid is read off the readings elsewhere."""
    if not form.estimator:
        return form
    if form.estimator == "waviness" and "contact" in troubled:
        return estimate_waviness(bench, {k: v for k, v in known.items() if k.startswith(("contact.", "sensors."))})
    if form.estimator == "delays" and "timing" in troubled:
        return estimate_delays(bench)
    return None


def _clash(base: Choice, form: Form) -> bool:
    """Two forms that set or fit the same parameter do not go together."""
    taken = set(base.parameter_names) | set(base.settings)
    return bool(taken & ({p.name for p in form.parameters} | set(form.settings)))


def _weigh(bench: Bench, found: Search, candidates: Sequence[_Candidate]) -> None:
    """What one start of each hypothesis promises; it tells for its other starts, too."""
    for candidate, promise in zip(candidates, each(lambda c: _promise(bench, found, c), candidates, bench.workers), strict=True):
        candidate.promise = promise


def _promise(bench: Bench, found: Search, c: _Candidate) -> float:
    """Fall of the objective below that of the base, or of tolerance alone, that one step from where the candidate starts promises."""
    held = c.base.views if c.base is not None else ()
    alone = (found.null[v].objective for v in c.views if v not in held)
    return sum(alone) + (c.base.objective if c.base is not None else 0.0) - bench.predict(c.choice, c.views, c.starts, c.known, c.base)


def _promising(candidates: Sequence[_Candidate], troubled: set[str]) -> list[_Candidate]:
    """The hypotheses that promise most in each troubled view."""
    chosen: list[_Candidate] = []
    for view in sorted(troubled):
        mine = [c for c in candidates if view in c.views]
        ranked = sorted((c for c in mine if c.promise < math.inf), key=lambda c: -c.promise)
        keys = list(dict.fromkeys(c.choice.keys for c in ranked if c.promise > QUIET))[:FIT_SINGLES]
        own = [c for c in ranked if troubled.intersection(c.views) == {view}]  # what others promise may be of another view
        keys += list(dict.fromkeys(c.choice.keys for c in own if c.promise > QUIET))[:FIT_OWN]
        chosen += [c for c in mine if (c.choice.keys in keys or c.promise == math.inf) and c not in chosen]
    return chosen


def _chosen(candidates: Sequence[_Candidate], most: int, leaders: Container[str]) -> list[_Candidate]:
    """The most promising hypotheses and those that add one of the leaders, all starts of each."""
    ranked = sorted((c for c in candidates if c.promise < math.inf), key=lambda c: -c.promise)
    keys = list(dict.fromkeys(c.choice.keys for c in ranked if c.promise > QUIET))[:most]
    return [c for c in candidates if c.choice.keys in keys or c.choice.keys[-1] in leaders]


def _fitted(bench: Bench, candidates: Iterable[_Candidate]) -> list[Trial]:
    """Best fit per hypothesis over its forms and starts."""
    best: dict[tuple[str, ...], Trial] = {}
    candidates = list(candidates)
    outcomes = each(lambda c: _fit(bench, c), candidates, bench.workers)
    for c, outcome in zip(candidates, outcomes, strict=True):
        held = best.get(c.choice.keys)
        if held is None or outcome.objective < held.outcome.objective:
            best[c.choice.keys] = Trial(c.choice, outcome, led=c.led)
    return list(best.values())


def _fit(bench: Bench, c: _Candidate) -> Outcome:
    """A candidate's fit; where it strains tolerance, once more from its eased start."""
    known = c.known | _first_fit(bench, c).values if c.tight else c.known
    outcome = bench.fit(c.choice, c.views, c.starts, known, c.base)
    if c.eased is not None and _strained_in(outcome.fit):
        outcome = min(outcome, bench.fit(c.choice, c.views, c.starts, c.eased, c.base), key=lambda o: o.objective)
    return outcome


def _starts(parameters: Iterable[Parameter]) -> list[dict[str, float]]:
    several = [p for p in parameters if p.starts]
    if not several:
        return []
    return [{p.name: p.starts[i] for p in several if i < len(p.starts)} for i in range(max((len(p.starts) for p in several), default=1))]


def _score(found: Search) -> None:
    """Gains with one correlation length per view, that of the hypothesis which leaves least."""
    lengths = {view: outcome.lengths[view] for view, outcome in found.null.items()}
    least = {view: outcome.squares[view] for view, outcome in found.null.items()}
    trials = found.singles + found.pairs
    for trial in trials:
        for view in trial.outcome.views:
            if trial.outcome.squares[view] < least[view]:
                least[view], lengths[view] = trial.outcome.squares[view], trial.outcome.lengths[view]
    found.lengths = lengths
    for trial in trials:
        trial.gain = sum(found.null[v].evidence(lengths) for v in trial.outcome.views) - trial.outcome.evidence(lengths)
    found.singles.sort(key=lambda t: -t.gain)
    found.pairs.sort(key=lambda t: -t.gain)


def advantage(found: Search, better: Outcome, worse: Outcome | None) -> float:
    """Evidence of one hypothesis over another (None: tolerance alone), counted in stretches of the logs that agree on it.

    A difference of -2 log likelihood of the size G that every stretch bears out has the spread 2 sqrt(G); one that comes from few
    stretches (a break-away that one of the two happens to miss) has a larger one and is worth the G that has the same ratio to its spread.
    Each view's evidence is cut by itself.
    Occam factors are cut down with it. What tolerance is strained less is not, unless the likelihood says the contrary: a fit strains
    tolerance for a likelihood that is not cut.
    """
    whole, cut, relief, occam = 0.0, 0.0, 0.0, 0.0
    for view, nothing in found.null.items():
        a = better if view in better.views else nothing
        b = worse if worse is not None and view in worse.views else nothing
        if a is not b:
            difference = b.surprise(view, found.lengths[view]) - a.surprise(view, found.lengths[view])
            whole, cut = whole + float(difference.sum()), cut + strength(difference)
    for outcome, sign in ((better, -1.0), (worse, 1.0)):
        if outcome is not None:
            relief += sign * (outcome.fit.penalty - sum(found.null[v].fit.penalty for v in outcome.views))
            occam += sign * (outcome.volume() - sum(found.null[v].volume() for v in outcome.views))
    share = min(max(cut / whole, 0.0), 1.0) if abs(whole) > 1e-9 else 1.0
    return cut + share * occam + (relief if cut * relief >= 0 else share * relief)


def strength(differences: Array) -> float:
    """Sum of the differences, cut down to what their spread over the stretches lets it be worth; keeps its sign."""
    return float(differences.sum()) * borne_out(differences)


def borne_out(differences: Array) -> float:
    """Share of a sum of differences that its spread over the stretches lets stand."""
    total, spread = abs(float(differences.sum())), float(differences @ differences)
    return min(1.0, 4.0 * total / spread) if spread > 0 else 1.0


def excess(outcome: Outcome, view: str) -> Array:
    """Sum of squares beyond the floor, stretch by stretch, in independent samples; what stands out of the stretches is cut to their top."""
    n, blocks = outcome.counts[view], outcome.blocks[view]
    share = np.minimum(BLOCK, n - BLOCK * np.arange(len(blocks)))
    beyond = (blocks / outcome.floor.get(view, 1.0) ** 2 - share) / outcome.lengths[view]
    return np.minimum(beyond, np.quantile(beyond, 1 - OUTSTANDING)) if len(beyond) else beyond
