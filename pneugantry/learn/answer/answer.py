"""What a diagnosis says once a missing term is learnt: a plant without the term bends known effects
and views to what it lacks, so that where something is and what is beside it come from the plant
with the term.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pneugantry.engine.answer.confirm import Gap, gap_of, shrink_of
from pneugantry.engine.answer.decide import UNKNOWN
from pneugantry.engine.answer.location import Place
from pneugantry.engine.answer.result import Diagnosis
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found
from pneugantry.learn.learned import Learned

__all__ = ["answered"]

LARGE = 0.15  # share of what a term explains from which on a record is named


def answered(learned: Learned, rules: Rules) -> Found:
    """The diagnosis that a term was looked for in; where the term is accepted, that something is
    unknown, with the effects, places and gap that the plant with the term has.
    """
    before, after, best = learned.before, learned.after, learned.best
    if after is None or best is None or not learned.accepted:
        return before
    told = _unknown(before.diagnosis, learned.probability)
    gap, new = _gap(before, after, rules), after.diagnosis
    places = _places(_place(before, after, best.term.block), new.where)
    diagnosis = replace(
        told,
        where=places,
        causes=new.causes,
        answer_set=tuple(dict.fromkeys(_beside(keys) for keys in new.answer_set)),
        gap=gap,
        closed_loop=_in_loop(told, new),
        notes=tuple(dict.fromkeys((*told.notes, *new.notes))),
    )
    return replace(before, diagnosis=diagnosis, augmented=after.augmented, gap=gap, learnt=after)


def _unknown(told: Diagnosis, probability: float) -> Diagnosis:
    """An answer in which an accepted term, of some probability, is what is unknown; where it was
    another one, a note says which.
    """
    if told.verdict == UNKNOWN:
        return told
    without = ", or ".join(" + ".join(keys) or "no effect" for keys in told.answer_set)
    before = told.probabilities
    unknown = max(probability, before.get(UNKNOWN, 0.0))
    none = min(before.get("none", 0.0), 1 - unknown)
    return replace(
        told,
        verdict=UNKNOWN,
        next_experiment=None,
        probabilities={**before, "none": none, UNKNOWN: unknown},
        notes=(*told.notes, f"without the learnt term the answer was {told.verdict}: {without}"),
    )


def _beside(keys: tuple[str, ...]) -> tuple[str, ...]:
    """A hypothesis about the plant with the term, as one about the plant without it."""
    return keys if UNKNOWN in keys else (*keys, UNKNOWN)


def _gap(before: Found, after: Found, rules: Rules) -> Gap | None:
    """From the nominal plant to that with the term and all that is known."""
    if before.nominal is None or after.augmented is None or after.gap is None:
        return after.gap
    whole = gap_of(
        before.nominal, after.augmented, rules, after.augmented.period, floor=after.gap.floor
    )
    return replace(whole, spread=after.gap.spread, open=after.gap.open)


def _place(before: Found, after: Found, block: str) -> Place:
    """What the term explains, tolerance alone beside it."""
    old, new = before.search.null, after.search.null
    falls: dict[str, float] = {}
    for (_, record), cost in old.stretches.items():
        falls[record] = falls.get(record, 0.0) + float(cost.sum())
    for (_, record), cost in new.stretches.items():
        falls[record] -= float(cost.sum())
    whole = sum(max(f, 0.0) for f in falls.values())
    records = [r for r in sorted(falls, key=lambda r: -falls[r]) if falls[r] > LARGE * whole]
    own = [p for p in before.diagnosis.where if p.block == block] or before.diagnosis.where
    gain = max(old.evidence - new.evidence, 0.0)
    return Place(block, 1.0, tuple(records), own[0].regime if own else "", gain, 0.0)


def _places(term: Place, others: Sequence[Place]) -> tuple[Place, ...]:
    """With the term's place among those of the plant that has it."""
    found = {p.block: p for p in others}
    if term.block in found:
        same = found[term.block]
        explained = same.explained + term.explained
        records = tuple(dict.fromkeys((*term.records, *same.records)))
        term = replace(term, records=records, explained=explained, left=same.left)
    found[term.block] = term
    whole = max(sum(p.explained + p.left for p in found.values()), 1e-300)
    shared = [replace(p, share=(p.explained + p.left) / whole) for p in found.values()]
    return tuple(sorted(shared, key=lambda p: -p.share))


def _in_loop(told: Diagnosis, new: Diagnosis) -> dict[str, float] | None:
    """The experiment run again with its controller: on the nominal plant, on that with the term."""
    if told.closed_loop is None or new.closed_loop is None:
        return None
    found = {**new.closed_loop, "nominal": told.closed_loop["nominal"]}
    shrink = shrink_of(found["nominal"], found["augmented"], found["floor"])
    return {**found, "shrink": shrink}
