"""Which effects: tolerance first, then every effect of the catalogue where something is left, then pairs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from diagnosis.bench import Bench, Choice, Outcome
from diagnosis.catalogue import Effect, Form, Parameter
from diagnosis.waviness import estimate_waviness

__all__ = ["QUIET", "Search", "Trial", "misfit", "search"]

SCATTER = 3.0  # standard deviations of the floor's sum of squares
QUIET = 8.0  # what a view's misfit and strained tolerance may hold together without asking for an effect
FIT_SINGLES = 4  # hypotheses per troubled view that are fitted in full, by what one step promises
BASES = 2  # single effects that pairs within the same views are built on
RIVAL = 0.85  # share of the best gain from which on another single effect is a base too
FIT_PAIRS = 3
FIT_FRICTION = 4
NEGLIGIBLE = 0.02  # share of a view's misfit that may stay without asking for a second effect
STILL = 1.2  # RMS of an axis' friction windows up to which its friction is not asked about, if the other axis' is worse
WORTH = 0.02  # share of the misfit that a step must promise to be worth a fit
REFINED = 2  # leading trials that are fitted to the end


@dataclass
class Trial:
    """A hypothesis with its gain over tolerance alone: difference of -2 log evidence, larger is better."""

    choice: Choice
    outcome: Outcome
    gain: float = 0.0


@dataclass
class Search:
    """All that was tried."""

    null: dict[str, Outcome]  # by view: tolerance alone
    troubled: set[str]
    singles: list[Trial] = field(default_factory=list)
    pairs: list[Trial] = field(default_factory=list)
    lengths: dict[str, float] = field(default_factory=dict)


@dataclass
class _Candidate:
    choice: Choice
    views: tuple[str, ...]
    starts: dict[str, float]
    known: dict[str, float]
    promise: float
    base: Outcome | None = None


def search(bench: Bench, catalogue: Mapping[str, Effect]) -> Search:
    null = bench.settle_valves()
    valves, early = _valves(bench, catalogue, null)
    bench.drive(valves)
    starters = {name: null[name] for name in ("friction_x", "friction_z", "contact")}
    null["mechanics"] = bench.settle_mechanics(null)
    found = Search({name: null[name] for name in bench.views}, set(), early)
    found.troubled = _troubled(found)
    others = {key: effect for key, effect in catalogue.items() if not effect.block.startswith("valve")}
    found.singles += _added(bench, others, found, starters, None)
    _renull(bench, found)
    _refine(bench, found, found.singles)
    for base in [t for t in found.singles if t.gain > max(QUIET, RIVAL * found.singles[0].gain)][:BASES]:
        found.pairs += _added(bench, catalogue, found, starters, base)
    _score(found)
    _refine(bench, found, found.pairs)
    return found


def _troubled(found: Search) -> set[str]:
    return {name for name, outcome in found.null.items() if trouble(outcome, name) > QUIET}


def _added(
    bench: Bench, catalogue: Mapping[str, Effect], found: Search, starters: Mapping[str, Outcome], base: Trial | None
) -> list[Trial]:
    """Hypotheses that add one effect to `base`, fitted on all views that they touch."""
    known = {name: value for outcome in [*found.null.values(), *starters.values()] for name, value in outcome.values.items()}
    if base is None:
        left = set(found.troubled)
    else:
        mine = set(base.outcome.views)
        left = {v for v in found.troubled if v not in mine} | {v for v in mine if _left(bench, base.outcome, v, found.null[v]) > QUIET}
        known |= base.outcome.values
    if not left:
        return []
    rest = {key: effect for key, effect in catalogue.items() if not effect.block.startswith("friction")}
    before = base.outcome if base else None
    candidates = list(_candidates(bench, rest, base.choice if base else Choice(), left, known, before))
    outcomes = {v: (before if before is not None and v in before.views else found.null[v]) for v in left}
    least = WORTH * min(max(o.squares[v] - o.floor.get(v, 1.0) ** 2 * o.counts[v], 0.0) + o.fit.penalty for v, o in outcomes.items())
    candidates = [c for c in candidates if c.promise > max(least, QUIET)]
    trials = _fitted(bench, _chosen(candidates, left, FIT_SINGLES if base is None else FIT_PAIRS))
    return trials + _friction(bench, catalogue, left, starters, known, base)


def _renull(bench: Bench, found: Search) -> None:
    """Tolerance alone once more from where the best hypotheses have left it: a fit that had stuck must not count for them."""
    _score(found)
    for trial in [t for t in found.singles if "mechanics" in t.outcome.views][:2]:
        again = bench.fit(Choice(), ("mechanics",), start_values=trial.outcome.values)
        if (
            again.squares["mechanics"] + again.fit.penalty
            < found.null["mechanics"].squares["mechanics"] + found.null["mechanics"].fit.penalty
        ):
            found.null["mechanics"] = again
    found.troubled = _troubled(found)
    _score(found)


def _valves(bench: Bench, catalogue: Mapping[str, Effect], null: Mapping[str, Outcome]) -> tuple[dict[str, Outcome], list[Trial]]:
    """Each valve on its own: the best outcome, to drive the mechanics with, and all trials."""
    best, trials = {}, []
    for axis in "xz":
        name = f"valve_{axis}"
        best[name] = null[name]
        if trouble(null[name], name) <= QUIET:
            continue
        own = {key: effect for key, effect in catalogue.items() if effect.block == name}
        candidates = list(_candidates(bench, own, Choice(), {name}, null[name].values))
        fitted = _fitted(bench, _chosen(candidates, {name}, FIT_SINGLES), careful=True)
        trials += fitted
        best[name] = min([null[name], *(t.outcome for t in fitted)], key=lambda outcome: outcome.squares[name])
    return best, trials


def _friction(
    bench: Bench, catalogue: Mapping[str, Effect], troubled: set[str], starters: Mapping[str, Outcome], known: Mapping[str, float],
    base: Trial | None,
) -> list[Trial]:  # fmt: skip
    """Friction effects: ranked on the short windows of their axis, where no missed break-away misleads, then fitted on the mechanics."""
    if "mechanics" not in troubled:
        return []
    before = base.outcome if base else None
    choice = base.choice if base else Choice()
    same_law: list[tuple[float, Outcome]] = []
    other_law: list[Outcome] = []
    for axis in "xz":
        name = f"friction_{axis}"
        if starters[name].counts[name] == 0 or (base is None and _still(starters, axis)):
            continue
        own = {key: effect for key, effect in catalogue.items() if effect.block == name}
        strained = {**starters[name].values, **choice_values(before)}
        start = choice_values(before)  # tolerance alone may have stuck in explaining the effect
        candidates = list(_candidates(bench, own, choice, {name}, start, before, within=(name,)))
        for trial in _fitted(bench, [c for c in candidates if not _new_law(c.choice)]):
            same_law.append((windows_gain(starters[name], trial.outcome, name), trial.outcome))
        if base is None:  # windows tell little of another law: each of its forms goes on to the mechanics
            lawed = [c for c in _candidates(bench, own, choice, {name}, strained, within=(name,)) if _new_law(c.choice)]
            other_law += [bench.fit(c.choice, c.views, c.starts, c.known) for c in lawed]
    same_law.sort(key=lambda item: -item[0])
    chosen = []
    for outcome in [*(o for _, o in same_law[: FIT_FRICTION if base is None else FIT_PAIRS]), *other_law]:
        views = set(bench.touched(outcome.choice.parameter_names + tuple(outcome.choice.settings))) | set(before.views if before else ())
        ordered = tuple(v for v in bench.views if v in views)
        values = {**known, **starters["contact"].values, **outcome.values, **choice_values(before)}
        chosen.append(_Candidate(outcome.choice, ordered, {}, values, math.inf, before))
    return _fitted(bench, chosen)


def _new_law(choice: Choice) -> bool:
    """Whether the effect added last sets another law."""
    return bool(choice.effects[-1][1].settings)


def choice_values(outcome: Outcome | None) -> dict[str, float]:
    """Fitted values of a hypothesis' own effects."""
    if outcome is None:
        return {}
    names = set(outcome.choice.parameter_names)
    return {name: value for name, value in outcome.values.items() if name in names}


def _still(starters: Mapping[str, Outcome], axis: str) -> bool:
    """Whether an axis' friction windows are quiet while the other's are not."""
    own, other = (starters[f"friction_{a}"] for a in (axis, "z" if axis == "x" else "x"))
    mine, theirs = own.rms(f"friction_{axis}"), other.rms(other.views[0])
    return mine < STILL < theirs and own.fit.penalty < 5 * len(own.fit.coordinates)


def windows_gain(null: Outcome, outcome: Outcome, view: str) -> float:
    """Gain on one view, with the correlation length under tolerance alone for all."""
    lengths = {view: null.lengths[view]}
    return null.evidence(lengths) - outcome.evidence(lengths)


def _refine(bench: Bench, found: Search, trials: list[Trial]) -> None:
    """The leading trials fitted to the end."""
    for trial in trials[:REFINED]:
        o = trial.outcome
        trial.outcome = bench.fit(trial.choice, o.views, start_values=o.values, base=o, careful=True)
    _score(found)


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
    return max(0.0, excess - SCATTER * math.sqrt(2 * n * length)) / length


def _candidates(
    bench: Bench, catalogue: Mapping[str, Effect], base: Choice, troubled: set[str], known: Mapping[str, float],
    before: Outcome | None = None, within: tuple[str, ...] | None = None,
) -> Iterator[_Candidate]:  # fmt: skip
    """Every form and start of every effect that touches a troubled view, with what it promises."""
    for effect in catalogue.values():
        if effect.key in base.keys:
            continue
        for declared in effect.forms:
            form = _estimated(bench, declared, known, troubled)
            if form is None:
                continue
            choice = base.plus(effect, form)
            views = bench.touched(choice.parameter_names + tuple(choice.settings))
            views = tuple(v for v in bench.views if v in views or (before is not None and v in before.views))
            touched = within or bench.touched([p.name for p in form.parameters])
            if not set(touched) & troubled or _clash(base, form):
                continue
            views = within or views
            values = {name: value for name, value in known.items() if name not in {p.name for p in form.parameters if not p.relative}}
            for starts in _starts(form.parameters):
                promise = (
                    math.inf if form.settings or form.estimator or within else bench.predict(choice, views, starts, values, before)
                )  # another law has no small step
                yield _Candidate(choice, views, starts, values, promise, before)


def _estimated(bench: Bench, form: Form, known: Mapping[str, float], troubled: set[str]) -> Form | None:
    """A form whose parameters the data give; a converter's grid is read off the readings elsewhere."""
    if not form.estimator:
        return form
    if form.estimator == "waviness" and "contact" in troubled:
        return estimate_waviness(bench, {k: v for k, v in known.items() if k.startswith(("contact.", "sensors."))})
    return None


def _clash(base: Choice, form: Form) -> bool:
    """Two forms that set or fit the same parameter do not go together."""
    taken = set(base.parameter_names) | set(base.settings)
    return bool(taken & ({p.name for p in form.parameters} | set(form.settings)))


def _chosen(candidates: list[_Candidate], troubled: set[str], most: int) -> list[_Candidate]:
    """The most promising hypotheses of each troubled view; of one effect's forms and starts the better half."""
    chosen: dict[int, _Candidate] = {}
    for view in troubled:
        ranked = sorted((c for c in candidates if view in c.views), key=lambda c: -c.promise)
        keys: list[tuple[str, ...]] = []
        for candidate in ranked:
            if candidate.choice.keys not in keys and candidate.promise < math.inf:
                keys.append(candidate.choice.keys)
            if len(keys) > most:
                break
            chosen[id(candidate)] = candidate
    return list(chosen.values())


def _fitted(bench: Bench, candidates: Iterable[_Candidate], careful: bool = False) -> list[Trial]:
    """Best fit per hypothesis over its forms and starts."""
    best: dict[tuple[str, ...], Trial] = {}
    for c in candidates:
        outcome = bench.fit(c.choice, c.views, c.starts, c.known, c.base, careful)
        held = best.get(c.choice.keys)
        if held is None or outcome.objective < held.outcome.objective:
            best[c.choice.keys] = Trial(c.choice, outcome)
    return list(best.values())


def _starts(parameters: Iterable[Parameter]) -> list[dict[str, float]]:
    several = [p for p in parameters if p.starts]
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
        nothing = sum(found.null[v].evidence(lengths) for v in trial.outcome.views)
        trial.gain = nothing - trial.outcome.evidence(lengths)
    found.singles.sort(key=lambda t: -t.gain)
    found.pairs.sort(key=lambda t: -t.gain)
