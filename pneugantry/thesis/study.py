"""The whole of the thesis, run: tables, conclusions, leaderboard, robustness."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from controllers.catalogue import controller_names
from pneugantry.thesis.anfis_study import AnfisFit, anfis_fit
from pneugantry.thesis.conclusions import Conclusion, tracking_conclusions, tracking_runs
from pneugantry.thesis.conditions import CHOICE, DDFM, NO_LAG, VDFM, Run
from pneugantry.thesis.edge import valve_runs
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
from pneugantry.thesis.perfect import STRAIGHT, PerfectRun, perfect_conclusion, perfect_run
from pneugantry.thesis.plant_tests import (
    Hysteresis,
    friction_conclusion,
    hysteresis,
    lag_conclusion,
    locus_conclusion,
)
from pneugantry.thesis.printed import WORKPIECES
from pneugantry.thesis.runner import Results, Tell, Workers
from pneugantry.thesis.stationary import Responses, stationary_responses
from pneugantry.thesis.tables import Cell, cells, table_runs
from pyfmi_runner.fmu import FmuFile

__all__ = ["Study", "run_study", "traced_runs"]


@dataclass(frozen=True)
class Study:
    """What `pneugantry thesis` found."""

    cells: list[Cell]
    conclusions: list[Conclusion]
    board: list[Row]
    robustness: list[Robustness]
    neural: str  # the best neural controller
    results: Results
    friction: dict[str, Hysteresis]  # DDFM, VDFM
    perfect: dict[str, PerfectRun]  # with and without lag
    stationary: Responses
    anfis: AnfisFit


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
    return frozenset([*valve_runs(), *fixed, *networks, *more, *angles])


def run_study(
    fmu: Path, *, workers: int = 2, tell: Tell | None = None, plants: int = PLANTS
) -> Study:
    """Runs everything; `plants`: drawn plants of the robustness table."""
    with Workers(fmu, workers, tell) as pool:
        path = str(fmu)
        alone = (
            (_tests, (path,)),
            (_perfect, (path, True)),
            (_perfect, (path, False)),
            (stationary_responses, (path,)),
            (_anfis, (path,)),
        )
        tests = pool.start(alone)
        names = controller_names()
        tracking = pool.start_runs([*table_runs(), *tracking_runs(), *board_runs()], traced_runs())
        drawn = pool.start_runs(drawn_runs(NEW, plants))
        timed = pool.start([(step_times, (names[i::4],)) for i in range(4)])
        results = pool.collect(tracking)
        neural = best_neural(results)
        drawn += pool.start_runs(drawn_runs(neural, plants))
        results.done |= pool.collect(drawn).done
        return _study(results, neural, tests, timed, plants)


def _study(
    results: Results, neural: str, tests: list[Future[Any]], timed: list[Future[Any]], plants: int
) -> Study:
    friction, plant_conclusions = tests[0].result()
    perfect = {"with lag": tests[1].result(), "without lag": tests[2].result()}
    eleventh = perfect_conclusion(results, perfect["with lag"], perfect["without lag"])
    conclusions = sorted(
        [*tracking_conclusions(results), *plant_conclusions, eleventh], key=lambda c: c.id
    )
    times = {name: us for future in timed for name, us in future.result().items()}
    found = robustness(results, neural, plants)
    rows = board(results, times)
    return Study(
        cells(results),
        conclusions,
        rows,
        found,
        neural,
        results,
        friction,
        perfect,
        tests[3].result(),
        tests[4].result(),
    )


def _anfis(fmu: str) -> AnfisFit:
    return anfis_fit(FmuFile.read(fmu))


def _tests(fmu: str) -> tuple[dict[str, Hysteresis], list[Conclusion]]:
    file = FmuFile.read(fmu)
    friction = {"DDFM": hysteresis(file, DDFM, CHOICE), "VDFM": hysteresis(file, VDFM, CHOICE)}
    return friction, [
        friction_conclusion(friction["DDFM"], friction["VDFM"]),
        locus_conclusion(file),
        lag_conclusion(file),
    ]


def _perfect(fmu: str, lag: bool) -> PerfectRun:
    return perfect_run(STRAIGHT if lag else STRAIGHT.changed(plant=NO_LAG), FmuFile.read(fmu))
