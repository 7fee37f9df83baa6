"""Hypotheses to try: effects that touch a view in which something is left, from which starts, and
what one step of each promises.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from pneugantry.diagnosis.bench import Bench, Choice, Outcome
from pneugantry.diagnosis.delays import estimate_delays
from pneugantry.diagnosis.evidence import QUIET, Search, Trial, rough
from pneugantry.diagnosis.fit import Fit
from pneugantry.diagnosis.parallel import each
from pneugantry.diagnosis.waviness import estimate_waviness
from pneugantry.engine.catalogue import Effect, Form, Parameter

__all__ = [
    "Candidate",
    "additions",
    "chosen_seconds",
    "clash",
    "joining",
    "most_promising",
    "other_forms",
    "relieves",
    "strained_in",
    "weigh",
]

STRAINED = 4.0  # standard deviations of tolerance beyond which it stands in for an effect
FIT_SINGLES = 8  # effects per troubled view that are fitted, by what one step promises
FIT_OWN = 5  # and of those that touch no other view


@dataclass
class Candidate:
    """A hypothesis to fit: on which views, from where."""

    choice: Choice
    views: tuple[str, ...]
    starts: dict[str, float]
    known: dict[str, float]
    base: Outcome | None = None
    eased: dict[str, float] | None = (
        None  # a second start, without tolerance that has stood in for an effect
    )
    promise: float = math.inf
    tight: str = ""  # friction view on which its last effect is first fitted under a tight lead
    led: bool = False  # its start is such a fit


def additions(
    bench: Bench,
    catalogue: Mapping[str, Effect],
    found: Search,
    base: Trial | None,
    left: set[str] | None = None,
) -> Iterator[Candidate]:
    """The first form of every effect that touches a view in which something is left, from every
    start.
    """
    left = found.troubled if left is None else left
    before = base.outcome if base else None
    plain = base.choice if base else Choice()
    known = found.plain | (before.values if before else {})
    for effect in catalogue.values():
        if effect.key in plain.keys:
            continue
        form = _estimated(
            bench, effect.forms[0], known, left
        )  # the others are tried where the first one leads
        if form is None or clash(plain, form):
            continue
        touched = bench.touched_by(form)
        if not set(touched) & left:
            continue
        choice = plain.plus(effect, form)
        views = tuple(
            v for v in bench.views if v in touched or (before is not None and v in before.views)
        )
        own = {p.name for p in form.parameters if not p.relative}
        strained = {
            name
            for name in _strained(found, before)
            if any(bench.views[v].depends_on(name) for v in touched)
        }
        start = {name: value for name, value in known.items() if name not in own}
        eased = (
            {name: value for name, value in start.items() if name not in strained}
            if strained
            else None
        )
        yield Candidate(choice, views, {}, start, before, eased)
        fresh = (
            dict(before.values)
            if before is not None
            else {k: v for k, v in known.items() if k.startswith("valve_")}
        )
        told = _told_by_sensors(bench, effect, form)
        for starts in told or _starts(
            form.parameters
        ):  # from the nominal plant: tolerance alone may have stuck in explaining the effect
            yield Candidate(
                choice,
                views,
                starts,
                {name: value for name, value in fresh.items() if name not in own},
                before,
            )


def _strained(found: Search, base: Outcome | None) -> set[str]:
    """Tolerance that has stood in for an effect: further off than any rig's."""
    outcomes = [*found.null.values(), *([base] if base is not None else [])]
    return {name for outcome in outcomes for name in strained_in(outcome.fit)}


def strained_in(fit: Fit) -> set[str]:
    """Tolerance that a fit strains so far that it stands in for an effect."""
    return {
        c.name
        for c, theta in zip(fit.coordinates, fit.theta, strict=True)
        if not c.effect and abs(theta) > STRAINED * c.spread
    }


def _estimated(
    bench: Bench, form: Form, known: Mapping[str, float], troubled: set[str]
) -> Form | None:
    """A form whose parameters the data give; a converter's grid is read off the readings
    elsewhere.
    """
    if not form.estimator:
        return form
    if form.estimator == "waviness" and "contact" in troubled:
        return estimate_waviness(
            bench, {k: v for k, v in known.items() if k.startswith(("contact.", "sensors."))}
        )
    if form.estimator == "delays" and "timing" in troubled:
        return estimate_delays(bench)
    return None


def clash(base: Choice, form: Form) -> bool:
    """Two forms that set or fit the same parameter do not go together."""
    taken = set(base.parameter_names) | set(base.settings)
    return bool(taken & ({p.name for p in form.parameters} | set(form.settings)))


def _starts(parameters: Iterable[Parameter]) -> list[dict[str, float]]:
    several = [p for p in parameters if p.starts]
    if not several:
        return []
    return [
        {p.name: p.starts[i] for p in several if i < len(p.starts)}
        for i in range(max((len(p.starts) for p in several), default=1))
    ]


def _told_by_sensors(bench: Bench, effect: Effect, form: Form) -> list[dict[str, float]]:
    """Where the sensors contradict each other, without any plant, for an effect of more than that
    which needs starts: its parameters there; [] for others.
    """
    starts, touched = _starts(form.parameters), bench.touched_by(form)
    if form.estimator or not starts or "sensors" not in touched or len(touched) < 2:
        return []
    key = (effect.key, form.name)
    if key not in bench.told:
        alone = [bench.fit(Choice(((effect, form),)), ("sensors",), start) for start in starts]
        best = min(alone, key=lambda outcome: outcome.objective)
        bench.told[key] = {p.name: best.values[p.name] for p in form.parameters}
    return [bench.told[key]]


def weigh(bench: Bench, found: Search, candidates: Sequence[Candidate]) -> None:
    """What one start of each hypothesis promises; it tells for its other starts, too."""
    for candidate, promise in zip(
        candidates,
        each(lambda c: _promise(bench, found, c), candidates, bench.workers),
        strict=True,
    ):
        candidate.promise = promise


def _promise(bench: Bench, found: Search, c: Candidate) -> float:
    """Fall of the objective below that of the base, or of tolerance alone, that one step from where
    the candidate starts promises.
    """
    held = c.base.views if c.base is not None else ()
    alone = (found.null[v].objective for v in c.views if v not in held)
    return (
        sum(alone)
        + (c.base.objective if c.base is not None else 0.0)
        - bench.predict(c.choice, c.views, c.starts, c.known, c.base)
    )


def most_promising(candidates: Sequence[Candidate], troubled: set[str]) -> list[Candidate]:
    """The hypotheses that promise most in each troubled view."""
    chosen: list[Candidate] = []
    for view in sorted(troubled):
        mine = [c for c in candidates if view in c.views]
        ranked = sorted((c for c in mine if c.promise < math.inf), key=lambda c: -c.promise)
        keys = list(dict.fromkeys(c.choice.keys for c in ranked if c.promise > QUIET))[:FIT_SINGLES]
        own = [
            c for c in ranked if c.views == (view,)
        ]  # what others promise may be of another view
        keys += list(dict.fromkeys(c.choice.keys for c in own if c.promise > QUIET))[:FIT_OWN]
        chosen += [
            c for c in mine if (c.choice.keys in keys or c.promise == math.inf) and c not in chosen
        ]
    return chosen


def chosen_seconds(
    candidates: Sequence[Candidate], most: int, leaders: Container[str]
) -> list[Candidate]:
    """The most promising hypotheses, those that add one of the leaders and those that free
    tolerance which their base strains, all starts of each.
    """
    ranked = sorted((c for c in candidates if c.promise < math.inf), key=lambda c: -c.promise)
    keys = list(dict.fromkeys(c.choice.keys for c in ranked if c.promise > QUIET))[:most]
    return [
        c
        for c in candidates
        if c.choice.keys in keys or c.choice.keys[-1] in leaders or relieves(c)
    ]


def relieves(c: Candidate) -> bool:
    """Whether the last effect frees tolerance that stands in for an effect in its base."""
    _, form = c.choice.effects[-1]
    return c.base is not None and bool(strained_in(c.base.fit) & {p.name for p in form.parameters})


def joining(bench: Bench, base: Trial, second: Trial) -> Iterator[Candidate]:
    """Two single effects as a pair, from the first one's values and the second one's."""
    effect, form = second.choice.effects[0]
    if effect.key not in base.choice.keys and not clash(base.choice, form):
        views = tuple(
            v for v in bench.views if v in base.outcome.views or v in second.outcome.views
        )
        own = {
            name: base.outcome.values[name] for name in base.choice.parameter_names
        }  # which may be a tolerance of the second one's view
        yield Candidate(
            base.choice.plus(effect, form),
            views,
            {},
            base.outcome.values | second.outcome.values | own,
            base.outcome,
        )


def other_forms(bench: Bench, trial: Trial, i: int) -> Iterator[Candidate]:
    """The other forms of a trial's effect `i`; where its plain form may have led astray, also from
    the form's own starts alone.
    """
    effect, held = trial.choice.effects[i]
    last = i == len(trial.choice.effects) - 1  # a pair's first effect has been through this alone
    astray = last and any(rough(trial.outcome, view) for view in trial.outcome.views)
    for form in (
        effect.forms if trial.led else effect.forms[1:]
    ):  # led tightly not only the plain form was tried
        rest = Choice(tuple(pair for j, pair in enumerate(trial.choice.effects) if j != i))
        if form.name == held.name or form.estimator or clash(rest, form):
            continue
        choice = Choice(
            tuple((effect, form) if j == i else pair for j, pair in enumerate(trial.choice.effects))
        )
        views = tuple(
            v for v in bench.views if v in set(bench.touched_by(form)) | set(trial.outcome.views)
        )
        own = {p.name for p in (*held.parameters, *form.parameters)}
        told = _told_by_sensors(bench, effect, form)
        dropped = {*held.settings, *form.settings, *(own if told else ())}
        for starts in told or _starts(form.parameters) or [{}]:
            known = {k: v for k, v in trial.outcome.values.items() if k not in dropped}
            yield Candidate(choice, views, starts, starts | known, trial.outcome)
            if astray and not told:
                others = {k: v for k, v in known.items() if k not in own}
                own_view = (
                    views[0]
                    if len(choice.effects) == 1
                    and len(views) == 1
                    and views[0].startswith("friction")
                    else ""
                )
                yield Candidate(
                    choice, views, starts, others | starts, trial.outcome, tight=own_view
                )
