"""An answer stands where the looking for what it lacks fails."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from modelica_fmu.errors import RunError
from pneugantry.engine.rules import Rules
from pneugantry.plants.missing_term import with_missing_term


@dataclass(frozen=True)
class Told:
    notes: tuple[str, ...] = ("a note",)
    verdict: str = "unknown"


@dataclass(frozen=True)
class Answer:
    task: Any
    diagnosis: Told


@pytest.mark.parametrize("error", [RunError("the model stops"), np.linalg.LinAlgError("singular")])
def test_a_search_that_fails_leaves_the_answer_with_a_note(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*rest: object) -> None:
        raise error

    monkeypatch.setattr("pneugantry.plants.missing_term.wanted", lambda found: True)
    monkeypatch.setattr("pneugantry.learn.learn.learn", failing)
    answer: Any = Answer(SimpleNamespace(epoch=None), Told())
    found, learned = with_missing_term(answer, Rules())
    assert learned is None
    assert found.diagnosis.verdict == "unknown"
    assert found.diagnosis.notes == (
        "a note",
        f"the missing term was looked for, and that failed: {error}",
    )
