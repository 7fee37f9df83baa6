"""Coarse converters: the grid on which a channel's readings lie, if it is coarser than its noise
should make it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.log import MEASURED, SIGMA

__all__ = ["COARSE", "as_read", "coarse_channels", "converter_step", "rounded"]

Array = NDArray[np.float64]
# converter step in units of the noise from which on it is an effect; logs themselves are rounded to
# about 0.2
COARSE = 0.45
ENOUGH = 40  # readings in a stretch of the grid that make an unused cell telling
BESIDE = 0.2  # share of a step by which a log's own rounding may move a reading off its grid
CLOSER = (
    0.8  # share of a step within which no two cells of its grid lie, but by the log's own rounding
)


def converter_step(values: Array, sigma: float) -> float:
    """Step [unit of the channel] of the grid that readings (N,) lie on, 0 if it is finer than
    COARSE * sigma.

    Where the channel dwells, noise of RMS sigma reaches every cell of a fine grid; cells that stay
    empty between used ones show that the converter's own step is wider. The step is the median
    distance of used cells. A channel that mostly rests in one wide cell has few others with as many
    readings; there all cells must be as far apart.
    """
    used, counts = np.unique(np.round(values, 9), return_counts=True)
    if len(used) < 3:
        return 0.0
    dwell = used[counts >= max(ENOUGH, 0.002 * counts.max())]
    resting = len(dwell) < 3
    if resting:
        dwell = used[counts >= ENOUGH]
        if len(dwell) < 3:
            return 0.0
    gaps = np.diff(dwell)
    near = gaps[gaps < 6 * sigma] if (gaps < 6 * sigma).any() else gaps
    step = float(np.median(near))
    if resting and np.diff(used).min() < CLOSER * step:
        return 0.0
    return step if step > COARSE * sigma else 0.0


def coarse_channels(campaign: Campaign) -> dict[str, float]:
    """Steps of the coarse converters by channel, of all logs together."""
    found = {}
    for channel in MEASURED:
        values = _of_all(campaign, channel)
        if len(values) and (step := converter_step(values, SIGMA[channel])):
            grid = _grid(values, step)
            found[channel] = step if grid is None else grid[1]
    return found


def _of_all(campaign: Campaign, channel: str) -> Array:
    """A channel's readings in all logs, one log after the other."""
    logs = [run.log[channel] for run in campaign if channel in run.log]
    return np.concatenate(logs) if logs else np.zeros(0)


def _grid(values: Array, step: float) -> tuple[float, float] | None:
    """Line (first cell, step) through the cells that readings lie on, about so far apart; None
    where some lie beside it, or are no numbers.
    """
    cells = np.unique(values)
    number = np.append(0.0, np.cumsum(np.round(np.diff(cells) / step)))
    if not np.isfinite(number).all() or number[-1] == 0:
        return None
    finer, first = np.polyfit(number, cells, 1)
    beside = np.abs(cells - first - finer * number).max()
    return (float(first), float(finer)) if beside < BESIDE * step else None


def as_read(campaign: Campaign, steps: Mapping[str, float]) -> Campaign:
    """The campaign as its converters gave it: a log that is stored with fewer digits moves every
    reading of one cell by the same, and a controller that integrates would notice.
    """
    grids = {c: _grid(_of_all(campaign, c), q) for c, q in steps.items()}

    def exact(channel: str, values: Array) -> Array:
        grid = grids[channel]
        if grid is None:
            return values
        first, step = grid
        return np.asarray(first + step * np.round((values - first) / step))

    return _changed(campaign, steps, exact)


def _changed(
    campaign: Campaign, channels: Collection[str], made: Callable[[str, Array], Array]
) -> Campaign:
    """A campaign with some channels made anew."""
    logs = {}
    for name, run in campaign.logs.items():
        own = {c: made(c, run.log[c]) for c in channels if c in run.log}
        logs[name] = replace(run, log=replace(run.log, table=run.log.table.assign(**own)))
    return replace(campaign, logs=logs)


def rounded(campaign: Campaign, steps: Mapping[str, float]) -> Campaign:
    """The campaign as converters that round would have read it. One that cuts off reads half a step
    too little: a clamped axis' speed shows it.
    """
    if not any(_cut(run, steps) for run in campaign):
        return campaign
    return _changed(campaign, steps, lambda channel, values: values + 0.5 * steps[channel])


def _cut(run: LoggedRun, steps: Mapping[str, float]) -> bool:
    """Whether a clamped axis' coarse tachometer reads less than nothing."""
    for axis in "xz":
        step, held = steps.get(f"v_{axis}", 0.0), run.setup.clamp_signal(axis, run.log.time)
        speed = run.log[f"v_{axis}"][held] if step and f"v_{axis}" in run.log else np.zeros(0)
        if len(speed) and float(np.mean(speed)) < -0.25 * step:
            return True
    return False
