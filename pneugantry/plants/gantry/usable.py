"""Logs that can be diagnosed: without faults of the record."""

from __future__ import annotations

from dataclasses import replace

from modelica_fmu.errors import InputError
from pneugantry.engine.signals.converter import converter_step
from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.log import SIGMA, log_warnings

__all__ = ["sound_logs"]

# words of `log_warnings` that tell of a fault of the record
FAULTS = ("swapped", "reversed", "clipped", "throughout")


def sound_logs(campaign: Campaign) -> tuple[Campaign, list[str]]:
    """The campaign without logs whose channels are stuck, clipped, swapped or reversed; what is
    suspicious about each log, then what was left out and why.

    Such a log would be explained by some effect, and wrongly. Raises InputError where no log is
    left.
    """
    kept: dict[str, LoggedRun] = {}
    seen, gone = [], []
    for name, run in campaign.logs.items():
        warnings = log_warnings(run.log)
        seen += [f"{name}: {text}" for text in warnings]
        faults = [text for text in warnings if _is_fault(run, text)]
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


def _is_fault(run: LoggedRun, text: str) -> bool:
    """Whether a warning tells of a fault of the record, not of what an effect may do to
    a sensor.
    """
    channel = text.split()[0]
    if "coarse converter" in text:
        return converter_step(run.log[channel], SIGMA[channel]) == 0.0
    if "f_x and f_z swapped" in text:
        return run.setup.workpiece != "none"  # without a workpiece it is an offset
    return any(word in text for word in FAULTS)
