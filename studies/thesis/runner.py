"""Runs of the study in worker processes: grouped by controller, so that each process compiles a controller's loop once."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path

from controllers.catalogue import make_controller
from pyfmi_runner.errors import RunError
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.run import run_scenario
from studies.thesis.conditions import Run, scenario_of
from studies.thesis.scores import Scores, Trace, score_log, trace_log

__all__ = ["Done", "Results", "run_all", "run_one"]

BATCH = 40  # runs a task
Tell = Callable[[int, int], None]  # (runs done, runs in all)


@dataclass(frozen=True)
class Done:
    """A run's scores, its trace where asked for, and the time of the loop."""

    scores: Scores
    us_per_step: float  # plant, sensors and controller
    trace: Trace | None = None


@dataclass
class Results:
    """Finished runs."""

    done: dict[Run, Done] = field(default_factory=dict)

    def __getitem__(self, run: Run) -> Scores:
        return self.done[run].scores

    def trace(self, run: Run) -> Trace:
        trace = self.done[run].trace
        if trace is None:
            raise KeyError(f"{run} was run without a trace")
        return trace


def run_one(run: Run, fmu: FmuFile, *, trace: bool = False) -> Done:
    """Raises RunError where the FMU fails: a table with a hole is no table."""
    scenario = scenario_of(run)
    controller = make_controller(run.controller, **({"gains": run.gains} if run.gains else {}))
    result = run_scenario(scenario, fmu, controller=controller)
    if result.outcome != "done":
        raise RunError(f"{scenario.name}: {result.reason}")
    scores = score_log(result.log, quiet=run.choice.quiet, v_td=run.v_td, f_nd=scenario.f_nd, true_angle=run.angle_error != 0.0)
    return Done(scores, 1e6 * result.seconds / len(result.log), trace_log(result.log) if trace else None)


def run_all(runs: Iterable[Run], fmu: Path, *, traced: frozenset[Run] = frozenset(), workers: int = 2, tell: Tell | None = None) -> Results:
    """Each run once, in `workers` processes (1: in this one)."""
    todo = list(dict.fromkeys(runs))
    results = Results()
    if workers == 1:
        file = FmuFile.read(fmu)
        for count, run in enumerate(todo, start=1):
            results.done[run] = run_one(run, file, trace=run in traced)
            _tell(tell, count, len(todo))
        return results
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        futures = [pool.submit(_batch, batch, str(fmu), traced & frozenset(batch)) for batch in _batches(todo)]
        for future in as_completed(futures):
            results.done |= future.result()
            _tell(tell, len(results.done), len(todo))
    return results


def _tell(tell: Tell | None, done: int, total: int) -> None:
    if tell is not None:
        tell(done, total)


def _batches(runs: list[Run]) -> list[list[Run]]:
    by_controller: dict[str, list[Run]] = {}
    for run in runs:
        by_controller.setdefault(run.controller, []).append(run)
    groups = sorted(by_controller.values(), key=len, reverse=True)
    return [group[i : i + BATCH] for group in groups for i in range(0, len(group), BATCH)]


def _batch(runs: list[Run], fmu: str, traced: frozenset[Run]) -> dict[Run, Done]:
    file = FmuFile.read(fmu)
    return {run: run_one(run, file, trace=run in traced) for run in runs}
