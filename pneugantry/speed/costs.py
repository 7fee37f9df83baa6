"""What a run costs: against simulated time, number of runs, active effects and processes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from controllers.pi_fv import PiFv
from pyfmi_runner.compiled_loop import compiled_loop
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.plan import Plan, make_plan
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario

__all__ = ["EFFECTS", "against_cores", "against_effects", "against_runs", "against_time"]

EFFECTS: tuple[tuple[str, dict[str, float]], ...] = (  # each row adds one to those above it
    ("none", {}),
    ("asymmetric valve lag", {"valve_z.lag_asymmetry": 0.2}),
    ("friction that grows with the load", {"axis_z.friction.load": 0.05}),
    ("bearing drag", {"contact.mu": 0.05}),
    (
        "surface finish",
        {"workpiece.A[1]": 0.2e-3, "workpiece.A[2]": 0.08e-3, "workpiece.A[3]": 0.03e-3},
    ),
    ("valve delay 5 ms", {"valve_z.delay_time": 0.005}),
    ("play on the command", {"valve_x.play": 0.01}),
    ("Dahl friction on z", {"axis_z.friction.law": 3.0}),
    ("LuGre friction on x", {"axis_x.friction.law": 4.0}),
)
LENGTHS = (
    3.0,
    9.0,
    38.0,
)  # s of contouring after 7 s of approach and contact: runs of 10, 16 and 45 s


def against_time(file: FmuFile, rounds: int) -> list[dict[str, Any]]:
    """Runs of several lengths along the curved edge: CPU time, least of the rounds."""
    rows = []
    for length in LENGTHS:
        phases = {"approach": (0.0, 3.0), "contact": (3.0, 7.0), "contour": (7.0, 7.0 + length)}
        plan = make_plan(
            scenario := Scenario(workpiece="curved", phases=phases, v_td=-0.06 * 9.0 / length)
        )
        seconds = _least(
            lambda plan=plan, scenario=scenario: _stepping(file, plan, scenario),  # type: ignore[misc]
            rounds,
        )
        rows.append(
            {
                "simulated_s": 7.0 + length,
                "ms": 1e3 * seconds,
                "us_per_step": 1e6 * seconds / plan.samples,
            }
        )
    return rows


def against_effects(file: FmuFile, rounds: int) -> list[dict[str, Any]]:
    """The straight edge with 0, 1, 2, ... effects switched on, one after the other: CPU time, least
    of the rounds.
    """
    rows: list[dict[str, Any]] = []
    chosen: dict[str, float] = {}
    for count, (name, parameters) in enumerate(EFFECTS):
        chosen = chosen | parameters
        scenario = Scenario(workpiece="straight", plant=chosen)
        plan = make_plan(scenario)
        seconds = _least(
            lambda plan=plan, scenario=scenario: _stepping(file, plan, scenario),  # type: ignore[misc]
            rounds,
        )
        rows.append({"effects": count, "added": name, "us_per_step": 1e6 * seconds / plan.samples})
    return rows


def against_runs(
    file: FmuFile, rounds: int, counts: Iterable[int] = (1, 10, 100)
) -> list[dict[str, Any]]:
    """Runs of 1 s: an instance each, an instance reset, and what of a run is neither stepping: ms a
    run, least of the rounds.
    """
    phases = {"approach": (0.0, 0.2), "contact": (0.2, 0.4), "contour": (0.4, 1.0)}
    plan = make_plan(scenario := Scenario(workpiece="straight", phases=phases))
    stepping = _least(lambda: _stepping(file, plan, scenario), rounds)
    rows = []
    for n in counts:
        anew = _least(lambda n=n: _anew(file, plan, scenario, n), rounds) / n  # type: ignore[misc]
        again = _least(lambda n=n: _reset(file, plan, scenario, n), rounds) / n  # type: ignore[misc]
        rows.append(
            {
                "runs": n,
                "ms_new_instance": 1e3 * anew,
                "ms_reset": 1e3 * again,
                "ms_stepping": 1e3 * stepping,
            }
        )
    return rows


def against_cores(path: Path, runs: int, processes: Iterable[int] = (1, 2)) -> list[dict[str, Any]]:
    """Whole runs of the straight edge (scenario to log) in worker processes: wall time, after every
    worker has compiled its loop.
    """
    rows = []
    for n in processes:
        with ProcessPoolExecutor(n, mp_context=get_context("spawn")) as pool:
            list(pool.map(_whole_run, [(path, -1)] * n, chunksize=1))
            start = time.perf_counter()
            list(
                pool.map(
                    _whole_run,
                    [(path, seed) for seed in range(runs)],
                    chunksize=max(1, runs // (4 * n)),
                )
            )
            seconds = time.perf_counter() - start
        rows.append({"processes": n, "runs": runs, "runs_per_s": runs / seconds, "wall_s": seconds})
    return rows


def _whole_run(job: tuple[Path, int]) -> int:
    path, seed = job
    result = run_scenario(Scenario(workpiece="straight", seed=max(seed, 0)), FmuFile.read(path))
    if seed < 0:
        time.sleep(0.5)  # so that another worker takes the next of these
    return len(result.log)


def _least(function: Callable[[], float], rounds: int) -> float:
    function()
    return min(function() for _ in range(rounds))


def _stepping(file: FmuFile, plan: Plan, scenario: Scenario) -> float:
    with FmuSession(file, parameters=plan.parameters) as fmu:
        start = time.process_time()
        rows = compiled_loop(fmu, plan, PiFv(), scenario.sensors)
        seconds = time.process_time() - start
    assert rows.done == plan.samples, rows.failure
    return seconds


def _anew(file: FmuFile, plan: Plan, scenario: Scenario, runs: int) -> float:
    start = time.process_time()
    for _ in range(runs):
        with FmuSession(file, parameters=plan.parameters) as fmu:
            compiled_loop(fmu, plan, PiFv(), scenario.sensors)
    return time.process_time() - start


def _reset(file: FmuFile, plan: Plan, scenario: Scenario, runs: int) -> float:
    with FmuSession(file, parameters=plan.parameters) as fmu:
        start = time.process_time()
        for _ in range(runs):
            fmu.reset()
            compiled_loop(fmu, plan, PiFv(), scenario.sensors)
        return time.process_time() - start
