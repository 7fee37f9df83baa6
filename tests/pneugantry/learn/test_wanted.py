"""When a missing term is looked for, and what an accepted one does to another answer."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pneugantry.engine.answer.result import Cause, Diagnosis
from pneugantry.engine.chances import Chances
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.foreign import ForeignPlant
from pneugantry.learn.answer.answer import answered
from pneugantry.learn.wanted import wanted

RECORD: Any = SimpleNamespace(name="steps", signals={"v": np.zeros(3)})


def found(stands_out: float, unknown: float = 0.04, plant: Any = None) -> Any:
    """An answer with one effect that leaves so much beyond the noise."""
    plant = plant or SimpleNamespace(signals=[SimpleNamespace(name="v")])
    task = SimpleNamespace(plant=plant, chances=Chances(), data=SimpleNamespace(fitted=[RECORD]))
    return SimpleNamespace(
        task=task,
        diagnosis=SimpleNamespace(stands_out=stands_out),
        decision=SimpleNamespace(unknown=unknown, imitated=0.0),
    )


def test_what_would_be_unknown_beside_no_effect_is_looked_into() -> None:
    assert not wanted(found(0.08))
    assert wanted(found(0.25))
    assert wanted(found(0.08, unknown=0.3))


def test_an_fmu_without_source_has_no_term_to_look_for() -> None:
    foreign: Any = ForeignPlant.__new__(ForeignPlant)
    assert not wanted(found(0.25, plant=foreign))


@dataclass(frozen=True)
class Before:
    """What an answer with a term reads of the one before."""

    diagnosis: Diagnosis
    search: Any = field(default_factory=lambda: SimpleNamespace(null=FIT))
    nominal: Any = None
    augmented: Any = None
    gap: Any = None
    learnt: Any = None


FIT: Any = SimpleNamespace(stretches={}, evidence=0.0)
BIAS = Cause("bias", "", 0.9, {})
AFTER = Diagnosis("none", (), (), ((),))


def with_term(verdict: str, *, accepted: bool) -> Diagnosis:
    told = Diagnosis(
        verdict,
        where=(),
        causes=(BIAS,),
        answer_set=(("bias",), ()),
        next_experiment={"what": "again"},
        probabilities={"none": 0.05, "unknown": 0.06},
    )
    after = SimpleNamespace(
        diagnosis=AFTER, gap=None, augmented=None, search=SimpleNamespace(null=FIT)
    )
    best = SimpleNamespace(term=SimpleNamespace(block="axis"))
    learned: Any = SimpleNamespace(
        before=Before(told), after=after, best=best, accepted=accepted, probability=0.98
    )
    return answered(learned, Rules()).diagnosis


@pytest.mark.parametrize("verdict", ["identified", "ambiguous", "none"])
def test_an_accepted_term_takes_the_place_of_what_stood_in_for_it(verdict: str) -> None:
    told = with_term(verdict, accepted=True)
    assert told.verdict == "unknown"
    assert told.probabilities["unknown"] == 0.98
    assert told.probabilities["none"] == pytest.approx(0.02)
    assert told.causes == ()
    assert told.answer_set == (("unknown",),)
    assert told.next_experiment is None
    assert told.notes == (f"without the learnt term the answer was {verdict}: bias, or no effect",)


def test_a_term_that_is_not_accepted_leaves_the_answer() -> None:
    told = with_term("identified", accepted=False)
    assert (told.verdict, told.causes, told.notes) == ("identified", (BIAS,), ())
