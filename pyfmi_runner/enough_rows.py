"""Logs that are long enough to say something of a plant."""

from __future__ import annotations

from dataclasses import replace

from modelica_fmu.errors import InputError
from pyfmi_runner.campaign import Campaign
from pyfmi_runner.log import PERIOD

__all__ = ["LEAST_ROWS", "long_enough"]

LEAST_ROWS = 500  # rows: one block of the bootstrap over time, five segments of a residual


def long_enough(campaign: Campaign, what: str = "a diagnosis") -> Campaign:
    """The campaign without logs of less than LEAST_ROWS rows, each named in its notes. what: needs
    them. Raises InputError where none is left.
    """
    short = {name: len(run.log) for name, run in campaign.logs.items() if len(run.log) < LEAST_ROWS}
    if not short:
        return campaign
    notes = [
        f"{name} left out: {rows} rows ({rows * PERIOD:.2g} s), {what} needs at least {LEAST_ROWS}"
        for name, rows in short.items()
    ]
    logs = {name: run for name, run in campaign.logs.items() if name not in short}
    if not logs:
        raise InputError(
            f"no log is long enough ({notes[0]})", file=campaign.path, hint="record longer ones"
        )
    # its notes on logs that are no longer there go with them
    kept = [n for n in campaign.notes if n.split()[0].rstrip(":") not in short]
    return replace(campaign, logs=logs, notes=[*kept, *notes])
