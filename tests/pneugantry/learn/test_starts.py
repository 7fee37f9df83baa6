"""Where the fit of a term begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any, cast

import pytest

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.learn.fitting.joint import TermFits
from pneugantry.learn.learned import Tried
from pneugantry.learn.terms.term import Term

STARTS = {"p1": 0.5}
TERM = cast(Term, SimpleNamespace(starts=STARTS, effect=SimpleNamespace(forms=("law",))))


class Hypotheses:
    def plus(self, effect: object, form: object) -> str:
        return "beside the term"


class Begun(TermFits):
    """Fits that only say where they began. bent: what tolerance has far off."""

    bent: set[str]
    begun: list[Mapping[str, float]]

    def misreading(self, term: Term) -> None:
        return None

    def fitter(self, term: Term) -> Fitter:
        def explore(hypothesis: str, base: Fit, starts: Sequence[Mapping[str, float]]) -> str:
            self.begun.extend(starts)
            return hypothesis

        own = SimpleNamespace(far_off=lambda base: self.bent, explore=explore, close=lambda: None)
        return cast(Fitter, own)

    def tried(self, term: Term, fit: Fit) -> Tried:
        return Tried(term, fit, 0.0)


@pytest.mark.parametrize("bent", [set[str](), {"m"}])
def test_a_fit_begins_at_the_description_too_where_tolerance_is_bent(bent: set[str]) -> None:
    base = cast(Fit, SimpleNamespace(hypothesis=Hypotheses(), nominal={"m": 2.0, "K": 40.0}))
    fits = Begun(cast(Any, None), cast(Any, None), cast(Any, None), 1.0)
    object.__setattr__(fits, "bent", bent)
    object.__setattr__(fits, "begun", [])
    fits.joint(base, TERM, {"m": 2.9, "drag": 0.3})
    there = {"m": 2.9, "drag": 0.3, "p1": 0.5}
    assert fits.begun == [there, *([{**there, "m": 2.0, "K": 40.0}] if bent else [])]
