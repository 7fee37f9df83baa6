"""The tutorial's motor: its data are what the script records, and its diagnosis finds what was put
in.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from examples.motor.record import CURRENTS, TAU_C, TAU_O, record
from pneugantry.plants.described import diagnose_described

FOLDER = Path(__file__).parents[2] / "examples" / "motor"


@pytest.mark.parametrize(("seed", "name"), enumerate(CURRENTS, start=1))
def test_the_logs_are_what_the_script_records(seed: int, name: str) -> None:
    kept = pd.read_csv(FOLDER / "data" / f"{name}.csv")
    made = record(CURRENTS[name], seed)
    assert (kept - made).abs().max().max() < 1e-3  # integrators differ by less between machines


def test_both_hidden_effects_are_found_with_their_sizes_and_the_other_is_not() -> None:
    found = diagnose_described(FOLDER / "plant.toml")[0].diagnosis
    assert found.verdict == "identified"
    table = {c.effect: c for c in found.causes}
    sizes = {"coulomb_friction": ("tau_c", TAU_C), "constant_torque": ("tau_o", TAU_O)}
    for effect, (parameter, size) in sizes.items():
        assert table[effect].probability > 0.9
        told = table[effect].parameters[parameter]
        assert told.low < size < told.high
    assert "unbalance" not in {key for keys in found.answer_set for key in keys}
    assert found.gap is not None
    assert found.gap.augmented < 1.1
    assert found.gap.nominal > 100
