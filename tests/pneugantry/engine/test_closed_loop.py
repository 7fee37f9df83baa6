"""The gantry's loop run again from the engine's values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pneugantry.plants.gantry.closed_loop import augmented_of, left_out, rerun
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.fmu import FmuFile

CAMPAIGNS = Path(__file__).parents[4] / "shared" / "campaigns"
VALUES = {
    "axis_x.m": 11.0,
    "sensors.f_x.scale": 1.1,
    "sensors.f_x.bias": 0.5,
    "sensors.f_x.from.f_z": 0.06,
    "sensors.f_z.from.f_x": 0.03,
    "sensors.v_z.lag": 0.004,
    "sensors.v_z.delay": 0.002,
    "sensors.v_x.scale": 1.002,
    "sensors.f_ax.bias": 0.3,
    "timing.delay": 0.003,
}


def test_engine_s_values_are_the_errors_of_the_rig_s_sensors() -> None:
    found = augmented_of(FmuFile.read(build_fmu().path), VALUES)
    assert found.plant == {"axis_x.m": 11.0}
    assert found.delay == 0.003
    s = {k.removeprefix("sensors."): v for k, v in found.sensors.items()}
    true = np.array([3.0, 20.0])
    own = np.array([1.1 * true[0] + 0.5, true[1]])  # without the other channel
    read = np.array([own[0] + 0.06 * own[1], own[1] + 0.03 * own[0]])
    said = [
        s["gain_f_x"] * true[0] + s["crosstalk_f_x"] * true[1] + s["bias_f_x"],
        s["gain_f_z"] * true[1] + s["crosstalk_f_z"] * true[0] + s["bias_f_z"],
    ]
    np.testing.assert_allclose(said, read, rtol=1e-12)
    assert s["tau_v_z"] == pytest.approx(0.006)
    assert s["gain_f_ax"] == 1.0


def test_what_a_rerun_cannot_have_is_told() -> None:
    assert left_out(VALUES) == ["sensors.f_ax.bias", "sensors.v_x.scale"]
    assert left_out({"sensors.v_x.scale": 1.0, "axis_x.m": 3.0}) == []


@pytest.mark.slow
@pytest.mark.skipif(not CAMPAIGNS.is_dir(), reason="no stored campaigns")
def test_a_loop_without_a_gap_runs_again_at_its_floor() -> None:
    run = read_campaign(CAMPAIGNS / "nominal").logs["contour_straight"]
    fmu = FmuFile.read(build_fmu().path)
    found = rerun(fmu, run, {"contact.z_0": run.setup.z_0, "axis_x.s_start": run.setup.start_x})
    assert found is not None
    assert found["augmented"] == pytest.approx(found["floor"], rel=0.3)
    slow = rerun(fmu, run, {"timing.delay": 0.02})
    assert slow is not None
    assert slow["augmented"] > 1.5 * slow["floor"]
