"""Which run stands behind each printed line, and the cells: ours beside the printed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from pneugantry.thesis.conditions import NO_FRICTION, NO_LAG, Run
from pneugantry.thesis.printed import COLUMNS, WORKPIECES, Printed, printed_rows
from pneugantry.thesis.runner import Results

__all__ = [
    "TOLERANCE",
    "Cell",
    "ablation_run",
    "cells",
    "met_share",
    "run_of",
    "speed_run",
    "table_runs",
]

TOLERANCE = 0.25  # a cell is met within this share of the printed value


@dataclass(frozen=True)
class Cell:
    """One printed number beside ours."""

    table: str
    row: str
    column: str
    kind: str  # "simulation" or "experiment"
    printed: float
    ours: float

    @property
    def met(self) -> bool:
        return abs(self.ours / self.printed - 1.0) <= TOLERANCE


def ablation_run(workpiece: str, case: str) -> Run:
    """Tables 4.11-4.15: one effect removed at a time."""
    run = Run(workpiece, finish="modelled")
    changes: dict[str, dict[str, object]] = {
        "all on": {},
        "no signal noise": {"noise": False},
        "no lag": {"plant": NO_LAG},
        "no surface finish": {"finish": "none"},
        "no Coulomb friction": {"plant": NO_FRICTION},
    }
    return run.changed(**changes[case])


def speed_run(workpiece: str, speed: float) -> Run:
    """Tables 4.9, 4.10."""
    return Run(workpiece, finish="modelled", v_td=-speed)


def run_of(row: Printed) -> Run:
    """The run behind a printed line."""
    if row.table in ("3.9", "3.10"):  # before the controller was retuned, §3.5.3
        return Run(row.workpiece, gains="table_3_7", v_td=-float(row.row.split()[0]))
    if row.table in ("4.9", "4.10"):
        return speed_run(row.workpiece, float(row.row.split()[0]))
    if row.table == "4.7":
        return Run(row.workpiece, finish="modelled")
    if row.table in ("4.11", "4.12", "4.13", "4.14", "4.15"):
        return ablation_run(row.workpiece, row.row.split(",")[0])
    if row.row.startswith(
        "Jatta"
    ):  # an electric robot's numbers; ours: its controller on our plant
        return Run(row.workpiece, "dfv")
    name = row.row.split(",")[0] if row.table in ("3.14", "5.2", "5.5", "6.1") else "pi_fv"
    return Run(row.workpiece, "pi_fv" if name.endswith("PI FV") else name)


def table_runs() -> list[Run]:
    return [run_of(row) for row in printed_rows()]


def cells(results: Results) -> list[Cell]:
    """Every printed number beside ours."""
    found = []
    for row in printed_rows():
        scores = results[run_of(row)]
        name = (
            row.row
            if row.row in WORKPIECES or row.table != "5.5"
            else f"{row.row}, {row.workpiece}"
        )
        for column, printed, ours in zip(COLUMNS, row.values, scores, strict=True):
            if printed is not None:
                found.append(Cell(row.table, name, column, row.kind, printed, ours))
    return found


def met_share(found: Iterable[Cell], tables: Iterable[str] | None = None) -> float:
    """Share of the simulation cells that are met, of some tables or of all but the repeats in
    Tables 4.15 and 6.1.
    """
    chosen = set(tables) if tables is not None else None
    cells = [
        c
        for c in found
        if c.kind == "simulation"
        and (c.table in chosen if chosen else c.table not in ("4.15", "6.1"))
    ]
    return sum(c.met for c in cells) / len(cells)
