"""Measured signals -> command: what a campaign's own controller makes of them.

`timing.delay`: s, by which its commands are late; `timing.sensing`: s, by which what it reads is.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pneugantry.engine.plant import Array, Record
from pneugantry.engine.signals.sensors import shifted
from pneugantry.engine.views.view import Run
from pyfmi_runner.blocks import COMMAND_QUANTUM, recomputed_commands
from pyfmi_runner.campaign import LoggedRun
from pyfmi_runner.log import MEASURED, PERIOD

__all__ = ["DELAYS", "ControllerView"]

DELAYS = ("timing.delay", "timing.sensing")


class ControllerView:
    """Recorded command less the controller's."""

    name = "timing"
    signals: tuple[str, ...] = ("u_x", "u_z")
    blocks: tuple[str, ...] = ("timing", "timing")
    decimation = 1
    remembers = True
    defaults: Mapping[str, float] = {}

    def __init__(
        self, runs: Mapping[str, LoggedRun], undecided: Mapping[str, float] | None = None
    ) -> None:
        """undecided: channel -> share of itself by which it may be off from what was read."""
        self._runs: dict[str, LoggedRun] = {}
        self._measured: dict[str, Array] = {}
        for name, run in runs.items():
            measured = np.round(run.log.measured(), 12)
            if recomputed_commands(run, measured) is not None:
                self._runs[name], self._measured[name] = run, measured
        self.sigmas: tuple[float, ...] = self._noise(undecided or {})

    def _noise(self, undecided: Mapping[str, float]) -> tuple[float, float]:
        """RMS of what commands are rounded by, and of what they miss for what is undecided [V]."""
        squares = [np.zeros((1, 2))]
        for name, run in self._runs.items():
            own = {c: off for c, off in undecided.items() if off and c in run.log}
            for channel, off in own.items():
                moved = self._measured[name].copy()
                moved[:, MEASURED.index(channel)] *= 1 + off
                change = self._made(name, moved) - self._made(name, self._measured[name])
                squares.append(change[np.isfinite(change).all(axis=1)] ** 2 * len(own))
        missed = np.concatenate(squares).mean(axis=0)
        x, z = np.hypot(COMMAND_QUANTUM, np.sqrt(missed)).tolist()
        return x, z

    def _made(self, name: str, measured: Array) -> Array:
        made = recomputed_commands(self._runs[name], measured)
        assert made is not None
        return made

    def shows(self, record: Record) -> bool:
        return record.name in self._runs

    def depends_on(self, parameter: str) -> bool:
        return parameter in DELAYS

    def prepare(self, moving: Collection[str], settings: Mapping[str, float]) -> None:
        """Nothing to prepare."""

    def residuals(self, runs: Sequence[Run]) -> list[Array]:
        """(N, 2) V of each run; 0 where no controller runs."""
        return [self._residual(record.name, given) for record, given in runs]

    def _residual(self, name: str, given: Mapping[str, float]) -> Array:
        run, measured = self._runs[name], self._measured[name]
        recorded = np.column_stack([run.log["u_x"], run.log["u_z"]])
        acting, sensing = (given.get(name, 0.0) / PERIOD for name in DELAYS)
        made = self._made(name, _late(measured, sensing))
        running: NDArray[np.bool_] = np.asarray(np.isfinite(made).all(axis=1))
        first = int(np.argmax(running))
        kept = recorded[max(first - 1, 0)]  # by the valves, until a command of the controller comes
        made[first:] = _late(np.vstack([kept, made[first:]]), acting)[1:]
        return np.asarray(np.where(running[:, None], recorded - made, 0.0))


def _late(values: Array, rows: float) -> Array:
    """Values (N, channels) some rows later, the first one until then; between rows a mixture."""
    return np.column_stack([shifted(channel, rows) for channel in values.T]) if rows else values
