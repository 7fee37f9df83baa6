"""What a Modelica package says of itself: version, author, licence, date.

    annotation(version = "1.0.0", versionDate = "2026-01-31",
      __FMU(author = "...", license = "...", copyright = "..."));

The date is the version's, not the build's, so that equal sources give equal FMUs.
"""

from __future__ import annotations

import re
from pathlib import Path

__all__ = ["about_file", "about_text"]

VERSION = (
    r'\bannotation\s*\(\s*version\s*=\s*"([^"\\]*)"\s*,\s*versionDate\s*=\s*"(\d{4}-\d\d-\d\d)"'
)
WORDS = r"\b__FMU\s*\(([^()]*)\)"
WORD = r'\b(author|license|copyright)\s*=\s*"([^"\\]*)"'


def about_text(text: str) -> dict[str, str]:
    """Attributes of an FMU's description; only those that the text gives."""
    found: dict[str, str] = {}
    if version := re.search(VERSION, text):
        found |= {"version": version[1], "generationDateAndTime": f"{version[2]}T00:00:00Z"}
    if words := re.search(WORDS, text):
        found |= dict(re.findall(WORD, words[1]))
    return found


def about_file(path: Path) -> dict[str, str]:
    """`about_text` of a file that the compiler has read."""
    return about_text(path.read_text(encoding="utf-8", errors="replace"))
