"""Logs too short to be diagnosed are named, and the rest goes on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from modelica_fmu.errors import InputError
from pneugantry.cli import main
from pyfmi_runner.campaign import Campaign, LoggedRun, LogSetup
from pyfmi_runner.enough_rows import LEAST_ROWS, long_enough
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


def test_identify_says_so_in_one_line_and_computes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It once printed a table after a minute, with a gap of nan."""
    table = pd.DataFrame(np.zeros((50, len(REQUIRED))), columns=REQUIRED)
    table["time"] = 1e-3 * np.arange(50)
    table.to_csv(tmp_path / "short.csv", index=False)
    assert main(["identify", str(tmp_path / "short.csv")]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines()[-1].endswith(
        "no log is long enough (short left out: 50 rows (0.05 s), an identification needs at least "
        "500); record longer ones"
    )
