"""In which regime of the motion a view misfits, in words."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pneugantry.engine.answer.regimes import regime_of
from pneugantry.engine.fitting.noise import LONGEST
from pneugantry.engine.plant import Plant, Record, Signal

ROWS = 1000
PLANT = Plant("toy", Path("toy.mo"), "Toy", ("u",), (Signal("y", "y", 0.01),), {}, (), {})


@pytest.mark.parametrize("rate", [1, 2])
def test_a_view_may_have_more_rows_than_its_record(rate: int) -> None:
    u = np.sin(np.linspace(0, 20, ROWS))
    record = Record("one", 2e-3, {"u": u}, {"y": np.zeros(ROWS)}, {})
    view: Any = SimpleNamespace(signals=("u",), decimation=1, depends_on=lambda _: False)
    wrong = np.repeat(u, rate)[LONGEST:] > 0.5
    assert regime_of(PLANT, view, [(record, wrong.astype(float))]) == "u > 0"
