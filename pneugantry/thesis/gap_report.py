"""The gap's answer as JSON, lines and a picture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pneugantry.analysis.plots import Figure, save
from pneugantry.analysis.plots_thesis import Bars, bars_figure
from pneugantry.thesis.gap import CLEAR, TABLES, Gap, GapCell, Ranked
from pneugantry.thesis.gap_tests import PartTest

__all__ = ["draw_gap", "gap_figure", "gap_lines", "gap_report"]

SHOWN = 12  # structures in the table and the picture


def gap_report(gap: Gap) -> dict[str, Any]:
    """The JSON, `thesis_gap/1`."""
    rows = zip(gap.cells, gap.predicted, gap.deviation, gap.strays, strict=True)
    return {
        "schema": "thesis_gap/1",
        "printed": [{**asdict_of(p), "explained_by_edge": p.explained} for p in gap.printed],
        "best": asdict(gap.best),
        "factors": [asdict(r) for r in gap.factors],
        "structures": [asdict(r) for r in gap.structures],
        "tests": [test._asdict() for test in gap.tests],
        "cells": [
            {**c._asdict(), "predicted": float(p), "sd": float(d), "stray": float(s)}
            for c, p, d, s in rows
        ],
        "unknown": gap.unexplained,
        "answer": answer(gap),
    }


def asdict_of(row: Any) -> dict[str, Any]:
    return dict(row._asdict())


def answer(gap: Gap) -> list[str]:
    """In words, each sentence borne by a number above."""
    said = []
    for p in gap.printed:
        word = "takes away" if p.explained > 0 else "adds"
        said.append(
            f"{p.column}: the measured edge {word} {abs(p.explained):.0%} of the squared gap "
            "between Table 4.7 and Table 3.12"
        )
    best = gap.best
    scored = ", ".join(f"{t} {w}" for t, w in zip(TABLES, best.windows, strict=True))
    said.append(f"our plant comes nearest with {best.edge}, {best.contact} N/m, windows: {scored}")
    top = gap.structures[0]
    if top.gain > CLEAR:
        said.append(f"on top of that {top.name} gains {top.gain:.1f} log units")
    else:
        said.append("no single effect at its usual size gains more than the odds of 20 to 1")
    said += [_test_sentence(gap, test) for test in dict.fromkeys(t.test for t in gap.tests)]
    unknown = ", ".join(gap.unexplained)
    said.append(f"unknown: {unknown}" if unknown else "no column strays beyond two deviations")
    return said


def _test_sentence(gap: Gap, test: str) -> str:
    """The best rival, and the nearest that is clearly worse."""
    rivals = [t for t in gap.tests if t.test == test]
    near = [t.name for t in rivals[1:] if t.gain > -CLEAR]
    worse = next((t for t in rivals if t.gain <= -CLEAR), None)
    said = f"{test}: {rivals[0].name}"
    if near:
        said += f" (not told from {', '.join(near)})"
    return said if worse is None else f"{said}; {worse.name} loses {-worse.gain:.1f} log units"


def gap_lines(gap: Gap) -> Iterator[str]:
    yield "From the print alone: RMS difference from Table 3.12 (print's step), four workpieces"
    yield f"  {'':<10}{'Table 4.7':>12}{'Table 4.8':>12}{'step':>8}   measured edge explains"
    for p in gap.printed:
        yield (
            f"  {p.column:<10}{p.modelled:>12.3g}{p.measured:>12.3g}{p.resolution:>8.3g}   "
            f"{p.explained:.0%} of the squared gap"
        )
    yield "\nFactors: log likelihood lost where one alone is changed (0: the best combination)"
    yield from (_line(r) for r in gap.factors)
    yield f"\nOn top of it, one at its usual size: log units gained (clear beyond {CLEAR:g})"
    yield from (_line(r) for r in gap.structures[:SHOWN])
    rest = [r for r in gap.structures[SHOWN:] if r.name == "nothing"]
    yield from (_line(r) for r in rest)
    yield "\nTests of the parts, by what explains them: log units lost (0: the best)"
    yield from (_test_line(test) for test in gap.tests)
    yield "\nCells: measured, predicted +- deviation, stray in deviations (! beyond 2)"
    yield from _cell_lines(gap)
    yield "\nAnswer"
    yield from (f"  - {sentence}" for sentence in answer(gap))


def _line(r: Ranked) -> str:
    return f"  {r.name:<38}{r.gain:>8.1f}   P {r.probability:.2f}"


def _test_line(test: PartTest) -> str:
    span = ""
    if test.predicted is not None and test.measured is not None:
        span = f"   measured {test.measured:g} N, ours {test.predicted:.1f} N"
    return f"  {test.test + ': ' + test.name:<58}{test.gain:>8.1f}{span}"


def _cell_lines(gap: Gap) -> Iterator[str]:
    for c, p, d, s in zip(gap.cells, gap.predicted, gap.deviation, gap.strays, strict=True):
        yield (
            f"  {_label(c):<38}{c.value:>8.3g}{p:>9.3g} +- {d:<8.2g}{s:>6.1f}"
            f"{' !' if abs(s) > 2.0 else ''}"
        )


def _label(c: GapCell) -> str:
    return f"{c.table} {c.row if c.row == c.workpiece else f'{c.workpiece} {c.row}'}, {c.column}"


def draw_gap(gap: Gap, out: Path) -> Path:
    """The picture of `gap_figure`, as a file."""
    path = out / "gap.png"
    save(gap_figure(gap_report(gap)), path)
    return path


def gap_figure(report: Mapping[str, Any]) -> Figure:
    """From the JSON: factors, structures, tests of the parts, and what each measured cell strays.
    Dashed: odds of 20 to 1, and two standard deviations.
    """
    ranked = [
        ("one factor changed alone (0: the best combination)", report["factors"], (-CLEAR,)),
        ("on top of it: one effect at its usual size", report["structures"][:SHOWN], (CLEAR,)),
        ("rival explanations of the tests of parts (0: the best)", report["tests"], (-CLEAR,)),
    ]
    bars = [
        Bars(title, "log units", [_name(r) for r in rows], _gains(rows), limits)
        for title, rows, limits in ranked
    ]
    cells = report["cells"]
    keys = ("table", "row", "workpiece", "column", "value")
    names = [_label(GapCell(*(c[key] for key in keys))) for c in cells]
    strays = np.array([c["stray"] for c in cells])
    title = "measured less predicted, on the best combination"
    bars.append(Bars(title, "standard deviations", names, strays, (-2.0, 2.0)))
    return bars_figure(bars, "The thesis' own sim-to-real gap")


def _name(row: Mapping[str, Any]) -> str:
    return f"{row['test']}: {row['name']}" if "test" in row else str(row["name"])


def _gains(rows: Sequence[Mapping[str, Any]]) -> np.ndarray:
    return np.array([row["gain"] for row in rows])
