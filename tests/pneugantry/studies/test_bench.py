"""The bench compares like with like: its C master gives the bits of our loop, its rows are those
that docs/reference/cli.md promises.
"""

from __future__ import annotations

import numpy as np
import pytest

from controllers.pi_fv import PiFv
from modelica_fmu.errors import InputError
from pneugantry.speed.c_master import c_loop
from pneugantry.speed.costs import EFFECTS, against_runs
from pneugantry.speed.measure import REFERENCE, measure_paths, path_rows
from pneugantry.speed.paths import PATHS, Experiment, StepPath, Unavailable
from pneugantry.speed.step_profile import profile_step
from pyfmi_runner.build import build_fmu
from pyfmi_runner.compiled_loop import compiled_loop
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.loop import Rows
from pyfmi_runner.plan import make_plan
from pyfmi_runner.scenario import Scenario
from pyfmi_runner.timing import LoopTiming

PHASES = {"approach": (0.0, 1.0), "contact": (1.0, 1.5), "contour": (1.5, 3.0)}


@pytest.fixture(scope="module")
def file() -> FmuFile:
    return FmuFile.read(build_fmu().path)


@pytest.mark.parametrize(
    "timing", [LoopTiming(), LoopTiming(delay=0.0015, jitter=0.0002)], ids=["at once", "late"]
)
def test_the_c_master_gives_the_bits_of_the_compiled_loop(
    file: FmuFile, timing: LoopTiming
) -> None:
    scenario = Scenario(workpiece="curved", start_z=0.087, phases=PHASES, timing=timing, seed=4)
    plan = make_plan(scenario)
    found: list[Rows] = []
    for loop in (c_loop, compiled_loop):
        with FmuSession(file, parameters=plan.parameters) as fmu:
            found.append(loop(fmu, plan, PiFv(), scenario.sensors))
    for name in ("commands", "measured", "theta", "done"):
        assert np.array_equal(getattr(found[0], name), getattr(found[1], name)), name


def test_the_c_master_refuses_what_it_does_not_do(file: FmuFile) -> None:
    scenario = Scenario(workpiece="straight", phases=PHASES)
    with FmuSession(file) as fmu, pytest.raises(InputError, match="C master"):
        c_loop(fmu, make_plan(scenario), PiFv(), scenario.sensors._replace(bias_f_z=1.0))


def test_every_path_runs_and_the_rows_hold_the_ratio_to_c(file: FmuFile) -> None:
    experiment = Experiment.of(file, Scenario(workpiece="straight", start_z=0.038, phases=PHASES))
    rows, missing = path_rows(measure_paths(experiment, 1))
    assert {row.path for row in rows} | set(missing) == {path.name for path in PATHS}
    assert rows[0].path == REFERENCE
    for row in rows:
        assert row.ratio_to_c == pytest.approx(row.us_per_step / rows[0].us_per_step)
        assert 0 < row.fastest <= row.us_per_step


def test_a_library_that_is_absent_is_named_and_the_others_go_on(file: FmuFile) -> None:
    def absent(_: Experiment) -> float:
        raise Unavailable("nosuchlib (not installed)")

    experiment = Experiment.of(
        file, Scenario(workpiece="straight", phases={"contact": (0.0, 0.1), "contour": (0.1, 0.2)})
    )
    rows, missing = path_rows(
        measure_paths(experiment, 2, (*PATHS[:1], StepPath("absent", absent)))
    )
    assert [row.path for row in rows] == [REFERENCE]
    assert missing == {"absent": "nosuchlib (not installed)"}


def test_costs_and_profile_have_their_columns(file: FmuFile) -> None:
    (runs,) = against_runs(file, 1, (2,))
    assert runs["ms_stepping"] > 0
    assert all(name in file.variables for _, parameters in EFFECTS for name in parameters)
    profile = {row["function"]: row for row in profile_step(file)}
    assert (
        4 < profile["model_rates"]["calls_per_step"] < 12
    )  # four of Runge-Kutta, one for the new command, and the events'
    assert profile["all of it"]["share"] == 1.0
