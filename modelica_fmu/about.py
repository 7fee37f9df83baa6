"""What a Modelica package says of itself: version, author, licence, date.

    annotation(version = "1.0.0", versionDate = "2026-01-31",
      __FMU(author = "...", license = "...", copyright = "..."));

The date is the version's, not the build's, so that equal sources give equal FMUs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from modelica_fmu.modelica.grammar import parse
from modelica_fmu.modelica.syntax import Modifier, Text

__all__ = ["about_file", "about_text"]

WORDS = ("author", "license", "copyright")


def about_text(text: str, path: Path = Path("model.mo")) -> dict[str, str]:
    """Attributes of an FMU's description; only those that an outermost class of the text gives."""
    found: dict[str, str] = {}
    for cls in parse(text, path)[1]:
        given = dict(_texts(cls.annotation))
        if {"version", "versionDate"} <= given.keys():
            date = f"{given['versionDate']}T00:00:00Z"
            found |= {"version": given["version"], "generationDateAndTime": date}
        for modifier in cls.annotation:
            if modifier.name == ("__FMU",):
                found |= {name: said for name, said in _texts(modifier.inner) if name in WORDS}
    return found


def _texts(modifiers: Iterable[Modifier]) -> Iterator[tuple[str, str]]:
    for modifier in modifiers:
        if isinstance(modifier.value, Text):
            yield modifier.name[-1], modifier.value.value


def about_file(path: Path) -> dict[str, str]:
    """`about_text` of a file that the compiler has read."""
    return about_text(path.read_text(encoding="utf-8", errors="replace"), path)
