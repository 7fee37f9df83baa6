"""Coarse converters of a campaign's channels (see `engine.signals.converter`)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pneugantry.engine.signals.converter import grid_of, step_and_grid
from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.log import MEASURED, SIGMA

__all__ = ["Converters", "as_read", "coarse_channels", "converters", "rounded"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Converters:
    """Coarse ones, by channel."""

    steps: Mapping[str, float]
    # By which share of itself what `as_read` makes of a channel may be off: logs are stored with
    # fewer digits than tell the step.
    undecided: Mapping[str, float] = field(default_factory=dict)


def coarse_channels(campaign: Campaign) -> dict[str, float]:
    """Steps of the coarse converters by channel, of all logs together."""
    found = {}
    for channel in MEASURED:
        step, _ = step_and_grid(_of_all(campaign, channel), SIGMA[channel])
        if step:
            found[channel] = step
    return found


def _of_all(campaign: Campaign, channel: str) -> Array:
    """A channel's readings in all logs, one log after the other."""
    logs = [run.log[channel] for run in campaign if channel in run.log]
    return np.concatenate(logs) if logs else np.zeros(0)


def as_read(campaign: Campaign, steps: Mapping[str, float]) -> Campaign:
    """The campaign as its converters gave it: a log that is stored with fewer digits moves every
    reading of one cell by the same, and a controller that integrates would notice.
    """
    grids = {c: grid_of(_of_all(campaign, c), q) for c, q in steps.items()}

    def exact(channel: str, values: Array) -> Array:
        grid = grids[channel]
        return values if grid is None else grid.nearest(values)

    return _changed(campaign, steps, exact)


def converters(campaign: Campaign) -> Converters:
    """Of a campaign as it is stored."""
    steps = coarse_channels(campaign)
    grids = {c: grid_of(_of_all(campaign, c), q) for c, q in steps.items()}
    return Converters(steps, {c: g.open / g.step for c, g in grids.items() if g is not None})


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
