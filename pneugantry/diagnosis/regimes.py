"""In which logs and in which regime of the motion a block's residual lies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pneugantry.diagnosis.bench import Bench
from pneugantry.diagnosis.evidence import Search

__all__ = ["regime_of"]

VIEW_OF = {
    "friction_x": ("friction_x", (0,)),
    "friction_z": ("friction_z", (0,)),
    "contact": ("contact", (0, 1)),
    "valve_x": ("valve_x", (0,)),
    "valve_z": ("valve_z", (0,)),
    "sensors": ("sensors", (0, 1, 2, 3)),
    "timing": ("timing", (0, 1)),
}


def regime_of(bench: Bench, found: Search, block: str) -> tuple[list[str], str]:
    """Logs that hold most of a block's residual under tolerance alone, and the regime in which it
    is strongest.
    """
    view, columns = VIEW_OF[block]
    residual = bench.all[view].residual(found.null[view].values)[:, columns]
    channels = np.isfinite(residual).sum(axis=1)
    square = np.nan_to_num(residual**2).sum(axis=1) / np.maximum(channels, 1)
    excess = np.maximum(square - 1.0, 0.0)
    by_log = {
        name: float(excess[first:last].sum())
        for name, (first, last) in zip(bench.table.names, bench.table.spans, strict=True)
    }
    total = sum(by_log.values()) or 1.0
    logs = [
        name for name in sorted(by_log, key=lambda n: -by_log[n]) if by_log[name] > 0.15 * total
    ]
    masks = _regimes(bench, block)
    density = {name: float(excess[mask].mean()) for name, mask in masks.items() if mask.sum() > 100}
    return logs, max(density, key=lambda name: density[name]) if density else ""


def _regimes(bench: Bench, block: str) -> dict[str, NDArray[np.bool_]]:
    """Rows by regime."""
    columns = bench.table.columns
    axis = block[-1] if block.endswith(("_x", "_z")) else "z"
    speed = np.convolve(columns[f"v_{axis}"], np.full(15, 1 / 15), mode="same")
    force = np.hypot(columns["f_x"], columns["f_z"])
    touching = force > 1.0
    reversal = _near(
        np.flatnonzero(np.diff(np.sign(np.where(np.abs(speed) > 5e-4, speed, 0.0))) != 0),
        len(speed),
        60,
    )
    onset = _near(np.flatnonzero(np.diff(touching.astype(np.int8)) == 1), len(speed), 60)
    if block.startswith("valve"):
        change = np.diff(columns[f"u_{axis}"], prepend=columns[f"u_{axis}"][0])
        rising = np.convolve(change, np.ones(300), mode="full")[: len(change)]
        return {
            "rising command": rising > 1e-3,
            "falling command": rising < -1e-3,
            "constant command": np.abs(rising) <= 1e-3,
        }
    return {
        f"reversals of v_{axis}": reversal & ~onset,
        "contact onset": onset,
        f"sliding, v_{axis} > 0": speed > 0.01,
        f"sliding, v_{axis} < 0": speed < -0.01,
        "at rest": (np.abs(speed) < 1e-3) & ~reversal & ~touching,
        "pressed at rest": (np.abs(speed) < 1e-3) & ~reversal & touching,
    }


def _near(rows: NDArray[np.intp], n: int, around: int) -> NDArray[np.bool_]:
    mask = np.zeros(n, dtype=bool)
    for row in rows:
        mask[max(0, row - around) : row + around] = True
    return mask
