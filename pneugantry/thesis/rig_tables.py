"""Cells of the tables that the thesis' own tracking runs do not fill: noise (3.3), Jatta's robot
(3.4, 6.1), materials (3.8), friction (3.13, C.1, C.2), lags (4.1-4.5). They count in no share:
noise, friction and lags went into the model as printed, so that ours shows the test, not the rig.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from controllers.catalogue import make_controller
from modelica_fmu.errors import RunError
from pneugantry.thesis.conditions import Run, scenario_of
from pneugantry.thesis.findings import MATERIALS, ROUGHNESS, rough_run
from pneugantry.thesis.lag_readings import READINGS
from pneugantry.thesis.printed import COLUMNS, JATTA_SET_POINTS, printed_rows
from pneugantry.thesis.rig_tests import RAMPS, break_away, rest_noise, viscous
from pneugantry.thesis.runner import Results
from pneugantry.thesis.scores import Scores, score_log
from pneugantry.thesis.tables import Cell
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import LABELS
from pyfmi_runner.run import run_scenario
from pyfmi_runner.sensors import NO_STEPS, Channels, converter_steps

__all__ = ["RIG_TABLES", "jatta_scores", "lag_cells", "material_cells", "part_cells"]

TEST = "test"  # kind of these cells
LARGEST: Channels = (1.0, 0.101, 1.0, 1.0, 250.0, 250.0, 400.0, 157.0)  # Table 3.3
RMS: Channels = (0.3e-3, 0.1e-3, 1.0e-3, 0.5e-3, 0.05, 0.05, 0.05, 0.05)  # Table 3.3
RATIO: Channels = (71.0, 60.0, 60.0, 66.0, 74.0, 74.0, 78.0, 70.0)  # dB, Table 3.3
# N: F_d, F_s of the three ramps, Tables C.1 and C.2
COULOMB = {
    "x": ("C.1", (12.0, 11.0, 11.0), (30.0, 25.0, 21.0)),
    "z": ("C.2", (14.0, 14.0, 16.0), (17.0, 20.0, 23.0)),
}
# Table 3.13: F_d, F_s [N], C [N s/m]; its F_d of z is not the mean of Table C.2
AVERAGES = {"x": (11.0, 25.0, 74.0), "z": (10.0, 20.0, 40.0)}
LAG_TABLES = {("x", 1.0): "4.1", ("x", 0.5): "4.2", ("x", 0.0): "4.3"} | {
    ("z", 0.1): "4.4",
    ("z", 0.0): "4.5",
}
RIG_TABLES = ("3.3", "3.4", "3.8", "3.13", "4.1", "4.2", "4.3", "4.4", "4.5", "C.1", "C.2")


def part_cells(fmu: FmuFile) -> list[Cell]:
    """Tables 3.3, 3.13, C.1 and C.2 from tests on the FMU, and Jatta's lines of 3.4 and 6.1."""
    return [*_noise(), *_friction(fmu), *_jatta(fmu)]


def _noise() -> Iterator[Cell]:
    for sensors, quantum in (("", NO_STEPS), (", 12-bit converter", converter_steps())):
        found = rest_noise(LARGEST, quantum)
        for name, rms, ratio, ours in zip(LABELS, RMS, RATIO, found, strict=True):
            yield Cell("3.3", name + sensors, "RMS of noise", TEST, rms, ours.rms)
            yield Cell("3.3", name + sensors, "largest SNR [dB]", TEST, ratio, ours.ratio)


def _friction(fmu: FmuFile) -> Iterator[Cell]:
    for axis, (table, dynamic, static) in COULOMB.items():
        tests = [break_away(fmu, axis, rate) for rate in RAMPS]
        for k, (test, f_d, f_s) in enumerate(zip(tests, dynamic, static, strict=True), start=1):
            yield Cell(table, f"case {k}", "F_d [N]", TEST, f_d, test.dynamic)
            yield Cell(table, f"case {k}", "F_s [N]", TEST, f_s, test.static)
        f_d = float(np.mean([test.dynamic for test in tests]))
        f_s = float(np.mean([test.static for test in tests]))
        ours = (f_d, f_s, viscous(fmu, axis, f_d))
        names = ("F_d [N]", "F_s [N]", "C [N s/m]")
        for name, printed, value in zip(names, AVERAGES[axis], ours, strict=True):
            yield Cell("3.13", axis, name, TEST, printed, value)


def _jatta(fmu: FmuFile) -> Iterator[Cell]:
    """Another robot's numbers; ours is its controller, at its set points, on our plant."""
    ours = {piece: jatta_scores(fmu, piece) for piece in JATTA_SET_POINTS}
    for row in printed_rows():
        if not row.row.startswith("Jatta"):
            continue
        for column, printed, value in zip(COLUMNS, row.values, ours[row.workpiece], strict=True):
            if printed is not None:
                yield Cell(row.table, row.row, column, "experiment", printed, value)


def jatta_scores(fmu: FmuFile, piece: str) -> Scores:
    """DFV at Jatta's set points. Raises RunError where the FMU fails."""
    f_nd, v_td = JATTA_SET_POINTS[piece]
    run = Run(piece, "dfv", v_td=v_td)
    scenario = replace(scenario_of(run), f_nd=f_nd)
    result = run_scenario(scenario, fmu, controller=make_controller("dfv"))
    if result.outcome != "done":
        raise RunError(f"{scenario.name}: {result.reason}")
    return score_log(result.log, quiet=run.choice.quiet, v_td=v_td, f_nd=f_nd)


def lag_cells(lags: Mapping[str, float]) -> list[Cell]:
    """Tables 4.1-4.5: mean of the printed readings, and the step test on the plant with tau over
    x; lags: of `identified_lags`.
    """
    found = []
    for (axis, where), table in LAG_TABLES.items():
        for way, readings in zip(("filling", "exhausting"), READINGS[axis][where], strict=True):
            printed = sum(readings) / len(readings)
            ours = lags[f"tau_{axis} at {where:g} m, {way}"]
            found.append(
                Cell(table, f"{axis} at {where:g} m, {way}", "tau [s]", TEST, printed, ours)
            )
    return found


def material_cells(results: Results) -> list[Cell]:
    """Table 3.8: the straight edge with the fitted finish at the height whose RMSE f_n is the
    printed one, so that ME f_n alone says something. The steepest finish runs where none reaches
    it.
    """
    rmse = [results[rough_run(share)].rmse_fn for share in ROUGHNESS]
    largest = [results[rough_run(share)].me_fn for share in ROUGHNESS]
    found = []
    for name, (printed_rmse, printed_me) in MATERIALS.items():
        height = float(np.interp(printed_rmse, rmse, ROUGHNESS))
        row = f"{name}, finish x {height:.2f}"
        for column, kind, printed, values in (
            ("ME f_n", "experiment", printed_me, largest),
            ("RMSE f_n", "fitted", printed_rmse, rmse),
        ):
            ours = float(np.interp(height, ROUGHNESS, values))
            found.append(Cell("3.8", row, column, kind, printed, ours))
    return found
