"""Measured signals -> command: what a campaign's own controller makes of them.

`timing.delay`: s, by which its commands are late; `timing.sensing`: s, by which what it reads is.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pneugantry.engine.plant import Array, Record
from pneugantry.engine.sensors import shifted
from pyfmi_runner.blocks import COMMAND_QUANTUM, recomputed_commands
from pyfmi_runner.campaign import LoggedRun
from pyfmi_runner.log import PERIOD

__all__ = ["DELAYS", "ControllerView"]

DELAYS = ("timing.delay", "timing.sensing")


class ControllerView:
    """Recorded command less the controller's."""

    name = "timing"
    signals: tuple[str, ...] = ("u_x", "u_z")
    blocks: tuple[str, ...] = ("timing", "timing")
    sigmas: tuple[float, ...] = (COMMAND_QUANTUM, COMMAND_QUANTUM)
    decimation = 1
    remembers = True
    defaults: Mapping[str, float] = {}

    def __init__(self, runs: Mapping[str, LoggedRun]) -> None:
        self._runs: dict[str, LoggedRun] = {}
        self._measured: dict[str, Array] = {}
        for name, run in runs.items():
            measured = np.round(run.log.measured(), 12)
            if recomputed_commands(run, measured) is not None:
                self._runs[name], self._measured[name] = run, measured

    def shows(self, record: Record) -> bool:
        return record.name in self._runs

    def depends_on(self, parameter: str) -> bool:
        return parameter in DELAYS

    def prepare(self, moving: Collection[str], settings: Mapping[str, float]) -> None:
        """Nothing to prepare."""

    def residuals(self, record: Record, values: Sequence[Mapping[str, float]]) -> Array:
        """(len(values), N, 2) V; 0 where no controller runs."""
        run, measured = self._runs[record.name], self._measured[record.name]
        recorded = np.column_stack([run.log["u_x"], run.log["u_z"]])
        result = np.empty((len(values), *recorded.shape))
        for i, given in enumerate(values):
            acting, sensing = (given.get(name, 0.0) / PERIOD for name in DELAYS)
            made = recomputed_commands(run, _late(measured, sensing))
            assert made is not None
            running: NDArray[np.bool_] = np.asarray(np.isfinite(made).all(axis=1))
            first = int(np.argmax(running))
            made[first:] = _late(made[first:], acting)
            result[i] = np.where(running[:, None], recorded - made, 0.0)
        return result


def _late(values: Array, rows: float) -> Array:
    """Values (N, channels) some rows later, the first one until then; between rows a mixture."""
    return np.column_stack([shifted(channel, rows) for channel in values.T]) if rows else values
