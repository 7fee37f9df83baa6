"""How large the code's parts may be: a ratchet. Lower a bound when the code allows it.

`python -m benchmarks.code_size` prints the figures. The bounds leave out the packages whose parts
are being rebuilt; theirs stand below and only ever go down.
"""

from __future__ import annotations

from collections.abc import Iterable

from benchmarks.code_size import Function, functions, longest_line, main

REBUILT = ("pneugantry/engine/", "pneugantry/plants/")
MOST_ARGUMENTS = 6
LONGEST = 75  # lines, most are below 40


def ours(found: Iterable[Function]) -> list[Function]:
    return [f for f in found if not f.file.startswith(REBUILT)]


def test_functions_take_at_most_six_arguments() -> None:
    assert [f for f in functions() if f.arguments > MOST_ARGUMENTS] == []


def test_functions_are_short() -> None:
    found = ours(functions())
    longest = max(found, key=lambda f: f.lines)
    assert longest.lines <= LONGEST, longest
    assert sum(f.lines > 40 for f in found) / len(found) < 0.03


def test_what_is_being_rebuilt_gets_no_larger() -> None:
    found = [f for f in functions() if f.file.startswith(REBUILT)]
    assert max(f.lines for f in found) <= 80


def test_lines_are_at_most_a_hundred_columns() -> None:
    length, place = longest_line()
    assert length <= 100, place


def test_the_command_prints_the_figures(capsys) -> None:  # type: ignore[no-untyped-def]
    assert main([]) == 0
    said = capsys.readouterr().out
    assert "longest functions" in said
    assert "functions with more than six arguments" in said
