"""Figures of the thesis' argument: panels of named curves. Arrays in, a Figure out; no computing
here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pneugantry.analysis.plots import AUGMENTED, MEASURED, NOMINAL, REFERENCE, axes_grid

__all__ = ["Bars", "Curve", "Drawing", "Panel", "bars_figure", "panels_figure"]

Curve = tuple[NDArray, NDArray]  # x, y
COLOURS = (MEASURED, NOMINAL, AUGMENTED, "#c98a1b", "#6a4c93", "#888888")
WANTED = "wanted"  # a curve of this name is drawn dashed and grey


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    x_label: str
    y_label: str
    curves: dict[str, Curve]
    marks: Curve | None = None  # points that are circled
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    note: str = field(default="")


Drawing = tuple[list[Panel], str, int]  # panels, title, columns


def panels_figure(panels: list[Panel], title: str, columns: int = 1, height: float = 2.0) -> Figure:
    """Panels row by row; a panel alone is higher."""
    rows = -(-len(panels) // columns)
    height = height if len(panels) > 1 else 1.6 * height
    figure, axes = axes_grid(rows, columns, height=height)
    for ax, panel in zip(axes.ravel(), panels, strict=False):
        colours = iter(COLOURS * 3)
        for name, (x, y) in panel.curves.items():
            if name == WANTED:
                ax.plot(x, y, "--", color=REFERENCE, label=name)
            else:
                ax.plot(x, y, color=next(colours), label=name)
        if panel.marks is not None:
            ax.plot(*panel.marks, "o", mfc="none", mec=NOMINAL, ms=9)
        ax.set(xlabel=panel.x_label, ylabel=panel.y_label)
        if panel.x_range:
            ax.set_xlim(panel.x_range)
        if panel.y_range:
            ax.set_ylim(panel.y_range)
        if panel.note:
            ax.set_title(panel.note, fontsize=8, loc="left" if columns == 1 else "center")
        if len(panel.curves) > 1:
            _legend(ax, columns)
    for ax in axes.ravel()[len(panels) :]:
        ax.remove()
    figure.suptitle(title)
    return figure


def _legend(ax: Axes, columns: int) -> None:
    """Above wide axes, where it hides no curve; within narrow ones, which have no room above."""
    if columns > 1:
        ax.legend(loc="best")
        return
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)}
    ax.legend(ncols=6, borderaxespad=0.1, **place)


@dataclass(frozen=True)
class Bars:
    """One pair of axes of horizontal bars."""

    title: str
    label: str
    names: list[str]
    values: NDArray
    limits: tuple[float, ...] = ()  # dashed lines


def bars_figure(bars: list[Bars], title: str) -> Figure:
    """Bars below one another, each as high as it has names, each with its value."""
    heights = [0.19 * len(b.names) + 0.7 for b in bars]
    figure, whole = axes_grid(1, 1, height=sum(heights))
    whole[0, 0].remove()
    axes = figure.subplots(len(bars), 1, height_ratios=heights, squeeze=False).ravel()
    for ax, b in zip(axes, bars, strict=True):
        drawn = ax.barh(range(len(b.names)), b.values, color=MEASURED)
        ax.bar_label(drawn, fmt="%.1f", fontsize=7, padding=2)
        ax.set_yticks(range(len(b.names)), b.names, fontsize=7)
        ax.invert_yaxis()
        ax.margins(x=0.1)
        ax.axvline(0.0, color=REFERENCE, lw=0.8)
        for limit in b.limits:
            ax.axvline(limit, color=NOMINAL, lw=0.8, ls="--")
        ax.set_xlabel(b.label, fontsize=8)
        ax.set_title(b.title, fontsize=9, loc="left")
        ax.grid(visible=False, axis="y")
    figure.suptitle(title)
    return figure
