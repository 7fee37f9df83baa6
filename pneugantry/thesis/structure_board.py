"""The leaderboard over structures: how well, at what effort and with what margins each controller
bears a plant that is built otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

from pneugantry.analysis.command_loop import LoopMargins
from pneugantry.thesis.conditions import Run
from pneugantry.thesis.entrants import BENCHMARK, ROBUST, Entrant, entrants
from pneugantry.thesis.leaderboard import PLANTS, drawn_runs
from pneugantry.thesis.loop_limits import FoundMargins, cosimulated_margins, linear_margins
from pneugantry.thesis.run_store import RunStore
from pneugantry.thesis.runner import Results, Tell, Workers
from pneugantry.thesis.structures import (
    NOMINAL,
    Structure,
    catalogue_structures,
    pairs,
    structures,
)
from pyfmi_runner.fmu import FmuFile

__all__ = [
    "EDGES",
    "LIMIT",
    "NOMINAL_LIMIT",
    "PI_LIMIT",
    "BoardRow",
    "Outcome",
    "Wanted",
    "run_board",
]

EDGES = ("straight", "curved")
LIMIT, NOMINAL_LIMIT = 1.5, 1.0  # N, RMSE f_n asked of the robust controller
PI_LIMIT = 4.0  # N, of the thesis' PI: beyond it a structure asks nothing
LOST = 1e3  # N, stands for a run that the FMU could not finish


@dataclass(frozen=True)
class Outcome:
    """A controller on one structure: the worse of the two edges."""

    rmse_fn: float  # N
    noise: float  # V, RMS of u_z about its mean over 20 ms
    limits: float  # share of the time that a valve is at a limit


@dataclass(frozen=True)
class BoardRow:
    """A controller over all structures."""

    name: str
    outcomes: dict[str, Outcome]  # by structure
    drawn: list[float]  # N, RMSE f_n on the drawn plants, both edges
    linear: LoopMargins | None
    found: FoundMargins | None  # None: margins were not asked for

    def of(self, chosen: Sequence[Structure]) -> list[float]:
        return [self.outcomes[s.name].rmse_fn for s in chosen if s.name in self.outcomes]

    @property
    def median(self) -> float:
        return median(o.rmse_fn for o in self.outcomes.values())

    @property
    def worst(self) -> tuple[str, float]:
        name = max(self.outcomes, key=lambda n: self.outcomes[n].rmse_fn)
        return name, self.outcomes[name].rmse_fn

    @property
    def noise(self) -> float:
        return median(o.noise for o in self.outcomes.values())

    @property
    def limits(self) -> float:
        """Largest share of the time at a limit."""
        return max(o.limits for o in self.outcomes.values())


@dataclass(frozen=True)
class StructureBoard:
    """Rows, best median first, and the structures they ran on."""

    rows: list[BoardRow]
    structures: list[Structure]

    def row(self, name: str) -> BoardRow:
        return next(row for row in self.rows if row.name == name)

    def asked(self) -> dict[str, tuple[float, float]]:
        """Where the thesis' PI stays below its limit on the worse edge: RMSE of the PI and of the
        robust controller. What lies beyond is not asked for.
        """
        pi, robust = self.row(BENCHMARK).outcomes, self.row(ROBUST).outcomes
        singles = [s.name for s in self.structures if s.family != "beyond"]
        return {
            name: (pi[name].rmse_fn, robust[name].rmse_fn)
            for name in singles
            if pi[name].rmse_fn < PI_LIMIT
        }

    @property
    def met(self) -> bool:
        """Both limits, everywhere they are asked."""
        nominal = self.row(ROBUST).outcomes[NOMINAL.name].rmse_fn
        return nominal <= NOMINAL_LIMIT and all(r <= LIMIT for _, r in self.asked().values())


def entrant_runs(entrant: Entrant, chosen: Sequence[Structure]) -> dict[str, list[Run]]:
    """Its runs on each structure, one an edge."""
    return {
        s.name: [s.run(edge, entrant.controller, options=entrant.options) for edge in EDGES]
        for s in chosen
    }


def _all_runs(entrant: Entrant, chosen: list[Structure], plants: int) -> list[Run]:
    by_structure = entrant_runs(entrant, chosen).values()
    return [*(run for runs in by_structure for run in runs), *drawn_for(entrant, plants)]


def drawn_for(entrant: Entrant, plants: int) -> list[Run]:
    return [run.changed(options=entrant.options) for run in drawn_runs(entrant.controller, plants)]


def entrant_margins(fmu: str, entrant: Entrant) -> dict[str, Any]:
    """Both kinds of margins, as JSON holds them."""
    file = FmuFile.read(fmu)
    linear, found = linear_margins(entrant, file), cosimulated_margins(entrant, file)
    return {"linear": None if linear is None else asdict(linear), "found": asdict(found)}


def board_row(
    entrant: Entrant, chosen: list[Structure], plants: int, results: Results, margins: Any = None
) -> BoardRow:
    """From finished runs and what `entrant_margins` found; None: not asked for."""
    outcomes = {
        name: _outcome(runs, results) for name, runs in entrant_runs(entrant, chosen).items()
    }
    drawn = [_outcome([run], results).rmse_fn for run in drawn_for(entrant, plants)]
    if margins is None:
        return BoardRow(entrant.name, outcomes, drawn, None, None)
    linear = None if margins["linear"] is None else LoopMargins(**margins["linear"])
    return BoardRow(entrant.name, outcomes, drawn, linear, FoundMargins(**margins["found"]))


def _outcome(runs: Sequence[Run], results: Results) -> Outcome:
    if any(run in results.lost for run in runs):
        return Outcome(LOST, float("nan"), 1.0)
    done = [results.finished(run) for run in runs]
    return Outcome(
        max(d.scores.rmse_fn for d in done),
        max(d.effort.noise_z for d in done),
        max(max(d.effort.limits_x, d.effort.limits_z) for d in done),
    )


@dataclass(frozen=True)
class Wanted:
    """What a board holds."""

    plants: int = PLANTS  # drawn
    names: Sequence[str] = ()  # of entrants; none: all
    margins: bool = True


def run_board(
    fmu: Path,
    wanted: Wanted,
    *,
    workers: int = 2,
    tell: Tell | None = None,
    store: RunStore | None = None,
) -> StructureBoard:
    """The wanted entrants on every structure."""
    plants, names, margins = wanted.plants, wanted.names, wanted.margins
    chosen = [*structures(), *pairs(), *catalogue_structures(FmuFile.read(fmu))]
    field = [e for e in entrants() if not names or e.name in names]
    with Workers(fmu, workers, tell, store) as pool:
        runs = pool.start_runs(run for e in field for run in _all_runs(e, chosen, plants))
        jobs = {
            e.name: pool.keep(f"margins {e}", entrant_margins, str(fmu), e)
            for e in field
            if margins
        }
        results = pool.collect(runs)
        rows = [
            board_row(e, chosen, plants, results, jobs[e.name].result() if margins else None)
            for e in field
        ]
    return StructureBoard(sorted(rows, key=lambda row: row.median), chosen)
