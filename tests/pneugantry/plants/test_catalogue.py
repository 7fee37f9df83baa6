"""The gantry's catalogue."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from modelica_fmu.errors import InputError
from pneugantry.engine.plant import Record
from pneugantry.engine.views.synthetic import Nominal
from pneugantry.plants.gantry.catalogue import FOLDER, QUANTISATION, catalogue_of, check_names
from pneugantry.plants.gantry.describe import plant_of
from pyfmi_runner.build import build_fmu, cache_folder
from pyfmi_runner.fmu import FmuFile


def test_the_catalogue_holds_every_effect_of_the_specification_with_its_block() -> None:
    catalogue = catalogue_of()
    assert len({effect.name for effect in (*catalogue.values(), QUANTISATION)}) == 30
    assert catalogue["valve_delay/z"].block == "valve_z"
    assert catalogue["presliding/x"].block == "friction_x"
    assert catalogue["loop_delay"].block == "timing"
    assert {
        effect.axis for effect in catalogue.values() if effect.name == "friction_direction"
    } == {"z"}


def test_every_parameter_is_the_model_s_a_sensor_s_or_the_loop_s(tmp_path: Path) -> None:
    fmu = FmuFile.read(build_fmu().path)
    check_names(catalogue_of(), fmu)
    text = (FOLDER / "force_gain.toml").read_text()
    (tmp_path / "old.toml").write_text(text.replace("sensors.f_{axis}.scale", "sensors.gain_f_x"))
    with pytest.raises(InputError, match=r"force_gain/x: sensors.gain_f_x: the gantry has no such"):
        check_names(catalogue_of(tmp_path), fmu)


def test_a_user_adds_an_effect_in_ten_lines(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        '[[effect]]\nname = "leak"\nblock = "valve_{axis}"\naxes = ["z"]\n[[effect.form]]\n'
        '[effect.form.parameters."valve_{axis}.droop"]\nscale = 0.1\nlow = 0.0\nhigh = 1.0\n'
    )
    catalogue = catalogue_of(path)
    assert catalogue["leak/z"].forms[0].parameters[0].name == "valve_z.droop"
    assert catalogue["leak/z"].block == "valve_z"
    assert "presliding/z" in catalogue
    assert list(catalogue_of(tmp_path)) == ["leak/z"]  # a folder stands instead of the gantry's


def test_a_bad_catalogue_names_file_field_and_mend(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        '[[effect]]\nname = "leak"\nblock = '
        '"valve"\n[[effect.form]]\n[effect.form.parameters.a]\nscale = "big"\nlow = 0\nhigh = 1\n'
    )
    with pytest.raises(InputError) as caught:
        catalogue_of(path)
    assert "mine.toml" in str(caught.value)
    assert "a.scale" in str(caught.value)


def test_a_range_of_indices_stands_for_its_members() -> None:
    profile = catalogue_of()["friction_position/z"].forms[0]
    assert [p.name for p in profile.parameters] == [
        f"axis_z.friction.position_table[{i}]" for i in range(1, 12)
    ]


@pytest.mark.usefixtures("unoptimised")
def test_a_cable_that_hardly_pulls_may_still_be_coiled() -> None:
    """Its slope is a force of its own: as a share of the force it would be of no account there."""
    plant, n = plant_of(), 1000
    command = 1.0 + 0.5 * np.sin(0.02 * np.arange(n))
    still = {name: np.zeros(n) for name in plant.inputs}
    record = Record("r", 2e-3, {**still, "u_x": command}, {}, {})
    moved = []
    for rise in (0.0, 4.0):
        values = {**plant.parameters, "axis_x.F_w": 0.0, "axis_x.cable_rise": rise}
        nominal = Nominal(replace(plant, parameters=values), ["axis_x.s"], cache_folder() / "parts")
        moved.append(nominal.run(record)["axis_x.s"])
    assert np.abs(moved[1] - moved[0]).max() > 1e-3
