"""A campaign of the gantry in which every channel moves, for what is asked of no rig in particular:
which parts of the model a diagnosis runs.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pyfmi_runner.campaign import Campaign, campaign_of_log
from pyfmi_runner.log import MEASURED, PERIOD, Log

__all__ = ["any_campaign"]

ROWS = 1000
MIDDLE, SWING = 0.05, 0.03  # of every channel, in its unit: within both strokes
START = {"x": MIDDLE, "z": MIDDLE}
CONTACT = {"start": START, "workpiece": "straight"}
SETUPS: dict[str, dict[str, Any]] = {"free": {"start": START}, "contact": CONTACT, "held": CONTACT}


def any_campaign() -> Campaign:
    """Logs of a second, swinging at 1 Hz, at no workpiece and at one; the last is held out."""
    time = PERIOD * np.arange(ROWS)
    swing = MIDDLE + SWING * np.sin(2 * np.pi * time)
    columns = {"time": time, "u_x": swing, "u_z": swing, **dict.fromkeys(MEASURED, swing)}
    logs = {}
    for name, setup in SETUPS.items():
        (logs[name],) = campaign_of_log(Log(pd.DataFrame(columns), name), setup)
    return Campaign("any", Path("any"), logs, [])
