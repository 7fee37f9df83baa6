"""Measured signals -> command: what a campaign's own controller makes of them, late by
`timing.delay`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pneugantry.engine.plant import Array, Record
from pyfmi_runner.blocks import COMMAND_QUANTUM, recomputed_commands
from pyfmi_runner.campaign import LoggedRun
from pyfmi_runner.log import PERIOD

__all__ = ["ControllerView"]


class ControllerView:
    """Recorded command less the controller's."""

    name = block = "timing"
    signals: tuple[str, ...] = ("u_x", "u_z")
    sigmas: tuple[float, ...] = (COMMAND_QUANTUM, COMMAND_QUANTUM)
    decimation = 1
    defaults: Mapping[str, float] = {}

    def __init__(self, runs: Mapping[str, LoggedRun]) -> None:
        self._commands: dict[str, Array] = {}
        self._recorded: dict[str, Array] = {}
        for name, run in runs.items():
            self._recorded[name] = np.column_stack([run.log["u_x"], run.log["u_z"]])
            found = recomputed_commands(run, np.round(run.log.measured(), 12))
            if found is not None:
                self._commands[name] = found

    def shows(self, record: Record) -> bool:
        return record.name in self._commands

    def depends_on(self, parameter: str) -> bool:
        return parameter == "timing.delay"

    def residuals(self, record: Record, values: Sequence[Mapping[str, float]]) -> Array:
        """(len(values), N, 2) V; 0 where no controller runs."""
        made = self._commands[record.name]
        at = np.arange(len(made))
        recorded = self._recorded[record.name]
        result = np.empty((len(values), *made.shape))
        for i, given in enumerate(values):
            late = at - given.get("timing.delay", 0.0) / PERIOD
            first = at[np.isfinite(made).all(axis=1)][0]
            late = np.maximum(late, first)
            for c in range(2):
                result[i, :, c] = recorded[:, c] - np.interp(late, at, np.nan_to_num(made[:, c]))
        result[:, ~np.isfinite(made).all(axis=1)] = 0.0
        return result
