"""What a row costs in the parts that the gantry is cut into, beside the whole FMU:
`python -m benchmarks.parts`.

Random commands over 8 s at 2 ms; 40 runs in one call. The FMU steps the same commands at 1 ms.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from pneugantry.engine.plant import Record, thinned
from pneugantry.engine.rules import Rules
from pneugantry.engine.synthetic import Nominal
from pneugantry.engine.views import build_views
from pneugantry.plants.gantry.describe import plant_of, record_of
from pyfmi_runner.build import build_fmu, cache_folder
from pyfmi_runner.campaign import LoggedRun, LogSetup
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import MEASURED, PERIOD, Log
from pyfmi_runner.replay import Replayer

RUNS, REPEATS, ROWS = 40, 5, 8000


def measure() -> dict[str, Any]:
    """Microseconds per row and run: of each part, of the whole plant as a part, of the FMU."""
    rules, cache, setup = Rules(), cache_folder() / "parts", LogSetup(start_x=0.5, start_z=0.05)
    time_ = PERIOD * np.arange(ROWS)
    hold = np.repeat(np.random.default_rng(0).uniform(-1.5, 1.5, (ROWS // 400, 2)), 400, axis=0)
    with Replayer(FmuFile.read(build_fmu().path)) as fmu:
        log = _log(time_, hold, fmu.drive(setup, hold, time_))
        cost = {"FMU, 1 ms": _fastest(lambda: fmu.drive(setup, hold, time_)) / ROWS}
    plant = plant_of(thinning=rules.thinning)
    record = thinned(record_of("random", LoggedRun(setup, log)), rules.thinning)
    views = build_views(plant, MEASURED, cache, record.period, rules.observer, rules.band)
    for view in views:
        values: list[dict[str, float]] = [{} for _ in range(RUNS)]
        cost[f"view {view.name}"] = _cost(lambda v=view, x=values: v.simulate(record, x), record)
    whole = Nominal(plant, MEASURED, cache)
    cost["whole plant, one run"] = _fastest(lambda: whole.run(record)) / record.rows
    return {name: 1e6 * seconds for name, seconds in cost.items()}


def _log(instants: np.ndarray, commands: np.ndarray, outputs: np.ndarray) -> Log:
    columns = {"time": instants, "u_x": commands[:, 0], "u_z": commands[:, 1]}
    return Log(pd.DataFrame(columns | dict(zip(MEASURED, outputs.T, strict=True))))


def _cost(run: Callable[[], object], record: Record) -> float:
    return _fastest(run) / (record.rows * RUNS)


def _fastest(run: Callable[[], object]) -> float:
    """s, least of several."""
    found = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        run()
        found.append(time.perf_counter() - began)
    return min(found)


if __name__ == "__main__":
    for name, microseconds in measure().items():
        print(f"{name:24} {microseconds:6.3f} us per row")
