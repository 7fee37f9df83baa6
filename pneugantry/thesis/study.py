"""The whole of the thesis, run: tables, conclusions, findings, leaderboard."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from controllers.catalogue import controller_names
from pneugantry.thesis.anfis_study import AnfisFit, anfis_fit
from pneugantry.thesis.conclusions import tracking_runs
from pneugantry.thesis.conditions import CHOICE, DDFM, VDFM, Run
from pneugantry.thesis.edge import valve_runs
from pneugantry.thesis.findings import WHOLE, Finding, finding_runs, findings, limit_gains
from pneugantry.thesis.judge import (
    cell_shares,
    ladder_traced,
    perfect_from,
    perfect_settings,
    perfect_values,
    plant_judged,
    plant_values,
    setting_runs,
    verdicts_of,
)
from pneugantry.thesis.leaderboard import (
    NEW,
    PLANTS,
    Robustness,
    Row,
    best_neural,
    board,
    board_runs,
    drawn_runs,
    robustness,
    step_times,
)
from pneugantry.thesis.perfect import PerfectRun
from pneugantry.thesis.pictured import picture_runs
from pneugantry.thesis.plant_tests import Hysteresis, hysteresis, identified_lags
from pneugantry.thesis.printed import WORKPIECES
from pneugantry.thesis.rig_tables import lag_cells, material_cells, part_cells
from pneugantry.thesis.run_store import RunStore
from pneugantry.thesis.runner import Results, Tell, Workers
from pneugantry.thesis.settings import CONTACTS
from pneugantry.thesis.stationary import Responses, stationary_responses
from pneugantry.thesis.tables import Cell, cells
from pneugantry.thesis.verdicts import Range, Verdict
from pyfmi_runner.fmu import FmuFile

__all__ = ["DRAWS", "Study", "run_study", "traced_runs"]

DRAWS = 8  # of each group of settings


@dataclass(frozen=True)
class PlantTests:
    """Tests on the plant alone."""

    friction: dict[str, Hysteresis]  # DDFM, VDFM
    lags: dict[str, float]  # s, identified
    parts: list[Cell]  # of tables that tests of the parts fill
    limits: dict[str, float]  # V/N
    stationary: Responses
    anfis: AnfisFit


@dataclass(frozen=True)
class Study:
    """What `pneugantry thesis` found."""

    cells: list[Cell]  # of every table, at the fitted setting
    shares: dict[str, dict[str, Range]]  # of met cells, by group of settings
    verdicts: list[Verdict]
    findings: list[Finding]
    board: list[Row]
    robustness: list[Robustness]
    neural: str  # the best neural controller
    results: Results
    plant: PlantTests
    perfect: dict[str, PerfectRun]  # with and without lag, fitted setting


def traced_runs() -> frozenset[Run]:
    """Runs that figures or conclusions look into."""
    fixed = [
        Run(piece, finish=finish) for piece in WORKPIECES for finish in ("modelled", "measured")
    ]
    networks = [
        Run(piece, name)
        for piece in ("straight", "curved")
        for name in ("pi_fv_mbpm", "pi_fv_mbpm_5", NEW)
    ]
    more = [
        Run("curved", "pi_fv_scheduled"),
        Run("straight", "pi_fv_ebpa_zero"),
        Run("straight", "pi_fv_ebpa"),
    ]
    angles = [run for run in tracking_runs() if run.angle_error != 0.0]
    return frozenset([WHOLE, *valve_runs(), *fixed, *networks, *more, *angles, *picture_runs()])


def run_study(
    fmu: Path,
    *,
    workers: int = 2,
    tell: Tell | None = None,
    plants: int = PLANTS,
    draws: int = DRAWS,
    store: RunStore | None = None,
) -> Study:
    """Runs everything that the store does not hold; `plants`: drawn plants of the robustness table,
    `draws`: settings of each group, at least 1.
    """
    with Workers(fmu, workers, tell, store) as pool:
        path = str(fmu)
        tests = pool.start([(_plant, (path,))])
        laws = {
            contact: [
                pool.keep(f"plant {contact} {draw}", plant_values, path, contact, draw)
                for draw in range(draws)
            ]
            for contact in CONTACTS
        }
        told = perfect_settings(draws)
        perfect = [pool.keep(f"perfect {one}", perfect_values, one, path) for one in told]
        names = controller_names()
        traced = traced_runs() | ladder_traced(draws)
        wanted = [
            *setting_runs(draws),
            *valve_runs(),
            *board_runs(),
            *finding_runs(),
            *picture_runs(),
        ]
        tracking = pool.start_runs(wanted, traced)
        drawn = pool.start_runs(drawn_runs(NEW, plants))
        timed = pool.start([(step_times, (names[i::4],)) for i in range(4)])
        results = pool.collect(tracking)
        neural = best_neural(results)
        drawn += pool.start_runs(drawn_runs(neural, plants))
        more = pool.collect(drawn)
        results.done |= more.done
        results.lost |= more.lost
        pairs = [(one, perfect_from(job.result())) for one, job in zip(told, perfect, strict=True)]
        judged = plant_judged(
            {contact: [v for job in jobs for v in job.result()] for contact, jobs in laws.items()}
        )
        plant: PlantTests = tests[0].result()
        return Study(
            _all_cells(results, plant),
            cell_shares(results, draws),
            verdicts_of(results, draws, pairs, judged),
            findings(results, plant.limits),
            board(results, _times(timed)),
            robustness(results, neural, plants),
            neural,
            results,
            plant,
            {"with lag": pairs[0][1].with_lag, "without lag": pairs[0][1].without_lag},
        )


def _all_cells(results: Results, plant: PlantTests) -> list[Cell]:
    """Tables in the order of the thesis, appendices last."""
    found = [
        *cells(results),
        *plant.parts,
        *lag_cells(plant.lags),
        *material_cells(results),
    ]
    return sorted(found, key=lambda cell: _place(cell.table))


def _place(table: str) -> tuple[str, int]:
    chapter, number = table.split(".")
    return chapter, int(number)


def _times(timed: Sequence[Future[Any]]) -> dict[str, float]:
    return {name: us for future in timed for name, us in future.result().items()}


def _plant(fmu: str) -> PlantTests:
    file = FmuFile.read(fmu)
    return PlantTests(
        {"DDFM": hysteresis(file, DDFM, CHOICE), "VDFM": hysteresis(file, VDFM, CHOICE)},
        identified_lags(file),
        part_cells(file),
        limit_gains(file),
        stationary_responses(fmu),
        anfis_fit(file),
    )
