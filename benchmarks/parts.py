"""What a row costs in the parts that the gantry is cut into, beside the whole FMU:
`python -m benchmarks.parts`.

Random commands over 8 s at 2 ms; 40 runs in one call, each with another value of one parameter.
"all effects": parts in which every parameter may move; "no effect": pieces of them in which what is
off on every rig moves alone. The FMU steps the same commands at 1 ms.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from pneugantry.engine.plant import thinned
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.build import build_views
from pneugantry.engine.views.synthetic import Nominal
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
    instants = np.asarray(PERIOD * np.arange(ROWS), dtype=np.float64)
    hold = np.repeat(np.random.default_rng(0).uniform(-1.5, 1.5, (ROWS // 400, 2)), 400, axis=0)
    with Replayer(FmuFile.read(build_fmu().path)) as fmu:
        log = _log(instants, hold, fmu.drive(setup, hold, instants))
        cost = {"FMU, 1 ms": _fastest(lambda: fmu.drive(setup, hold, instants)) / ROWS}
    plant = plant_of(thinning=rules.thinning)
    record = thinned(record_of("random", LoggedRun(setup, log)), rules.thinning)
    views = build_views(plant, MEASURED, cache, record.period, rules)
    nuisances = [n.parameter for n in plant.nuisances]
    for what in ("all effects", "no effect"):
        for view in views:
            name = next(n for n in nuisances if n in view.defaults)
            values = [{name: view.defaults[name] * (1 + 1e-9 * i)} for i in range(RUNS)]
            seconds = _fastest(partial(view.simulate, [(record, v) for v in values]))
            cost[f"{view.name}, {what}"] = seconds / (record.rows * RUNS)
            view.prepare([*nuisances, *record.parameters], {})
    whole = Nominal(plant, MEASURED, cache)
    cost["whole plant, one run"] = _fastest(lambda: whole.run(record)) / record.rows
    return {name: 1e6 * seconds for name, seconds in cost.items()}


def _log(instants: np.ndarray, commands: np.ndarray, outputs: np.ndarray) -> Log:
    columns = {"time": instants, "u_x": commands[:, 0], "u_z": commands[:, 1]}
    return Log(pd.DataFrame(columns | dict(zip(MEASURED, outputs.T, strict=True))))


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
        print(f"{name:26} {microseconds:6.3f} us per row")
