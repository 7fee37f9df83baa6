"""Which terms the records tell apart."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pneugantry.engine.answer.predict import PredictiveScore
from pneugantry.engine.rules import Rules
from pneugantry.learn.fitting.rivals import Rivals

CELL = ("view", "log")
FITS: Any = SimpleNamespace(rules=Rules())


@dataclass(frozen=True, eq=False)
class Term:
    """What is read of a fitted term."""

    fit: Any
    cost: float


def term(stretches: list[float], occam: float) -> Any:
    """A fitted term with -2 log likelihoods of its stretches, and what Occam's factor adds."""
    found = np.array(stretches)
    cost = float(found.sum()) + occam
    return Term(SimpleNamespace(stretches={CELL: found}), cost)


@pytest.mark.parametrize(
    ("likelihood", "occam", "told"),
    [
        ([0.0] * 8, 3.0, False),  # the same but for a little of Occam's factor
        ([0.0] * 8, 30.0, True),
        ([-3.0, 0.0, 0.0, -3.0, 0.0, -3.0, 0.0, 0.0], 11.5, False),  # the other fits better
        ([9.0, 8.0, 9.0, 8.0, 9.0, 8.0, 9.0, 8.0], 0.0, True),  # in every stretch
        ([40.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.0, False),  # in one alone
    ],
)
def test_terms_are_told_apart_by_no_more_than_their_evidence(
    likelihood: list[float], occam: float, told: bool
) -> None:
    a, b = term([0.0] * 8, 0.0), term(likelihood, occam)
    scores = {t: PredictiveScore() for t in (a, b)}
    assert Rivals(FITS).tells(a, b, scores) == told
