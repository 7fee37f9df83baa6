"""Figures of the linear analysis: root loci, Bode, Nyquist, lag, stick-slip. Arrays in, a Figure
out; no computing here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pneugantry.analysis.plots import AUGMENTED, MEASURED, NOMINAL, REFERENCE, axes_grid

__all__ = [
    "LocusPicture",
    "lag_figure",
    "limit_figure",
    "locus_axes",
    "loop_figure",
    "root_locus_figure",
    "stick_slip_figure",
    "window",
]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
FAR = 2.0  # / delay, from which on a pole is one of the delay's approximation
# heights of the axes within which a zero is shown: with a limit gain, and without, where all that
# there is to see are the branches on their way to it
NEAR_ZERO, FAR_ZERO = 4.0, 30.0
CLEAR = 0.12  # of the axes' height, between two labels
ROOM = 1.6  # of the axes over what decides
COLOURS = (MEASURED, NOMINAL, AUGMENTED, "#8b6bb1")


@dataclass(frozen=True, eq=False)
class LocusPicture:
    """A locus to draw: open-loop poles and zeros, branches (gains, poles) in rad/s, and what is
    marked on it.
    """

    poles: Complex
    zeros: Complex
    branches: Complex
    gains: Array  # V/N, of the branches' rows
    limit: tuple[float, float] | None = None  # V/N and rad/s, where the loop becomes unstable
    marked: tuple[float, ...] = ()  # V/N, gains whose closed-loop poles are dots with a label
    delay: float = 0.0  # s; its Pade poles lie far out and do not set the axes
    words: str = ""  # what stands beside a limit, or in place of one


def window(picture: LocusPicture) -> tuple[float, float, float]:
    """(left, right, top) of the axes [rad/s]: what decides on stability fills them, the far poles
    and zeros of a delay's approximation do not.
    """
    near = np.abs(picture.poles)
    if picture.delay > 0:
        near = near[near < FAR / picture.delay]
    reach = max([*near, picture.limit[1] if picture.limit else 0.0, 1.0])
    top = ROOM * reach
    far = NEAR_ZERO if picture.limit else FAR_ZERO
    zeros = -picture.zeros.real[(picture.zeros.real < 0) & (np.abs(picture.zeros) < far * top)]
    if picture.limit is None and len(zeros):  # the branches bend round the zero to the real axis
        top = max(top, 1.1 * float(zeros.max()))
        return -2.2 * float(zeros.max()), 0.6 * reach, top
    return -1.15 * max([top, *zeros]), 0.6 * reach, top


def locus_axes(ax: Axes, picture: LocusPicture, title: str) -> None:
    """Branches, open-loop poles x and zeros o, limit gain, labelled gains, imaginary axis."""
    left, right, top = window(picture)
    ax.axvspan(0.0, right, color="#f5ece6", zorder=0, linewidth=0)
    ax.axvline(0.0, color=REFERENCE, linewidth=0.8)
    for i in range(picture.branches.shape[1]):
        line = picture.branches[:, i]
        ax.plot(line.real, line.imag, color=COLOURS[i % len(COLOURS)])
    for values, mark, name in ((picture.poles, "x", "poles"), (picture.zeros, "o", "zeros")):
        ax.plot(values.real, values.imag, mark, color="black", fillstyle="none", label=name)
    _mark_gains(ax, picture, top)
    if picture.limit is not None:
        at = picture.limit[1]
        ax.plot([0.0, 0.0], [at, -at], "D", color=NOMINAL, markersize=5, label=picture.words)
    elif picture.words:
        ax.plot([], [], " ", label=picture.words)
    outside = [v for v in (*picture.poles, *picture.zeros) if not left <= v.real <= right]
    if outside:
        ax.plot([], [], " ", label=f"{len(outside)} further out, at {_places(outside)}")
    ax.set_xlim(left, right)
    ax.set_ylim(-top, top)
    ax.set_xlabel("real [1/s]")
    ax.set_ylabel("imaginary [rad/s]")
    ax.set_title(title)


def _places(values: Sequence[complex]) -> str:
    upper = sorted({f"{v.real:.0f}" for v in values}, key=float)
    return ", ".join(upper)


def _mark_gains(ax: Axes, picture: LocusPicture, top: float) -> None:
    """Dots where the loop of a marked gain has its poles, the gain beside the highest of them."""
    left, right, _ = window(picture)
    last = complex("inf")
    for gain in picture.marked:
        row = picture.branches[int(np.argmin(np.abs(picture.gains - gain)))]
        inside = row[(row.real > left) & (row.real < right) & (np.abs(row.imag) <= top)]
        ax.plot(inside.real, inside.imag, ".", color="black", markersize=5)
        highest = inside[np.argmax(inside.imag)] if len(inside) else last
        if abs(highest - last) > CLEAR * top:  # labels that do not cover each other
            last = complex(highest)
            place = (float(highest.real), float(highest.imag))
            beyond = picture.limit is None or gain > picture.limit[0]
            aside, to = ((4, 4), "left") if beyond else ((-5, -9), "right")  # clear of the limit
            ax.annotate(f"{gain:.2g}", place, aside, textcoords="offset points", fontsize=7, ha=to)


def root_locus_figure(panels: Mapping[str, LocusPicture]) -> Figure:
    """One locus a panel by title, as Fig. 5.6 and 5.7; numbers beside dots are gains [V/N]."""
    figure, axes = axes_grid(1, len(panels), width=4.5 * len(panels), height=4.6)
    for ax, (title, picture) in zip(axes[0], panels.items(), strict=True):
        locus_axes(ax, picture, title)
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14))
    return figure


def loop_figure(
    picture: LocusPicture, frequency: Array, curves: Mapping[str, Complex], title: str
) -> Figure:
    """Root locus, Bode and Nyquist of one loop; curves: name -> L at the frequencies [rad/s]."""
    figure, axes = axes_grid(2, 2, width=11.0, height=4.2)
    locus, nyquist, magnitude, phase = axes[0, 0], axes[1, 0], axes[0, 1], axes[1, 1]
    locus_axes(locus, picture, "root locus; dots: proportional gain [V/N]")
    locus.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
    seen = frequency <= _highest(frequency, curves)
    for colour, (name, values) in zip(COLOURS, curves.items(), strict=False):
        lag = np.degrees(np.unwrap(np.angle(values)))
        magnitude.loglog(frequency[seen], np.abs(values[seen]), color=colour, label=name)
        phase.semilogx(frequency[seen], lag[seen], color=colour)
        nyquist.plot(values.real, values.imag, color=colour, label=name)
    _bode_axes(magnitude, phase)
    _nyquist_axes(nyquist, frequency, curves)
    figure.suptitle(title)
    return figure


def _highest(frequency: Array, curves: Mapping[str, Complex]) -> float:
    """Frequency up to which a loop's gain counts: its phase beyond that decides nothing."""
    counts = [frequency[np.abs(values) > 1e-3].max() for values in curves.values()]
    return float(max(counts))


def _bode_axes(magnitude: Axes, phase: Axes) -> None:
    magnitude.axhline(1.0, color=REFERENCE, linewidth=0.8)
    magnitude.set_ylabel("|L|")
    magnitude.set_title("Bode")
    magnitude.legend(loc="lower left")
    phase.axhline(-180.0, color=REFERENCE, linewidth=0.8)
    phase.set_ylabel("phase [deg]")
    for ax in (magnitude, phase):
        ax.set_xlabel("frequency [rad/s]")


def _nyquist_axes(ax: Axes, frequency: Array, curves: Mapping[str, Complex]) -> None:
    """About the critical point: as far as the loops reach where their phase is past -90 degrees."""
    reach = [1.2]
    for values in curves.values():
        past = np.degrees(np.unwrap(np.angle(values))) < -100.0
        reach.append(float(np.abs(values[past & (frequency > 1.0)]).max(initial=0.0)))
    side = 1.2 * min(max(reach), 8.0)
    turn = np.linspace(0.0, 2 * np.pi, 200)
    ax.plot(np.cos(turn), np.sin(turn), color=REFERENCE, linewidth=0.6, linestyle=":")
    ax.plot([-1.0], [0.0], "+", color="black", markersize=9)
    ax.annotate("-1", (-1.0, 0.0), (-12, 5), textcoords="offset points", fontsize=8)
    ax.set_xlim(-side, side)
    ax.set_ylim(-side, side)
    ax.set_aspect("equal")
    ax.set_xlabel("Re L")
    ax.set_ylabel("Im L")
    ax.set_title("Nyquist")


def limit_figure(lag: Array, limits: Mapping[str, Array], marks: Mapping[str, float]) -> Figure:
    """Limit gain [V/N] over the valve's lag [s]: name -> gains; marks: name -> lag."""
    figure, axes = axes_grid(1, 1, width=7.0, height=3.6)
    ax = axes[0, 0]
    for style, colour, (name, values) in zip(("o", "-"), COLOURS, limits.items(), strict=False):
        ax.loglog(lag, values, style, color=colour, label=name, markersize=4)
    for name, place in marks.items():
        ax.axvline(place, color=REFERENCE, linewidth=0.8, linestyle=":")
        ax.text(place, 1.0, name, transform=ax.get_xaxis_transform(), ha="center", va="bottom")
    ax.set_xlabel("lag of the valve [s]")
    ax.set_ylabel("limit gain [V/N]")
    ax.legend(loc="best")
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
