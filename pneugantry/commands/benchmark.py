"""`pneugantry benchmark`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.progress import bar

HELP = """Speed of every path that steps the FMU, side by side in one run, and what a run costs.

CPU time of the stepping, set-up left out; median over the rounds, and ratio to a master loop in
C that does the same.

  pneugantry benchmark                 paths, costs and the profile of a step: some 40 s
  pneugantry benchmark --rounds 3 --only-paths --json out/benchmark.json"""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--rounds",
        type=int,
        default=7,
        metavar="N",
        help="repeats of every measurement (default: %(default)s)",
    )
    command.add_argument("--only-paths", action="store_true", help="leave out costs and profile")
    command.add_argument(
        "--fmu", metavar="FILE.fmu", type=Path, help="another FMU with the gantry's interface"
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from pneugantry.api.inputs import fmu_from
    from pneugantry.speed.costs import against_cores, against_effects, against_runs, against_time
    from pneugantry.speed.measure import machine, measure_paths, path_rows
    from pneugantry.speed.paths import PATHS, Experiment
    from pneugantry.speed.step_profile import profile_step

    if options.rounds < 1:
        raise InputError(
            f"is {options.rounds}, expected >= 1", field="--rounds", hint="repeat at least once"
        )
    file = fmu_from(options.fmu)
    measured = measure_paths(Experiment.of(file), options.rounds)
    rows, missing = path_rows(bar(measured, options.rounds * len(PATHS), "paths"))
    print(f"{'path':<38} {'us a step':>9} {'/ C':>7} {'least':>8}")
    for row in rows:
        print(f"{row.path:<38} {row.us_per_step:9.2f} {row.ratio_to_c:7.2f} {row.fastest:8.2f}")
    for name, reason in missing.items():
        print(f"{name:<38} not installed: {reason}")
    result: dict[str, Any] = {
        "schema": "bench/1",
        "rows": [row._asdict() for row in rows],
        "missing": missing,
        "machine": machine(),
    }
    if options.only_paths:
        return result, 0
    tables = {
        "time": lambda: against_time(file, options.rounds),
        "runs": lambda: against_runs(file, options.rounds),
        "effects": lambda: against_effects(file, options.rounds),
        "cores": lambda: against_cores(file.path, 200),
        "profile": lambda: profile_step(file),
    }
    result["cost"] = {}
    for name in bar(tables, len(tables), "costs"):
        result["cost"][name] = tables[name]()
        _print_table(name, result["cost"][name])
    return result, 0


def _print_table(name: str, rows: list[dict[str, Any]]) -> None:
    print(f"\n{name}: " + " | ".join(rows[0]))
    for row in rows:
        print(
            "  " + " | ".join(f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values())
        )
