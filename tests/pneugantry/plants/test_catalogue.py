"""The gantry's catalogue, and the converters that its readings show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from modelica_fmu.errors import InputError
from pneugantry.engine.views import part_of
from pneugantry.plants.gantry.catalogue import QUANTISATION, catalogue_of
from pneugantry.plants.gantry.converter import converter_step
from pneugantry.plants.gantry.describe import plant_of
from pyfmi_runner.build import cache_folder
from pyfmi_runner.log import MEASURED


def test_the_catalogue_holds_every_effect_of_the_specification_with_its_block() -> None:
    catalogue = catalogue_of()
    assert len({effect.name for effect in (*catalogue.values(), QUANTISATION)}) == 30
    assert catalogue["valve_delay/z"].block == "valve_z"
    assert catalogue["presliding/x"].block == "friction_x"
    assert catalogue["loop_delay"].block == "timing"
    assert {
        effect.axis for effect in catalogue.values() if effect.name == "friction_direction"
    } == {"z"}


def test_every_parameter_of_an_effect_is_the_model_s_a_sensor_s_or_the_loop_s() -> None:
    part = part_of(plant_of(), MEASURED, (), cache_folder() / "parts")
    known = {v.name for v in part.variables}
    for effect in catalogue_of().values():
        for form in effect.forms:
            for name in (*form.settings, *(p.name for p in form.parameters)):
                sensor = name.startswith("sensors.") and name.split(".")[1] in MEASURED
                assert name in known or sensor or name == "timing.delay", (effect.key, name)


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


@pytest.mark.parametrize(
    ("step", "found"), [(0.0, False), (0.01, False), (0.05, True), (0.5, True)]
)
def test_a_coarse_converter_is_seen_and_a_logs_own_rounding_is_not(
    step: float, found: bool
) -> None:
    generator = np.random.default_rng(2)
    level = np.repeat(generator.uniform(0.0, 5.0, 40), 500)
    reading = level + 0.05 * generator.standard_normal(len(level))
    if step:
        reading = step * np.round(reading / step)
    reading = 0.01 * np.round(reading / 0.01)
    measured = converter_step(reading, 0.05)
    assert (measured > 0) == found
    if found:
        assert measured == pytest.approx(step, rel=0.05)


def test_a_coarse_converter_is_seen_on_a_channel_that_mostly_rests_in_one_of_its_cells() -> None:
    generator = np.random.default_rng(6)
    level = np.concatenate([np.full(60_000, 0.05), generator.uniform(0.0, 40.0, 15_000)])
    coarse = 0.17 * np.floor((level + 0.05 * generator.standard_normal(len(level))) / 0.17)
    assert converter_step(0.01 * np.round(coarse / 0.01), 0.05) == pytest.approx(0.17)
    fine = np.concatenate(
        [np.zeros(60_000), level[60_000:] + 0.05 * generator.standard_normal(15_000)]
    )
    assert converter_step(0.01 * np.round(fine / 0.01), 0.05) == 0.0
