"""Faults that readings show by themselves: noise, held readings, a clock; each put into a sound
record.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pneugantry.diagnosis.records import clock_excess, noise_ratio, oddity
from pneugantry.diagnosis.signals import Table, table_of
from pneugantry.truth.campaign import write
from pneugantry.truth.case import draw_case
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.log import SIGMA


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Table:
    folder: Path = tmp_path_factory.mktemp("sound")
    campaign, _ = draw_case(1021, kind="none")
    write(folder, campaign)
    return table_of(read_campaign(folder))


def test_a_sound_record_is_not_odd(sound: Table) -> None:
    assert oddity(sound) is None
    for channel, sigma in SIGMA.items():
        assert noise_ratio(sound.columns[channel], sigma, sound.spans) == pytest.approx(
            1.0, abs=0.03
        )
    assert abs(clock_excess(sound, "x")) < 1e-3
    assert abs(clock_excess(sound, "z")) < 1e-3


def test_a_noisy_channel_is_named(sound: Table) -> None:
    noise = np.random.default_rng(2).normal(0.0, SIGMA["f_z"], sound.rows)
    found = oddity(replace(sound, columns={**sound.columns, "f_z": sound.columns["f_z"] + noise}))
    assert found is not None
    assert (found.block, found.outside) == ("sensors", True)
    assert "f_z" in found.summary
    assert "f_x" not in found.summary


def test_held_readings_are_named(sound: Table) -> None:
    held = sound.columns["v_x"].copy()
    for start in np.random.default_rng(3).integers(0, sound.rows - 20, 30):
        held[start : start + 12] = held[start]
    found = oddity(replace(sound, columns={**sound.columns, "v_x": held}))
    assert found is not None
    assert found.block == "sensors"
    assert "v_x" in found.summary


def test_both_axes_tell_of_a_wrong_clock_and_one_of_them_does_not(sound: Table) -> None:
    slow = {f"v_{axis}": sound.columns[f"v_{axis}"] / 1.03 for axis in "xz"}
    found = oddity(replace(sound, columns={**sound.columns, **slow}))
    assert found is not None
    assert found.block == "timing"
    assert "1.030" in found.summary
    assert oddity(replace(sound, columns={**sound.columns, "v_x": slow["v_x"]})) is None
