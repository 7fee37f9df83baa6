"""Figures of the linear analysis: root loci, Bode, Nyquist, lag, stick-slip. Arrays in, a Figure
out; no computing here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pneugantry.analysis.plots import AUGMENTED, MEASURED, NOMINAL, REFERENCE, axes_grid

__all__ = ["lag_figure", "locus_axes", "loop_figure", "root_locus_figure", "stick_slip_figure"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
COLOURS = (MEASURED, NOMINAL, AUGMENTED, "#8b6bb1")


def locus_axes(ax: Axes, poles: Complex, zeros: Complex, branches: Complex, title: str) -> None:
    """Branches (gains, poles), open-loop poles x and zeros o, and the imaginary axis; rad/s."""
    ax.axvline(0.0, color=REFERENCE, linewidth=0.8)
    for i in range(branches.shape[1]):
        ax.plot(branches[:, i].real, branches[:, i].imag, color=COLOURS[i % len(COLOURS)])
    ax.plot(poles.real, poles.imag, "x", color="black", label="poles")
    ax.plot(zeros.real, zeros.imag, "o", color="black", fillstyle="none", label="zeros")
    ax.set_xlabel("real [1/s]")
    ax.set_ylabel("imaginary [rad/s]")
    ax.set_title(title)


def root_locus_figure(panels: Mapping[str, tuple[Complex, Complex, Complex]]) -> Figure:
    """One locus a panel: title -> (poles, zeros, branches), as Fig. 5.6 and 5.7."""
    figure, axes = axes_grid(1, len(panels), width=4.5 * len(panels), height=4.0)
    for ax, (title, (poles, zeros, lines)) in zip(axes[0], panels.items(), strict=True):
        locus_axes(ax, poles, zeros, lines, title)
    axes[0, 0].legend(loc="best")
    return figure


def loop_figure(
    locus: tuple[Complex, Complex, Complex],
    frequency: Array,
    curves: Mapping[str, Complex],
    title: str,
) -> Figure:
    """Root locus, Bode and Nyquist of one loop; curves: name -> L at the frequencies [rad/s]."""
    figure, axes = axes_grid(2, 2, width=10.0, height=3.6)
    locus_axes(axes[0, 0], *locus, "root locus")
    for colour, (name, values) in zip(COLOURS, curves.items(), strict=False):
        axes[0, 1].loglog(frequency, np.abs(values), color=colour, label=name)
        axes[1, 1].semilogx(
            frequency, np.degrees(np.unwrap(np.angle(values))), color=colour, label=name
        )
        axes[1, 0].plot(values.real, values.imag, color=colour, label=name)
    axes[0, 1].axhline(1.0, color=REFERENCE, linewidth=0.8)
    axes[0, 1].set_ylabel("|L|")
    axes[0, 1].set_title("Bode")
    axes[0, 1].legend(loc="best")
    axes[1, 1].axhline(-180.0, color=REFERENCE, linewidth=0.8)
    axes[1, 1].set_ylim(-400, 20)
    axes[1, 1].set_ylabel("phase [deg]")
    for ax in axes[:, 1]:
        ax.set_xlabel("frequency [rad/s]")
    axes[1, 0].plot([-1.0], [0.0], "+", color="black")
    axes[1, 0].set_xlim(-3, 3)
    axes[1, 0].set_ylim(-3, 3)
    axes[1, 0].set_xlabel("Re L")
    axes[1, 0].set_ylabel("Im L")
    axes[1, 0].set_title("Nyquist")
    figure.suptitle(title)
    return figure


def lag_figure(
    lag: Array, limit: Array, thesis: Array, best: Array, ratio: Array, smith: Mapping[str, Array]
) -> Figure:
    """Left: limit gain [V/N] over lag [s]; middle: bandwidths [rad/s] over lag; right: bandwidth
    over the Smith model's lag ratio.
    """
    figure, axes = axes_grid(1, 3, width=12.0, height=3.4)
    limits, widths, predictor = axes[0]
    limits.loglog(lag, limit, "o-", color=MEASURED)
    limits.set_ylabel("limit gain [V/N]")
    widths.semilogx(lag, thesis, "o-", color=MEASURED, label="gains of Table 4.6")
    widths.semilogx(lag, best, "o-", color=AUGMENTED, label="best PI, peak of 1/(1 + L) at most 2")
    for ax in (limits, widths):
        ax.set_xlabel("lag of the valve [s]")
    for colour, (name, values) in zip(COLOURS, smith.items(), strict=False):
        predictor.plot(ratio, values, "o-", color=colour, label=name)
    predictor.set_xlabel("lag of the Smith predictor's model / of the plant")
    for ax in (widths, predictor):
        ax.set_ylabel("bandwidth [rad/s]")
        ax.set_ylim(bottom=0)
        ax.legend(loc="best")
    return figure


def stick_slip_figure(
    v_td: Sequence[float], curves: Mapping[str, Sequence[tuple[Array, Array]]]
) -> Figure:
    """Speed [m/s] over time [s] from break-away, one panel a set speed [m/s]; name -> (time, speed)
    for each.
    """
    figure, axes = axes_grid(1, len(v_td), width=4.0 * len(v_td), height=2.8)
    for i, (ax, wanted) in enumerate(zip(axes[0], v_td, strict=True)):
        for colour, (name, runs) in zip((MEASURED, NOMINAL), curves.items(), strict=True):
            ax.plot(
                *runs[i], color=colour, label=name, linestyle="-" if colour == MEASURED else "--"
            )
        ax.axhline(wanted, color=REFERENCE, linewidth=0.8)
        ax.set_title(f"v_td = {wanted:g} m/s")
        ax.set_xlabel("time from break-away [s]")
        ax.set_ylabel("v_x [m/s]")
    axes[0, 0].legend(loc="best")
    return figure
