"""Plain words: terms that a stranger would have to be told appear nowhere."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (
    "modelica_fmu",
    "pyfmi_runner",
    "controllers",
    "pneugantry",
    "models",
    "benchmarks",
    "examples",
    "docs",
    "notebooks",
)
KINDS = {".py", ".mo", ".c", ".h", ".md", ".toml", ".html", ".ipynb"}
SAY = {  # a pattern that must not appear: what to say in its place
    r"tight[ _]lead|led loosely|loosely led": "observer gain",
    r"\bborne[ _]out\b": "consistency factor",
    r"\buntold\b": "unidentifiable",
    r"\bmend(?:s|ed|ing)?\b": "fix, hint",
    r"\btroubled\b": "misfitting",
    r"\bstrained\b": "at its prior limit",
    r"_renull|_relay\b|_resingle|_rejoin": "refit_null, warm_start, refit_members, refresh_pairs",
    r"\bclass Bench\b|\bpneugantry bench\b": "benchmark",
    r"\bresembles\b": "nearest surrogate",
    r"\b_?(?:diagnose|write|is)_own\w*|\bown_(?:task|plant|controller)\b": "described, user",
    r"\bpromis(?:es|ed|ing)\b": "predicted, gain by the score test",
    r"\bprospects?\b|\bleaders?\b": "candidate, top candidate",
}


def found(pattern: str) -> Iterator[str]:
    """FILE:LINE: text of every line that a pattern is in."""
    sought = re.compile(pattern, re.IGNORECASE)
    paths = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*"))]
    for path in [*sorted(ROOT.glob("*.md")), *paths]:
        name = path.relative_to(ROOT).as_posix()
        if path.suffix not in KINDS or name == "CHANGELOG.md":
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            if sought.search(line):
                yield f"{name}:{number}: {line.strip()}"


@pytest.mark.parametrize("pattern", SAY)
def test_words_that_need_a_glossary_are_gone(pattern: str) -> None:
    assert list(found(pattern)) == [], f"say {SAY[pattern]!r}"


def test_a_word_that_is_there_is_found() -> None:
    assert any(line.startswith("README.md:1: ") for line in found(r"^# pneugantry$"))
    assert any(line.startswith("models/") for line in found(r"\bequation\b"))
