"""Every model of PneuGantry.Validation has a known answer: its FMU's `error` stays below its
`tolerance`.
"""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor

import fmpy
import numpy as np
import pytest

from pyfmi_runner.build import build_fmu, default_model

TEXT = default_model().read_text(encoding="utf-8")
MODELS = re.findall(r"^    model (\w+)", TEXT[TEXT.index("package Validation") :], re.MULTILINE)
STOP, STEP = 1.3, 1e-3  # s


@pytest.fixture(scope="module")
def fmus(tmp_path_factory, without_optimisation):
    """FMU of each model: FMI 2.0 and 3.0 in turn, built side by side."""
    folder = tmp_path_factory.mktemp("validation")
    with without_optimisation(), ThreadPoolExecutor(2) as pool:
        jobs = {
            name: pool.submit(
                build_fmu, f"PneuGantry.Validation.{name}", fmi=("2.0", "3.0")[i % 2], out=folder
            )
            for i, name in enumerate(MODELS)
        }
        return {name: job.result().path for name, job in jobs.items()}


def test_every_component_has_a_validation_model():
    assert len(MODELS) >= 12
    validated = TEXT[TEXT.index("package Validation") :]
    for component in ("Valve", "Friction", "Cylinder", "Edge", "Workpiece"):
        assert re.search(rf"^      {component} \w+", validated, re.MULTILINE), component


@pytest.mark.parametrize("name", MODELS)
def test_the_error_stays_below_the_tolerance(name, fmus):
    description = fmpy.read_model_description(str(fmus[name]))
    tolerance = next(float(v.start) for v in description.modelVariables if v.name == "tolerance")
    result = fmpy.simulate_fmu(
        str(fmus[name]),
        stop_time=STOP,
        step_size=STEP,
        output_interval=STEP,
        output=["error"],
        fmi_type="CoSimulation",
        model_description=description,
    )
    assert len(result) == round(STOP / STEP) + 1
    assert np.all(np.isfinite(result["error"]))
    worst = int(np.argmax(np.abs(result["error"])))
    assert abs(result["error"][worst]) < tolerance, (
        f"|error| = {abs(result['error'][worst]):.3g} at t = {result['time'][worst]:.3f} s"
    )
