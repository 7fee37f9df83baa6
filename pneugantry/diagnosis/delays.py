"""A loop's delays, found by trying: the noise in the commands makes their fit a needle that no
slope leads to.
"""

from __future__ import annotations

import numpy as np

from pneugantry.diagnosis.bench import Bench
from pneugantry.diagnosis.views import TimingView
from pneugantry.engine.catalogue import Form, Parameter
from pyfmi_runner.log import PERIOD

__all__ = ["estimate_delays"]

LONGEST = 200  # samples
SENSED = 80  # samples


def estimate_delays(bench: Bench) -> Form | None:
    """Delay of the commands, whole samples of it between measuring and computing; None where no
    controller runs.
    """
    view = bench.all["timing"]
    assert isinstance(view, TimingView)
    if not view.judged.any():
        return None
    columns = bench.table.columns
    recorded = np.column_stack([columns["u_x"], columns["u_z"]])

    def misfit(late: int, sensed_late: int) -> float:
        return float(np.nansum((recorded - view.shifted(late, sensed_late))[view.judged] ** 2))

    acting = min(range(LONGEST), key=lambda late: misfit(late, 0))
    splits = [
        (acting + extra - sensed, sensed)
        for sensed in range(min(SENSED, acting + 2))
        for extra in (-1, 0, 1)
    ]
    late, sensed_late = min((s for s in splits if s[0] >= 0), key=lambda s: misfit(*s))
    delay = Parameter("timing.delay", 0.0, 0.005, 0.0, 0.2, "s", starts=(late * PERIOD,))
    return Form("found by trying", (delay,), {"timing.sense_delay": sensed_late * PERIOD})
