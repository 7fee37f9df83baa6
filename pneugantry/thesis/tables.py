"""Which run stands behind each printed line, and the cells: ours beside the printed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from pneugantry.thesis.conditions import NO_FRICTION, NO_LAG, Run
from pneugantry.thesis.pictured import rig_speed_run
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
    "tracked_rows",
    "unique_cells",
]

RESOLUTION = {"f_n": 0.2, "v_t": 0.001}  # N, m/s: every printed value is a multiple of it
TOLERANCE = 0.25  # a cell is met within this share of the printed value


@dataclass(frozen=True)
class Cell:
    """One printed number beside ours."""

    table: str
    row: str
    column: str
    kind: str  # "simulation", "experiment", "test" of a part, or "fitted": met by what was chosen
    printed: float
    ours: float
    repeat_of: str = ""  # the table that printed the same number of the same run before

    @property
    def met(self) -> bool:
        """Within TOLERANCE."""
        return abs(self.ours / self.printed - 1.0) <= TOLERANCE

    @property
    def met_in_print(self) -> bool:
        """Met, or would be had the print not been rounded."""
        half = 0.5 * RESOLUTION[self.column.split()[1]]
        return abs(self.ours - self.printed) <= TOLERANCE * self.printed + half


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
        return rig_speed_run(row.workpiece, float(row.row.split()[0]))
    if row.table in ("4.9", "4.10"):
        return speed_run(row.workpiece, float(row.row.split()[0]))
    if row.table == "4.7":
        return Run(row.workpiece, finish="modelled")
    if row.table in ("4.11", "4.12", "4.13", "4.14", "4.15"):
        return ablation_run(row.workpiece, row.row.split(",")[0])
    name = row.row.split(",")[0] if row.table in ("3.14", "5.2", "5.5", "6.1") else "pi_fv"
    return Run(row.workpiece, "pi_fv" if name.endswith("PI FV") else name)


def tracked_rows() -> list[Printed]:
    """Printed lines with a run under the thesis' set points; Jatta's robot had others
    (`rig_tables`).
    """
    return [row for row in printed_rows() if not row.row.startswith("Jatta")]


def table_runs() -> list[Run]:
    return [run_of(row) for row in tracked_rows()]


def cells(results: Results) -> list[Cell]:
    """Every printed number beside ours; a number that a table before printed for the same run says
    so.
    """
    found: list[Cell] = []
    seen: dict[tuple[Run, str], str] = {}
    for row in tracked_rows():
        run = run_of(row)
        for column, printed, ours in zip(COLUMNS, row.values, results[run], strict=True):
            if printed is None:
                continue
            first = ""
            if row.kind == "simulation":
                first = seen.setdefault((run, column), row.table)
            repeat = first if first != row.table else ""
            found.append(Cell(row.table, _row_name(row), column, row.kind, printed, ours, repeat))
    return found


def _row_name(row: Printed) -> str:
    plain = row.row in WORKPIECES or row.table != "5.5"
    return row.row if plain else f"{row.row}, {row.workpiece}"


def unique_cells(found: Iterable[Cell]) -> list[Cell]:
    """The simulation cells, each printed number once."""
    return [cell for cell in found if cell.kind == "simulation" and not cell.repeat_of]


def met_share(found: Iterable[Cell], *, in_print: bool = False) -> float:
    """Share of the unique simulation cells that are met; `in_print`: allowing for the rounding of
    the print.
    """
    once = unique_cells(found)
    return sum(cell.met_in_print if in_print else cell.met for cell in once) / len(once)
