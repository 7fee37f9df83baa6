"""Runs of the study in worker processes: grouped by controller, so that each process compiles a
controller's loop once. What a store holds already is not run again, and every batch is stored as
it ends.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from controllers.catalogue import make_controller
from controllers.interface import Controller
from controllers.wrong_angle import WrongAngle
from modelica_fmu.errors import RunError
from pneugantry.thesis.conditions import TIME_SHIFT, Run, scenario_of
from pneugantry.thesis.run_store import Done, RunStore
from pneugantry.thesis.scores import Scores, Trace, effort_log, score_log, trace_log
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.run import run_scenario

__all__ = ["Done", "Job", "Results", "Workers", "run_one"]

BATCH = 30  # runs a task
Tell = Callable[[int, int], None]  # (jobs done, jobs in all)
Job = tuple[
    Callable[..., Any], tuple[Any, ...]
]  # a function that the workers can import, and its arguments


@dataclass
class Results:
    """Finished runs; asking for one that the FMU could not finish raises RunError: a table with a
    hole is no table.
    """

    done: dict[Run, Done] = field(default_factory=dict)
    lost: dict[Run, str] = field(default_factory=dict)  # why

    def finished(self, run: Run) -> Done:
        if run in self.lost:
            raise RunError(self.lost[run])
        return self.done[run]

    def __getitem__(self, run: Run) -> Scores:
        return self.finished(run).scores

    def add(self, found: Mapping[Run, Done | str]) -> None:
        """text: why a run was lost."""
        for run, done in found.items():
            if isinstance(done, str):
                self.lost[run] = done
            else:
                self.done[run] = done

    def trace(self, run: Run) -> Trace:
        trace = self.finished(run).trace
        if trace is None:
            raise KeyError(f"{run} was run without a trace")
        return trace


def run_one(run: Run, fmu: FmuFile, *, trace: bool = False) -> Done:
    """Raises RunError where the FMU fails."""
    scenario = scenario_of(run)
    controller: Controller = (
        WrongAngle(run.angle_error)
        if run.angle_error
        else make_controller(run.controller, **_options(run))
    )
    result = run_scenario(scenario, fmu, controller=controller)
    if result.outcome != "done":
        raise RunError(f"{scenario.name}: {result.reason}")
    scores = score_log(result.log, quiet=run.choice.quiet, v_td=run.v_td, f_nd=scenario.f_nd)
    effort = effort_log(result.log, quiet=run.choice.quiet, f_nd=scenario.f_nd)
    return Done(scores, effort, trace_log(result.log, TIME_SHIFT) if trace else None)


def _options(run: Run) -> dict[str, Any]:
    return dict(run.options) | ({"gains": run.gains} if run.gains else {})


def run_batch(runs: list[Run], fmu: str, traced: frozenset[Run]) -> dict[Run, Done | str]:
    """text: why a run was lost."""
    file = FmuFile.read(fmu)
    found: dict[Run, Done | str] = {}
    for run in runs:
        try:
            found[run] = run_one(run, file, trace=run in traced)
        except RunError as error:
            found[run] = str(error)
    return found


def batches(runs: Iterable[Run], size: int = BATCH) -> list[list[Run]]:
    """Each run once; a batch holds one controller. Large batches first."""
    by_controller: dict[str, list[Run]] = {}
    for run in dict.fromkeys(runs):
        by_controller.setdefault(run.controller, []).append(run)
    groups = sorted(by_controller.values(), key=len, reverse=True)
    return [group[i : i + size] for group in groups for i in range(0, len(group), size)]


class Workers:
    """Worker processes that live for the study, so that what they compiled serves again; count 1:
    this process. store: where finished runs are looked up and kept.
    """

    def __init__(
        self,
        fmu: Path,
        count: int = 2,
        tell: Tell | None = None,
        store: RunStore | None = None,
    ) -> None:
        self.fmu, self.tell, self.store = str(fmu), tell, store
        self.pool = (
            ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn"))
            if count > 1
            else None
        )
        self.announced = self.done = 0  # jobs

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        if self.pool is not None:
            self.pool.shutdown(cancel_futures=True)

    def start(self, jobs: Sequence[Job]) -> list[Future[Any]]:
        """The jobs' results, to be asked for with `result()`."""
        self.announced += len(jobs)  # all at once: without a pool each is run as it is submitted
        return [self._submit(function, *arguments) for function, arguments in jobs]

    def start_runs(
        self, runs: Iterable[Run], traced: frozenset[Run] = frozenset()
    ) -> list[Future[Any]]:
        """Their results, to be asked for with `collect`."""
        wanted = dict.fromkeys(runs)
        known = {} if self.store is None else self.store.runs(wanted, traced)
        missing = batches(run for run in wanted if run not in known)
        self.announced += len(missing)
        started = self.start([(_given, (known,))])
        for batch in missing:
            future = self._submit(run_batch, batch, self.fmu, traced & frozenset(batch))
            if self.store is not None:
                future.add_done_callback(self._keep_runs)
            started.append(future)
        return started

    def keep(self, name: str, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """A job whose result JSON holds, kept under a name."""
        self.announced += 1
        known = None if self.store is None else self.store.value(name)
        if known is not None:
            return self._submit(_given, known)
        future = self._submit(function, *arguments)
        if self.store is not None:
            store = self.store
            future.add_done_callback(lambda f: _if_whole(f, partial(store.add_value, name)))
        return future

    def collect(self, futures: Sequence[Future[Any]]) -> Results:
        """Results of `start_runs`."""
        wait(futures)
        results = Results()
        for future in futures:
            results.add(future.result())
        return results

    def _keep_runs(self, future: Future[Any]) -> None:
        assert self.store is not None
        _if_whole(future, self.store.add_runs)

    def _submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        if self.pool is None:
            future: Future[Any] = Future()
            future.set_result(function(*arguments))
        else:
            future = self.pool.submit(function, *arguments)
        future.add_done_callback(self._finished)
        return future

    def _finished(self, _: Future[Any]) -> None:
        self.done += 1
        if self.tell is not None:
            self.tell(self.done, self.announced)


def _given(value: Any) -> Any:
    return value


def _if_whole(future: Future[Any], keep: Callable[[Any], None]) -> None:
    """Keeps the result of a job that was neither cancelled nor failed."""
    if not future.cancelled() and future.exception() is None:
        keep(future.result())
