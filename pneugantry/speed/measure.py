"""`bench`: all paths in turn, several rounds of it, so that whatever else the machine does meets
all of them alike.
"""

from __future__ import annotations

import os
import platform
import statistics
import time
from collections.abc import Iterable, Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

from modelica_fmu.toolchain import find_compiler, host_platform
from pneugantry.speed.paths import PATHS, Experiment, StepPath, Unavailable, quiet

__all__ = ["REFERENCE", "Row", "machine", "measure_paths", "path_rows"]

REFERENCE = "C master loop"


class Row(NamedTuple):
    """One path; times are CPU time of this process, median over the rounds."""

    path: str
    us_per_step: float
    ratio_to_c: float
    fastest: float  # us a step, least of the rounds
    rounds: int


def measure_paths(
    experiment: Experiment, rounds: int, paths: Iterable[StepPath] = PATHS
) -> Iterator[tuple[str, float | str]]:
    """(path, us a step) for each path of each round, or (path, why it is missing). The first round
    warms up and is not told.
    """
    left = list(paths)
    for count in range(rounds + 1):
        for path in list(left):
            part = experiment.shortened(path.share)
            try:
                with quiet():
                    seconds = path.run(part)
            except Unavailable as reason:
                left.remove(path)
                yield path.name, str(reason)
                continue
            if count > 0:
                yield path.name, 1e6 * seconds / part.plan.samples


def path_rows(measured: Iterable[tuple[str, float | str]]) -> tuple[list[Row], dict[str, str]]:
    """Rows in the order of the paths, and the paths that are missing with the reason."""
    times: dict[str, list[float]] = {}
    missing = {}
    for name, value in measured:
        if isinstance(value, str):
            missing[name] = value
        else:
            times.setdefault(name, []).append(value)
    c = statistics.median(times[REFERENCE])
    rows = [
        Row(name, statistics.median(ts), statistics.median(ts) / c, min(ts), len(ts))
        for name, ts in times.items()
    ]
    return rows, missing


def machine() -> dict[str, Any]:
    """What the numbers were taken on."""
    names = ("fmpy", "numba", "libcosimpy", "ecospy")
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": load,
        "system": platform.platform(),
        "python": platform.python_version(),
        "compiler": find_compiler(host_platform()).version,
        "versions": {name: _version(name) for name in names},
        "taken": time.strftime("%Y-%m-%d %H:%M"),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next(
        (line.partition(":")[2].strip() for line in lines if line.startswith("model name")),
        platform.machine(),
    )


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
