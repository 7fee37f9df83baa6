"""Figures of runs and replays, and what all figures share. Only plots*.py import matplotlib. Arrays
in, a Figure out; no computing.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from modelica_fmu.errors import InputError
from pneugantry.analysis.metrics import task_frame
from pyfmi_runner.log import LABELS, PHASES, Log, write_atomically

__all__ = ["axes_grid", "overlay_figure", "save", "tracking_figure"]

STYLE: dict[Any, Any] = {
    "figure.dpi": 110,
    "font.size": 9,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.0,
    "legend.frameon": False,
    "legend.fontsize": 8,
}
MEASURED, NOMINAL, REFERENCE, AUGMENTED = "#1f4e79", "#d1495b", "#666666", "#2e8b57"
PHASE_SHADE = {
    "approach": "#f4f4f4",
    "contact": "#e6eef5",
    "contour": "#ffffff",
    "retreat": "#f5ece6",
}


class ShownFigure(Figure):
    """A figure that a notebook shows as a picture, with no display magic."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


def axes_grid(
    rows: int, columns: int, width: float = 9.0, height: float = 1.9
) -> tuple[Figure, NDArray[np.object_]]:
    """A figure that no window system knows of, with its axes (rows, columns)."""
    mpl.rcParams.update(STYLE)
    figure = ShownFigure(figsize=(width, height * rows), layout="constrained")
    return figure, np.asarray(figure.subplots(rows, columns, squeeze=False))


def tracking_figure(log: Log, title: str = "") -> Figure:
    """One run as in Fig. 4.25: f_n, v_t and theta over time with the phases, z over x, and the
    commands.
    """
    task, time = task_frame(log), log.time
    figure, axes = axes_grid(5, 1, width=10.5)
    f_n, v_t, theta, edge, command = axes[:, 0]
    for ax in (f_n, v_t, theta, command):
        _shade_phases(ax, log)
        ax.set_xlim(time[0], time[-1])
        ax.set_xlabel("time [s]")
    f_n.plot(time, task.f_n, color=MEASURED, label="measured")
    v_t.plot(time, task.v_t, color=MEASURED, label="measured")
    theta.plot(time, np.degrees(task.theta), color=MEASURED, label="estimated from the forces")
    if "f_nd" in log:
        f_n.plot(time, log["f_nd"], "--", color=REFERENCE, label="wanted")
        v_t.plot(time, log["v_td"], "--", color=REFERENCE, label="wanted")
    if "theta" in log:
        theta.plot(time, np.degrees(log["theta"]), "--", color=REFERENCE, label="of the edge")
    edge.plot(1e3 * log["x"], 1e3 * log["z"], color=MEASURED)
    edge.set_xlabel("x [mm] (tracking runs to the left)")
    command.plot(time, log["u_x"], color=MEASURED, label="u_x")
    command.plot(time, log["u_z"], color=NOMINAL, label="u_z")
    for ax, label in zip(
        axes[:, 0], ("f_n [N]", "v_t [m/s]", "theta [deg]", "z [mm]", "command [V]"), strict=True
    ):
        ax.set_ylabel(label)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))  # beside: never over a curve
    figure.suptitle(title)
    return figure


def _shade_phases(ax: Axes, log: Log) -> None:
    if "phase" not in log:
        return
    phase, time = log["phase"], log.time
    starts = np.flatnonzero(np.diff(phase, prepend=phase[0] - 1))
    for i, start in enumerate(starts):
        end = time[starts[i + 1]] if i + 1 < len(starts) else time[-1]
        name = PHASES[int(phase[start])]
        ax.axvspan(time[start], end, color=PHASE_SHADE[name], zorder=0, linewidth=0)
        place: dict[str, Any] = {
            "transform": ax.get_xaxis_transform(),
            "ha": "center",
            "va": "bottom",
        }
        ax.text(0.5 * (time[start] + end), 1.0, name, fontsize=7, color=REFERENCE, **place)


def overlay_figure(
    time: NDArray[np.float64],
    measured: NDArray[np.float64],
    curves: dict[str, NDArray[np.float64]],
    title: str,
) -> Figure:
    """Measured and simulated channels (N, 8), in the order of the logs, one axes each."""
    colours = {"nominal": NOMINAL, "augmented": AUGMENTED}
    figure, axes = axes_grid(4, 2)
    for channel, ax in enumerate(axes.ravel()):
        ax.plot(time, measured[:, channel], color=MEASURED, label="measured")
        for name, values in curves.items():
            ax.plot(
                time, values[:, channel], color=colours.get(name, NOMINAL), label=name, alpha=0.85
            )
        ax.set_ylabel(LABELS[channel])
        ax.set_xlabel("time [s]")
    axes[0, 0].legend(loc="best")
    figure.suptitle(title)
    return figure


def save(figure: Figure, path: str | Path) -> None:
    """Writes a figure as its suffix says, whole or not at all. Raises InputError for an unknown
    suffix and an unwritable path.
    """
    kind = Path(path).suffix.lower().lstrip(".")
    known = figure.canvas.get_supported_filetypes()
    if kind not in known:
        raise InputError(
            f"unknown kind of picture {kind!r}",
            file=path,
            hint=f"end it in .png, .svg or .pdf ({', '.join(sorted(known))})",
        )
    write_atomically(path, lambda temporary: figure.savefig(temporary, format=kind))
