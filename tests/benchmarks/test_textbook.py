"""The rule by which textbook models are held against independent solutions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import textbook
from benchmarks.textbook import Independent, Reference, compared, models, tried
from benchmarks.textbook_solutions import HAND_WRITTEN

T = np.linspace(0, 5, 501)


def stairs(t: np.ndarray) -> np.ndarray:
    return np.maximum(np.floor(t / 0.1 + 1e-9), 0)


def outcome(found: np.ndarray, exact: bool = True) -> str:
    return compared("M", T, {"k": found}, Independent("by hand", {"k": stairs}, exact)).state


def test_the_value_before_a_jump_is_as_right_as_the_one_after() -> None:
    assert outcome(stairs(T)) == "right"
    assert outcome(stairs(T - 2e-6)) == "right"


@pytest.mark.parametrize("late", [0.015, 0.1])
def test_a_jump_that_comes_late_is_wrong(late: float) -> None:
    assert outcome(stairs(T - late)) == "wrong"


def test_an_offset_and_a_variable_of_rounding_are_told_apart() -> None:
    def both(slip: float) -> str:
        values = {"k": stairs, "e": np.zeros_like}
        found = {"k": stairs(T), "e": np.full_like(T, slip)}
        return compared("M", T, found, Independent("by hand", values, True)).state

    assert both(4e-11) == "right"
    assert both(1e-6) == "wrong"
    assert outcome(stairs(T) + 0.2) == "wrong"


def test_what_nothing_is_compared_of_does_not_count_as_right() -> None:
    assert compared("M", T, {}, Independent("", {})).state == "empty"
    assert compared("M", T, {"y": T}, Independent("", {})).state == "unchecked"


def test_a_library_is_compiled_run_and_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    book = tmp_path / "Book"
    book.mkdir()
    (book / "package.mo").write_text(
        "package Book\n  model Falls\n    Real x(start = 1, fixed = true);\n  equation\n"
        "    der(x) = -x;\n  end Falls;\n  partial model Open\n    Real y;\n  end Open;\n"
        "end Book;\n"
    )
    monkeypatch.setitem(HAND_WRITTEN, "Falls", lambda stop: {"x": lambda t: np.exp(-t)})
    monkeypatch.setattr(textbook, "POINTS", 50)
    reference = Reference(book, tmp_path / "copy")
    found = [tried(name, [book], reference, tmp_path) for name in models(book, [])]
    assert [(o.model, o.state) for o in found] == [
        ("Book.Falls", "right"),
        ("Book.Open", "refused"),
    ]
    assert found[0].error is not None
    assert found[0].error < 1e-5
    assert "partial" in found[1].said
