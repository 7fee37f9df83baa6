"""First fits of friction effects on tightly led carriages, which no missed break-away leads
astray.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from pneugantry.diagnosis.bench import Bench, Choice, Outcome
from pneugantry.diagnosis.candidates import Candidate, clash
from pneugantry.diagnosis.evidence import Trial
from pneugantry.diagnosis.parallel import each
from pneugantry.engine.catalogue import Form

__all__ = ["first_fit", "is_of", "large_misfits", "tightly_led"]

# RMS over the floor from which on it is: led loosely, so bad a carriage misses break-aways, and
# slopes lead astray
LARGE = 1.3
FEW = 3  # parameters of a form that is tried besides the plain one
LEADS = (
    0.1,
    0.3,
)  # shares of the usual time in which carriages are led for such a first fit, one after the other


def tightly_led(
    bench: Bench, candidates: Sequence[Candidate], views: Sequence[str], base: Trial | None
) -> list[Candidate]:
    """Candidates whose last effect is of one of these friction views alone, by view and by what
    they leave under a tight lead, starting from the values that they have there.

    Tightly led no simulated carriage sticks where the measured one moves: the misfit is smooth as
    far as any effect reaches.
    """
    result: list[Candidate] = []
    for view in views:
        held = (
            _held(bench, base.choice, base.outcome.values, view) if base is not None else Choice()
        )
        values = _tight(bench, held, view, {}, {}).values  # its Jacobian of tolerance serves all
        mine = [
            replace(c, tight=view, known=c.known | values)
            for c in candidates
            if is_of(bench, c.choice.effects[-1][1], view)
        ]
        mine = [
            c for c in mine if not c.starts or c.choice.effects[-1][1].settings
        ]  # nothing but another law needs several starts there
        mine += [other for c in mine for other in _other_forms(bench, c)]
        outcomes = each(lambda c: first_fit(bench, c), mine, bench.workers)
        lengths = min(outcomes, key=lambda o: o.objective).lengths if outcomes else {}
        best: dict[tuple[str, ...], tuple[Outcome, Candidate]] = {}
        for c, outcome in zip(
            mine, outcomes, strict=True
        ):  # by evidence: a law that contains another one leaves less anyway
            held_so_far = best.get(c.choice.keys)
            if held_so_far is None or outcome.evidence(lengths) < held_so_far[0].evidence(lengths):
                best[c.choice.keys] = (outcome, c)
        ranked = sorted(best.values(), key=lambda entry: entry[0].objective)
        result += [
            replace(c, tight="", led=True, eased=None, starts={}, known=c.known | o.values)
            for o, c in ranked
        ]
    return result


def _other_forms(bench: Bench, c: Candidate) -> list[Candidate]:
    """The candidate with the other laws that its last effect may have, in the plain one nothing may
    tell of it, and with its other forms of a few parameters: the plain one may stick far from the
    right one, whose start it would be.
    """
    effect, held = c.choice.effects[-1]
    rest = Choice(c.choice.effects[:-1])
    others = [
        form
        for form in effect.forms
        if form.name != held.name and not clash(rest, form) and is_of(bench, form, c.tight)
    ]
    return [
        replace(c, choice=rest.plus(effect, form), starts={})
        for form in others
        if form.settings or len(form.parameters) <= FEW
    ]


def large_misfits(left: Mapping[str, Outcome]) -> list[str]:
    """Friction views in which so much is left that a loosely led carriage tells little."""
    return sorted(
        v
        for v, o in left.items()
        if v.startswith("friction") and o.rms(v) > LARGE * o.floor.get(v, 1.0)
    )


def is_of(bench: Bench, form: Form, view: str) -> bool:
    """Whether a form touches this view and no other."""
    return bench.touched_by(form) == (view,)


def first_fit(bench: Bench, c: Candidate) -> Outcome:
    """The candidate on its tightly led view alone, its other effects held, but for those that are a
    tolerance's.
    """
    others = _held(bench, Choice(c.choice.effects[:-1]), c.known, "")
    return _tight(
        bench,
        others.plus(*c.choice.effects[-1]),
        c.tight,
        c.starts,
        {name: c.known[name] for name in others.parameter_names},
    )


def _held(bench: Bench, choice: Choice, values: Mapping[str, float], free: str) -> Choice:
    """Effects set to their values, but for those of the view `free` and those that are a
    tolerance's, which are fitted anyway.
    """
    result = []
    tolerance = {name for view in bench.views.values() for name in view.tolerance}
    for effect, form in choice.effects:
        if not is_of(bench, form, free) and not any(p.name in tolerance for p in form.parameters):
            form = replace(
                form,
                parameters=(),
                settings={**form.settings, **{p.name: values[p.name] for p in form.parameters}},
            )
        result.append((effect, form))
    return Choice(tuple(result))


def _tight(
    bench: Bench, choice: Choice, view: str, starts: Mapping[str, float], known: Mapping[str, float]
) -> Outcome:
    """A fit of one friction view under one tight lead after the other."""
    for share in LEADS:
        with bench.led_tighter((view,), share):
            outcome = bench.fit(choice, (view,), starts, known)
        known = outcome.values
    return outcome
