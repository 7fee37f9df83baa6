"""Logs that can be diagnosed: without faults of the record."""

from __future__ import annotations

from dataclasses import replace

from modelica_fmu.errors import InputError
from pneugantry.engine.signals.converter import converter_step
from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.log import SIGMA
from pyfmi_runner.suspicions import Suspicion, suspicions

__all__ = ["sound_logs"]

FAULTS = ("swapped", "reversed", "clipped", "constant")  # of the record, no effect's doing


def sound_logs(campaign: Campaign) -> tuple[Campaign, list[str]]:
    """The campaign without logs whose channels are stuck, clipped, swapped or reversed; what is
    suspicious about each log, then what was left out and why.

    Such a log would be explained by some effect, and wrongly. Raises InputError where no log is
    left.
    """
    kept: dict[str, LoggedRun] = {}
    seen, gone = [], []
    for name, run in campaign.logs.items():
        found = suspicions(run.log)
        seen += [f"{name}: {s.text}" for s in found]
        faults = [s.text for s in found if _is_fault(run, s)]
        if faults:
            gone.append(f"{name} left out of the diagnosis: {faults[0]}")
        else:
            kept[name] = run
    if not kept:
        raise InputError(
            f"no log can be diagnosed ({gone[0]})",
            file=campaign.path,
            hint="check its channels or columns",
        )
    return replace(campaign, logs=kept), [*seen, *gone]


def _is_fault(run: LoggedRun, found: Suspicion) -> bool:
    """Whether it is a fault of the record, not what an effect may do to a sensor."""
    if found.kind == "held":
        return converter_step(run.log[found.channel], SIGMA[found.channel]) == 0.0
    if found.kind == "swapped" and found.channel == "f_x":
        return run.setup.workpiece != "none"  # without a workpiece it is an offset
    return found.kind in FAULTS
