"""Logs too short to be diagnosed are named, and the rest goes on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from modelica_fmu.errors import InputError
from pneugantry.plants.gantry.usable import LEAST_ROWS, long_enough
from pyfmi_runner.campaign import Campaign, LoggedRun, LogSetup
from pyfmi_runner.log import REQUIRED, Log


def campaign(**rows: int) -> Campaign:
    logs = {
        name: LoggedRun(
            LogSetup(), Log(pd.DataFrame(np.zeros((n, len(REQUIRED))), columns=REQUIRED))
        )
        for name, n in rows.items()
    }
    return Campaign("rig", Path("rig"), logs, ["short starts at x = 0.5 m", "other: a note"])


def test_short_logs_are_left_out_by_name() -> None:
    kept = long_enough(campaign(short=50, whole=LEAST_ROWS))
    assert list(kept.logs) == ["whole"]
    assert kept.notes == [
        "other: a note",
        "short left out: 50 rows (0.05 s), a diagnosis needs at least 500",
    ]
    sound = campaign(whole=LEAST_ROWS)
    assert long_enough(sound) is sound


def test_short_logs_alone_are_refused_in_one_line() -> None:
    with pytest.raises(InputError, match=r"no log is long enough \(short left out: 50 rows"):
        long_enough(replace(campaign(short=50), notes=[]))
