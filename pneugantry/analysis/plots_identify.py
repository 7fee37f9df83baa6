"""Figures of the identification: lags by step, the friction loop, intervals of the fit. Results in,
a Figure out; no computing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from pneugantry.analysis.identify.hysteresis import Hysteresis
from pneugantry.analysis.identify.joint_fit import JointFit
from pneugantry.analysis.identify.valve import Step
from pneugantry.analysis.plots import AUGMENTED, MEASURED, NOMINAL, REFERENCE, axes_grid

APART = 0.018  # of the range of positions, between the kinds of points of one position

__all__ = ["hysteresis_figure", "interval_figure", "lag_figure"]


def lag_figure(steps: Mapping[str, Sequence[Step]]) -> Figure:
    """tau over position by axis, one point a step: 65 % rule (open) and fit (filled), filling and
    exhausting apart; 95 % bars.
    """
    figure, axes = axes_grid(1, 2, width=11.0, height=3.4)
    for ax, axis in zip(axes[0], "xz", strict=True):
        places = [s.position for s in steps.get(axis, ())]
        apart = APART * (max(places, default=1.0) - min(places, default=0.0))
        kinds = [(f, b) for f in (True, False) for b in (False, True)]
        for filling, colour, word in ((True, MEASURED, "filling"), (False, NOMINAL, "exhausting")):
            of_kind = [s for s in steps.get(axis, ()) if s.filling == filling]
            for by_fit, face in ((False, "none"), (True, colour)):
                aside = apart * (kinds.index((filling, by_fit)) - 1.5)
                found = [s.tau if by_fit else s.tau_65 for s in of_kind]
                ax.errorbar(
                    [1000 * (s.position + aside) for s in of_kind],
                    [e.value for e in found],
                    [e.reach * e.sigma for e in found],
                    fmt="o",
                    color=colour,
                    markerfacecolor=face,
                    capsize=2,
                    linestyle="none",
                    label=f"{word}, {'fit' if by_fit else '65 % rule'}",
                )
        ax.set_xlabel(f"{axis} [mm]")
        ax.set_ylabel(f"tau of the {axis} valve [s]")
        ax.set_title(f"lag of the {axis} valve, one point a step")
    axes[0, 1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def hysteresis_figure(found: Hysteresis) -> Figure:
    """Friction over displacement from the reversal, and the fitted Eq. 4-8 (Fig. 4.17)."""
    figure, axes = axes_grid(1, 1, width=6.0, height=3.2)
    ax, part = axes[0, 0], found.branch
    ax.plot(
        1e3 * part.displacement, part.friction, ".", color=MEASURED, label=f"{part.log}, measured"
    )
    if found.presliding:
        law = f"Eq. 4-8, beta {found.beta:.1f} N, sigma {found.sigma:.2e} N/m"
        ax.plot(1e3 * part.grid, part.fitted, color=NOMINAL, label=law)
    else:
        ax.plot([], [], " ", label="no creep before sliding: beta and sigma are not identified")
    ax.set_title("friction of z behind a reversal (Fig. 4.17)")
    ax.set_xlabel("displacement from the reversal [mm]")
    ax.set_ylabel("friction of z [N]")
    ax.legend(loc="best")
    return figure


def interval_figure(joint: JointFit, truth: Mapping[str, float] | None = None) -> Figure:
    """Deviation of every parameter that the logs tell from the plant sheet [%], with its 95 %
    interval magnified; truth as crosses.
    """
    names = [u for u in joint.coordinates.unknowns if joint.sources[u.name] == "logs"]
    estimates = joint.estimates()
    figure, axes = axes_grid(1, 2, width=10.0, height=0.24 * len(names) + 1.4)
    figure.suptitle("parameters that the logs tell, by one fit to all of them")
    deviation, width = axes[0]
    place = np.arange(len(names))
    deviation.barh(
        place, [100 * (estimates[u.name].value / u.nominal - 1) for u in names], color=MEASURED
    )
    if truth is not None:
        deviation.plot(
            [100 * (truth[u.name] / u.nominal - 1) for u in names],
            place,
            "x",
            color=NOMINAL,
            label="truth",
        )
        deviation.legend(loc="best")
    deviation.axvline(0.0, color=REFERENCE, linewidth=0.8)
    deviation.set_xlabel("off the plant sheet [%]")
    width.barh(
        place,
        [100 * estimates[u.name].reach * estimates[u.name].sigma / abs(u.nominal) for u in names],
        color=AUGMENTED,
    )
    width.set_xscale("log")
    width.set_xlabel("half-width of the 95 % interval [%]")
    for ax in axes[0]:
        ax.set_yticks(place, [u.name for u in names])
        ax.set_ylabel("parameter")
        ax.invert_yaxis()
    return figure
