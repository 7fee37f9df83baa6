"""The thesis' own sim-to-real gap: what it measured (Tables 3.9, 3.10, 3.12) against what a
simulation gives, factor by factor.

First from the print alone: how far Table 4.7 (modelled edge) and Table 4.8 (measured edge) are from
Table 3.12. Then on our plant: edge, contact and scored windows in every combination, and on top of
the best one the friction scatter of Tables C.1, C.2, tau over x, and every effect of the catalogue
at its usual size. A combination's score is the log likelihood of the measured cells.

The tests of the parts (Fig. 4.14, Tables 4.1-4.5) rank their own rivals: `gap_tests`.

A cell's prediction is the mean over draws of the edge; its variance is that of the draws, plus that
of the print's rounding, plus (TOLERANCE of the prediction) squared for a rig that is nowhere quite
the drawing. Student's t with few degrees of freedom: ME is a single sample, and may stray.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from controllers.catalogue import make_controller
from modelica_fmu.errors import RunError
from pneugantry.thesis.conditions import CHOICE, SOFT, Choice, Run, scenario_of
from pneugantry.thesis.gap_tests import PartTest, part_tests
from pneugantry.thesis.printed import COLUMNS, Printed, printed_rows
from pneugantry.thesis.run_store import RunStore
from pneugantry.thesis.runner import Tell, Workers
from pneugantry.thesis.scores import score_log
from pneugantry.thesis.structures import NOMINAL, Structure, catalogue_structures, scatter
from pneugantry.thesis.tables import RESOLUTION, run_of
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.run import run_scenario

__all__ = ["Combination", "Gap", "GapCell", "PrintGap", "Ranked", "measured_cells", "run_gap"]

Array = NDArray[np.float64]
TOLERANCE, FREEDOM = 0.10, 4.0  # of a prediction; of Student's t
DRAWS = 4  # of the edge
MOTION = 9.0  # s, of the contouring phase: Table 3.12's runs last about ten
EDGES = ("no finish", "waves", "random angle")
CONTACTS = {"K_c 1e4": SOFT, "K_c 5e4": CHOICE}
WINDOWS = {  # s: quiet time before the speed is asked for, motion left out, motion scored
    "motion": (0.0, 0.0, MOTION),
    "from 3.3 s before": (3.32, 0.0, 6.5),
    "steady motion": (0.0, 2.0, MOTION),
}
TABLES = ("3.9", "3.10", "3.12")  # each may have been scored over a window of its own
CLEAR = 3.0  # log units: odds of 20 to 1
STRAYS = (
    2.0  # standard deviations: a column whose cells lie further off on average is not explained
)


class GapCell(NamedTuple):
    """A measured number."""

    table: str
    row: str
    workpiece: str
    column: str
    value: float

    @property
    def half_step(self) -> float:
        """Half the step of the print."""
        return 0.5 * RESOLUTION[self.column.split()[1]]


class PrintGap(NamedTuple):
    """How far the thesis' simulations are from its measurement, a column of Table 3.12."""

    column: str
    modelled: float  # root mean square of the difference, Table 4.7
    measured: float  # the same, Table 4.8
    resolution: float  # step of the print

    @property
    def explained(self) -> float:
        """Share of the squared gap that the measured edge takes away; the print's own rounding
        left out. < 0: it adds.
        """
        rounding = 2.0 * self.resolution**2 / 12.0
        before = max(self.modelled**2 - rounding, 1e-12)
        return 1.0 - max(self.measured**2 - rounding, 0.0) / before


@dataclass(frozen=True)
class Combination:
    """A set-up of simulation and scoring."""

    edge: str
    contact: str
    windows: tuple[str, ...]  # one a table of TABLES


@dataclass(frozen=True)
class Ranked:
    """A factor and what it is worth."""

    name: str
    family: str
    gain: float  # log units over the reference
    probability: float  # among its rivals


@dataclass(frozen=True)
class Gap:
    """The answer."""

    printed: list[PrintGap]
    factors: list[Ranked]  # each one changed alone in the best combination: what it loses
    structures: list[Ranked]  # on top of the best combination
    best: Combination
    cells: list[GapCell]
    predicted: Array  # of the best combination
    deviation: Array  # its standard deviation
    unexplained: list[str]  # columns that stray
    tests: list[PartTest]  # of the parts, by test, best first

    @property
    def strays(self) -> Array:
        """Measured - predicted, in standard deviations."""
        return (np.array([c.value for c in self.cells]) - self.predicted) / self.deviation


def measured_rows() -> list[Printed]:
    return [row for row in printed_rows() if row.table in TABLES]


def measured_cells() -> list[GapCell]:
    return [
        GapCell(row.table, row.row, row.workpiece, column, value)
        for row in measured_rows()
        for column, value in zip(COLUMNS, row.values, strict=True)
        if value is not None
    ]


def print_gaps() -> list[PrintGap]:
    """From the tables alone."""
    by_table = {
        table: np.array([row.values for row in printed_rows() if row.table == table], dtype=float)
        for table in ("3.12", "4.7", "4.8")
    }
    far = {
        table: np.sqrt(np.mean((by_table[table] - by_table["3.12"]) ** 2, axis=0))
        for table in ("4.7", "4.8")
    }
    return [
        PrintGap(column, float(far["4.7"][k]), float(far["4.8"][k]), RESOLUTION[column.split()[1]])
        for k, column in enumerate(COLUMNS)
    ]


def gap_runs(edge: str, choice: Choice, structure: Structure, draw: int) -> list[Run]:
    """The run behind each measured line, on one draw of the edge."""
    runs = []
    for row in measured_rows():
        run = run_of(row).changed(
            choice=_long(choice),
            plant=structure.plant,
            sensors=structure.sensors,
            delay=structure.delay,
            seed=draw,
        )
        if edge == "no finish":
            run = run.changed(finish="none")
        elif edge == "waves":
            run = run.changed(slide=0.01 * draw)
        else:
            run = run.changed(finish="random", draw=2000 + draw)
        runs.append(run)
    return runs


def _long(choice: Choice) -> Choice:
    return Choice(
        contact_stiffness=choice.contact_stiffness,
        contact_damping=choice.contact_damping,
        ddfm_limit=choice.ddfm_limit,
        motion=MOTION,
    )


def predicted_cells(
    fmu: str, edge: str, contact: str, structure: Structure, draws: int = DRAWS
) -> dict[str, Array] | None:
    """Cells (draws, cells) under each window; None where the model cannot finish a run."""
    file = FmuFile.read(fmu)
    found: dict[str, list[list[float]]] = {window: [] for window in WINDOWS}
    for draw in range(1 if edge == "no finish" else draws):
        scored: dict[str, list[float]] = {window: [] for window in WINDOWS}
        for row, run in zip(
            measured_rows(), gap_runs(edge, CONTACTS[contact], structure, draw), strict=True
        ):
            try:
                windows = _run_windows(run, file)
            except RunError:
                return None
            for window, scores in windows.items():
                pairs = zip(row.values, scores, strict=True)
                scored[window] += [ours for value, ours in pairs if value is not None]
        for window, cells in scored.items():
            found[window].append(cells)
    return {window: np.array(rows) for window, rows in found.items()}


def _run_windows(run: Run, file: FmuFile) -> dict[str, tuple[float, ...]]:
    scenario = scenario_of(run)
    options = {"gains": run.gains} if run.gains else {}
    result = run_scenario(scenario, file, controller=make_controller(run.controller, **options))
    if result.outcome != "done":
        raise RunError(result.reason)
    return {
        name: score_log(
            result.log, quiet=quiet, skip=skip, motion=motion, v_td=run.v_td, f_nd=scenario.f_nd
        )
        for name, (quiet, skip, motion) in WINDOWS.items()
    }


def likelihood(cells: Sequence[GapCell], drawn: Array) -> tuple[float, Array, Array]:
    """Log likelihood of the measured cells, their prediction and its standard deviation; drawn:
    (draws, cells).
    """
    mean = drawn.mean(axis=0)
    n = len(drawn)
    spread = drawn.var(axis=0, ddof=1) * (1.0 + 1.0 / n) if n > 1 else np.zeros_like(mean)
    rounding = np.array([cell.half_step for cell in cells]) ** 2 / 3.0
    sd = np.sqrt(spread + rounding + (TOLERANCE * mean) ** 2)
    values = np.array([cell.value for cell in cells])
    return float(student.logpdf(values, FREEDOM, mean, sd).sum()), mean, sd


def chosen_windows(cells: Sequence[GapCell], drawn: dict[str, Array], c: Combination) -> Array:
    """Each table's cells under the window that the combination gives it."""
    window = dict(zip(TABLES, c.windows, strict=True))
    columns = [drawn[window[cell.table]][:, k] for k, cell in enumerate(cells)]
    return np.stack(columns, axis=1)


def _kept_cells(
    fmu: str, edge: str, contact: str, structure: Structure, draws: int
) -> dict[str, Any]:
    """`predicted_cells` as JSON holds it."""
    found = predicted_cells(fmu, edge, contact, structure, draws)
    return {"windows": found and {window: rows.tolist() for window, rows in found.items()}}


def _cells_from(value: Mapping[str, Any]) -> dict[str, Array] | None:
    windows = value["windows"]
    return windows and {window: np.array(rows) for window, rows in windows.items()}


def run_gap(
    fmu: Path,
    *,
    workers: int = 2,
    tell: Tell | None = None,
    draws: int = DRAWS,
    store: RunStore | None = None,
) -> Gap:
    """Runs everything that the store does not hold, and ranks."""
    cells, path = measured_cells(), str(fmu)
    with Workers(fmu, workers, tell, store) as pool:

        def started(edge: str, contact: str, structure: Structure) -> Future[Any]:
            name = f"gap {edge} {contact} {structure} {draws}"
            return pool.keep(name, _kept_cells, path, edge, contact, structure, draws)

        parts = pool.keep("gap parts", _kept_tests, path)
        pairs = list(product(EDGES, CONTACTS))
        jobs = [started(edge, contact, NOMINAL) for edge, contact in pairs]
        drawn = {p: _cells_from(job.result()) for p, job in zip(pairs, jobs, strict=True)}
        worth = _combinations(cells, drawn)
        best = max(worth, key=worth.__getitem__)
        others = [*scatter(), *catalogue_structures(FmuFile.read(fmu))]
        jobs = [started(best.edge, best.contact, s) for s in others]
        added = {
            s: likelihood(cells, chosen_windows(cells, found, best))[0]
            for s, job in zip(others, jobs, strict=True)
            if (found := _cells_from(job.result())) is not None
        }
    reference = drawn[best.edge, best.contact]
    assert reference is not None  # it scored best
    chosen = chosen_windows(cells, reference, best)
    total, predicted, deviation = likelihood(cells, chosen)
    return Gap(
        print_gaps(),
        _factors(worth, best),
        _structures(added, total),
        best,
        cells,
        predicted,
        deviation,
        _unexplained(cells, predicted, deviation),
        [PartTest(*test) for test in parts.result()],
    )


def _kept_tests(fmu: str) -> list[PartTest]:
    return part_tests(FmuFile.read(fmu))


def _combinations(
    cells: Sequence[GapCell], drawn: dict[tuple[str, str], dict[str, Array] | None]
) -> dict[Combination, float]:
    worth = {}
    for (edge, contact), found in drawn.items():
        if found is None:
            continue
        for windows in product(WINDOWS, repeat=len(TABLES)):
            c = Combination(edge, contact, windows)
            worth[c] = likelihood(cells, chosen_windows(cells, found, c))[0]
    return worth


def _factors(worth: dict[Combination, float], best: Combination) -> list[Ranked]:
    """Each factor changed alone to each of its other values."""
    rivals = {
        "edge": {e: replace(best, edge=e) for e in EDGES},
        "contact": {c: replace(best, contact=c) for c in CONTACTS},
    }
    for k, table in enumerate(TABLES):
        rivals[f"window of {table}"] = {
            w: replace(best, windows=(*best.windows[:k], w, *best.windows[k + 1 :]))
            for w in WINDOWS
        }
    found = []
    for factor, changed in rivals.items():
        gains = {v: worth[c] - worth[best] for v, c in changed.items() if c in worth}
        weight = sum(math.exp(g) for g in gains.values())
        ranked = [
            Ranked(f"{factor}: {v}", factor, g, math.exp(g) / weight) for v, g in gains.items()
        ]
        found += sorted(ranked, key=lambda r: -r.gain)
    return found


def _structures(added: dict[Structure, float], total: float) -> list[Ranked]:
    gains = {s: value - total for s, value in added.items()} | {NOMINAL: 0.0}
    highest = max(gains.values())
    weight = sum(math.exp(g - highest) for g in gains.values())
    found = [
        Ranked(
            s.name if s is not NOMINAL else "nothing", s.family, g, math.exp(g - highest) / weight
        )
        for s, g in gains.items()
    ]
    return sorted(found, key=lambda r: -r.gain)


def _unexplained(cells: Sequence[GapCell], predicted: Array, deviation: Array) -> list[str]:
    strays = np.abs(np.array([c.value for c in cells]) - predicted) / deviation
    return [
        column
        for column in COLUMNS
        if np.mean([s for s, c in zip(strays, cells, strict=True) if c.column == column]) > STRAYS
    ]
