"""What the site generates from the code: `<!-- generated: NAME -->` in a page becomes its text.

MkDocs calls `on_page_markdown` for every page.
"""

from __future__ import annotations

import argparse
import re
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]

import recorded  # noqa: E402
from file_map import file_map  # noqa: E402

from pneugantry.cli import COMMANDS, parser  # noqa: E402


def commands() -> str:
    """Every command's help, as its parser prints it."""
    top = parser()
    (table,) = (a for a in top._actions if isinstance(a, argparse._SubParsersAction))
    parts = []
    for name, summary in COMMANDS.items():
        text = table.choices[name].format_help().rstrip()
        said = f"{summary[0].upper()}{summary[1:]}."
        parts.append(f"### {name}\n\n{said}\n\n```text\n{text}\n```\n")
    return "\n".join(parts)


def effects() -> str:
    """The gantry's catalogue: one row per effect and axis."""
    lines = ["| effect | axis | block | what it adds to the nominal plant |", "|---|---|---|---|"]
    for path in sorted((ROOT / "pneugantry" / "plants" / "gantry" / "effects").glob("*.toml")):
        for entry in _entries(tomllib.loads(path.read_text(encoding="utf-8"))):
            axes = " ".join(entry.get("axes", ()))
            cells = (f"`{entry['name']}`", axes, entry.get("block", ""), entry.get("summary", ""))
            lines.append("| " + " | ".join(str(cell) for cell in cells) + " |")
    return "\n".join(lines)


def _entries(table: dict[str, Any]) -> list[dict[str, Any]]:
    return table["effect"] if isinstance(table.get("effect"), list) else [table]


def printed() -> str:
    """The thesis' printed numbers, from the table that `pneugantry thesis` is judged by."""
    from pneugantry.thesis.printed import COLUMNS, printed_rows

    lines = ["| table | kind | row | " + " | ".join(COLUMNS) + " |"]
    lines.append("|---" * (3 + len(COLUMNS)) + "|")
    for row in printed_rows():
        values = ("" if value is None else f"{value:g}" for value in row.values)
        lines.append(f"| {row.table} | {row.kind} | {row.row} | " + " | ".join(values) + " |")
    return "\n".join(lines)


def decisions() -> str:
    """The list of decision records, by number."""
    lines = []
    for path in sorted((ROOT / "docs" / "decisions").glob("[0-9]*.md")):
        title = re.match(r"# (.*)", path.read_text(encoding="utf-8"))
        lines.append(f"- [{title[1] if title else path.stem}]({path.name})")
    return "\n".join(lines)


GENERATED: dict[str, Callable[[], str]] = {
    "commands": commands,
    "effects": effects,
    "modules": file_map,
    "printed": printed,
    "bad_input": recorded.bad_input,
    "bam_planted": recorded.bam_planted,
    "blind_nuisance": recorded.blind_nuisance,
    "blind_sets": recorded.blind_sets,
    "drive_blind": recorded.drive_blind,
    "clean_install": recorded.clean_install,
    "code_size": recorded.code_size,
    "replay": recorded.replay,
    "rootlocus": recorded.rootlocus,
    "solver_check": recorded.solver_check,
    "motor": recorded.motor,
    "standard_library": recorded.standard_library,
    "stiff": recorded.stiff,
    "textbook": recorded.textbook,
    "public_models": recorded.public_models,
    "diagnosis_time": recorded.diagnosis_time,
    "differential": recorded.differential,
    "math_functions": recorded.math_functions,
    "compiler_times": recorded.compiler_times,
    "cross_check": recorded.cross_check,
    "soak_models": recorded.soak_models,
    "decisions": decisions,
}


def generated(markdown: str) -> str:
    """A page's text with its generated parts in place. Raises KeyError for an unknown name."""
    return re.sub(r"<!-- generated: (\w+) -->", lambda m: GENERATED[m[1]](), markdown)


def on_page_markdown(markdown: str, **_: Any) -> str:
    return generated(markdown)
