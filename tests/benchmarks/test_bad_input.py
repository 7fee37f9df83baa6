"""Bad input and special files end in one line and destroy nothing; and the command that looks for
it sees what does not.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from benchmarks.bad_input import CASES, Case, link, main, put, tried

pytestmark = pytest.mark.skipif(os.name != "posix", reason="links, pipes and devices of POSIX")
SHORT = ("result: a pipe", "result: /dev/full", "result: a link", "log: endless", "plant: none")


@pytest.mark.parametrize("kind", SHORT)
def test_a_special_file_is_met_rightly(kind: str, tmp_path: Path) -> None:
    (case,) = (case for case in CASES if case.kind == kind)
    assert tried(case, tmp_path).wrong == ""


@pytest.mark.slow
def test_every_case_is_met_rightly(tmp_path: Path) -> None:
    assert main(["--json", str(tmp_path / "table.json")]) == 0
    table = json.loads((tmp_path / "table.json").read_text(encoding="utf-8"))["cases"]
    assert len(table) == len(CASES) >= 12


def test_what_is_destroyed_is_seen(tmp_path: Path) -> None:
    """A shell stands in for a command that replaces a link by a file."""
    made = (put("a", "kept"), link("l", "a"))
    case = Case("a link", "--version", made, code=0, shell="> new; mv new l")
    wrong = tried(case, tmp_path).wrong
    assert wrong == "changed ['l'], expected []"


def test_a_wrong_exit_code_and_a_missing_line_are_seen(tmp_path: Path) -> None:
    wrong = tried(Case("no error", "--version", says="cannot"), tmp_path).wrong
    assert "exit code 0, expected 2" in wrong
    assert "0 lines, expected one" in wrong
    assert "does not say 'cannot'" in wrong


def test_a_case_that_waits_for_ever_is_ended(tmp_path: Path) -> None:
    case = Case("a pipe without a reader", "--version", shell="; sleep 60")
    assert tried(case, tmp_path, seconds=0.5).wrong == "did not end within 0.5 s"
