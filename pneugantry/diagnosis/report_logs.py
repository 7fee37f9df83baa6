"""Every log of a diagnosis replayed for the report: simulated signals, and each block's residual
over time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from modelica_fmu.errors import RunError
from pneugantry.diagnosis.confirm import Augmented, replay_gap
from pyfmi_runner.blocks import BlockReplayer
from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.replay import Replayer

__all__ = ["BINS", "LogView", "log_views", "strip_svg"]

Array = NDArray[np.float64]
BINS = 80  # of a log, over which a residual's RMS is taken
LEVELS = (1.5, 2.5, 5.0, 10.0, 25.0)  # RMS in units of the noise, from which on a cell is darker
STRIP = {"left": 92, "width": 760, "row": 22, "top": 22, "gap": 3}


@dataclass(frozen=True, eq=False)
class LogView:
    """One log as the page shows it."""

    name: str
    run: LoggedRun
    curves: Mapping[str, Array]  # "measured", "nominal", "augmented": (N, 8), SI
    strips: Mapping[str, tuple[Array, Array]]  # block: RMS by bin, nominal and with the fit
    gap: tuple[float, float]  # nominal, augmented


def log_views(
    campaign: Campaign, gantry: FmuFile, values: Mapping[str, float]
) -> tuple[list[LogView], list[str]]:
    """All logs replayed with the nominal and the fitted plant; what could not be replayed, a
    sentence each. values: as `Augmented.of` takes them.
    """
    augmented = Augmented.of(values)
    views, notes = [], []
    with Replayer(gantry) as plant, BlockReplayer(gantry) as blocks:
        for name, run in campaign.logs.items():
            try:
                gap = replay_gap(plant, run, augmented)
                strips = _strips(blocks, run, augmented.plant)
            except RunError as error:
                notes.append(f"{name} could not be replayed for the page: {error}")
                continue
            curves = {"measured": run.log.measured(), **gap.curves}
            pair = (float(gap.nominal), float(gap.augmented))
            views.append(LogView(name, run, curves, strips, pair))
    return views, notes


def _strips(
    blocks: BlockReplayer, run: LoggedRun, fitted: Mapping[str, float]
) -> dict[str, tuple[Array, Array]]:
    plain, moved = blocks.residuals(run), blocks.residuals(run, fitted)
    return {name: (_binned(plain[name]), _binned(moved[name])) for name in plain if name in moved}


def _binned(residual: Array) -> Array:
    """RMS over BINS stretches of time and all channels (rows, channels); NaN where nothing is
    judged.
    """
    square = residual.reshape(len(residual), -1) ** 2
    edges = np.linspace(0, len(square), BINS + 1).astype(int)
    result = np.full(BINS, np.nan)
    for i, (first, last) in enumerate(pairwise(edges)):
        part = square[first:last]
        if part.size and np.isfinite(part).any():
            result[i] = np.sqrt(np.nanmean(part))
    return result


def strip_svg(view: LogView, phases: Sequence[tuple[str, float, float]], after: str) -> str:
    """Each block's residual over time: upper half of a row the nominal plant, lower half the fitted
    one; the darker, the larger, in classes of the style sheet.
    """
    s, time = STRIP, view.run.log.time
    height = s["top"] + (s["row"] + s["gap"]) * len(view.strips) + 20
    body = [
        f'<text x="{s["left"] + s["width"] * (t - time[0]) / (time[-1] - time[0]):.0f}" y="12" '
        f'class="phase">{name}</text>'
        for name, t, _ in phases
        if time[0] <= t < time[-1]
    ]
    for i, (block, pair) in enumerate(view.strips.items()):
        y = s["top"] + i * (s["row"] + s["gap"])
        body.append(f'<text x="{s["left"] - 6}" y="{y + 15}" class="name">{block}</text>')
        for k, values in enumerate(pair):
            body += _cells(values, y + k * s["row"] // 2, s["row"] // 2)
    body += [
        f'<text x="{s["left"] + s["width"] * k / 4:.0f}" y="{height - 4}" class="tick">'
        f"{time[0] + (time[-1] - time[0]) * k / 4:.3g} s</text>"
        for k in range(5)
    ]
    label = f"Residual of each block of {view.name} over time, nominal above {after}"
    return (
        f'<svg class="strip" viewBox="0 0 {s["left"] + s["width"] + 20} {height}" role="img" '
        f'aria-label="{label}">' + "".join(body) + "</svg>"
    )


def _cells(values: Array, y: int, height: int) -> list[str]:
    """One rectangle for each stretch of a class."""
    classes = [-1 if np.isnan(v) else int(np.searchsorted(LEVELS, v)) for v in values]
    edges = [0, *(i for i in range(1, BINS) if classes[i] != classes[i - 1]), BINS]
    each = STRIP["width"] / BINS
    return [
        f'<rect x="{STRIP["left"] + each * a:.1f}" y="{y}" width="{each * (b - a):.1f}" '
        f'height="{height}" class="h{classes[a] if classes[a] >= 0 else "n"}"/>'
        for a, b in pairwise(edges)
    ]
