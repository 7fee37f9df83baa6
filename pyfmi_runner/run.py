"""A scenario run on the gantry FMU: from a `Scenario` to a `Log` with its provenance."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np
import pandas as pd

from controllers.interface import Controller
from modelica_fmu.errors import InputError
from pyfmi_runner.campaign import scenario_setup, setup_table
from pyfmi_runner.compiled_loop import compiled_loop
from pyfmi_runner.controller_file import controller_of
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.log import MEASURED, Log
from pyfmi_runner.loop import Progress, Rows, python_loop
from pyfmi_runner.plan import Plan, make_plan
from pyfmi_runner.plant import check_gantry
from pyfmi_runner.scenario import Scenario, scenario_text

__all__ = ["RunResult", "make_scenario_controller", "run_scenario"]


@dataclass(frozen=True, eq=False)
class RunResult:
    """A run's log, whole or as far as it came, and how it ended."""

    log: Log
    outcome: str  # "done", "cancelled", "failed"
    reason: str  # one sentence where it is not "done"
    seconds: float  # wall time of the stepping, compilation left out


def run_scenario(
    scenario: Scenario,
    fmu: FmuFile,
    *,
    compiled: bool = True,
    progress: Progress | None = None,
    controller: Controller | None = None,
) -> RunResult:
    """Runs `scenario` on `fmu` in the compiled or in the Python loop; both give the same bits.

    `controller`: an own controller instead of the scenario's. Raises InputError for a parameter,
    controller or workpiece that the scenario names wrongly; a run that fails on the way is a result
    with outcome "failed".
    """
    check_gantry(fmu)
    plan = make_plan(scenario)
    chosen = controller or make_scenario_controller(scenario)
    loop = compiled_loop if compiled else python_loop
    with FmuSession(fmu, parameters=plan.parameters) as session:
        rows = loop(session, plan, chosen, scenario.sensors, progress)
    outcome = "failed" if rows.failure else "cancelled" if rows.cancelled else "done"
    reason = rows.failure or (
        f"cancelled after {rows.done} of {plan.samples} samples" if rows.cancelled else ""
    )
    return RunResult(
        _log(scenario, plan, rows, fmu, outcome, reason), outcome, reason, rows.seconds
    )


def make_scenario_controller(
    scenario: Scenario, file: str | os.PathLike[str] | None = None
) -> Controller:
    """The controller that a scenario names, with its gains: one of ours, or a Python file. Raises
    InputError for unknown names and a file that cannot be used; `file`: where they stand.
    """
    try:
        return controller_of(scenario.controller, scenario.gains)
    except ValueError as error:
        raise InputError(
            str(error),
            file=file,
            field="controller",
            hint="`pneugantry list controllers` and `pneugantry list gains` name them",
        ) from None


def _log(
    scenario: Scenario, plan: Plan, rows: Rows, fmu: FmuFile, outcome: str, reason: str
) -> Log:
    n = rows.done
    columns = {
        "time": np.arange(n) * scenario.timing.period,
        "u_x": rows.commands[:n, 0],
        "u_z": rows.commands[:n, 1],
    }
    columns |= {name: rows.measured[:n, column] for column, name in enumerate(MEASURED)}
    columns |= {
        "f_nd": plan.f_nd[:n],
        "v_td": plan.v_td[:n],
        "theta": rows.theta[:n],
        "phase": plan.phase[:n].astype(float),
    }
    return Log(pd.DataFrame(columns), scenario.name, _provenance(scenario, fmu, outcome, reason))


def _provenance(scenario: Scenario, fmu: FmuFile, outcome: str, reason: str) -> dict[str, Any]:
    return {
        "setup": setup_table(scenario_setup(scenario)),
        "scenario": scenario_text(scenario),
        "seed": scenario.seed,
        "fmu": {"file": fmu.path.name, "sha256": fmu.sha256},
        "parameters": dict(scenario.plant),
        "versions": _versions(),
        "outcome": outcome,
        "reason": reason,
    }


@cache
def _versions() -> dict[str, str]:
    """Read from the packages' files, which takes as long as a second of simulation."""
    return {name: version(name) for name in ("pneugantry", "fmpy", "numpy", "numba")} | {
        "python": platform.python_version()
    }
