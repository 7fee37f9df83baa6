"""Root locus of a force loop (Fig. 5.6 with lag, Fig. 5.7 without): poles, zeros, branches,
stability limit, margins.

Poles and zeros are those of the open loop; proportional gain k closes it, u = u_0 + k e, so that
the branches run from the open-loop poles (k = 0) to the zeros and infinity. Fig. 5.6 adds the pole
-3.33 (the x valve's tau of 0.30 s) to the z loop; the z valve's own tau of 0.15 s puts it at -6.67.
"""

from __future__ import annotations

from dataclasses import dataclass

import control
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from controllers.gains import gains_named
from pneugantry.analysis.force_loop import ForceLoop
from pneugantry.analysis.frequency import Crossing, Margins, margins, response, stability_limit

__all__ = [
    "PadeError",
    "RootLocus",
    "branches",
    "closed_poles",
    "loop_with_pi",
    "pi_block",
    "root_locus",
    "thesis_gains",
    "with_pade",
    "zeros_of",
]

PADE_ORDER = 3
GAINS = 400  # on a branch, before it is refined
REFINED = 10  # rounds of halving steps
SMOOTH = 2e-3  # of the locus' size, the longest step of a pole


@dataclass(frozen=True)
class PadeError:
    """How far the Padé approximation of the delay, which gives the delay's poles and zeros, is off
    the exact delay.
    """

    order: int
    phase: float  # degrees, at the exact limit's frequency, > 0: the approximation lags less
    limit: Crossing | None  # stability limit with the approximation


@dataclass(frozen=True)
class RootLocus:
    """Open loop and stability limits of a force loop; the limits hold for the exact delay."""

    loop: ForceLoop
    poles: NDArray[
        np.complex128
    ]  # rad/s, those of the Padé approximation included where there is a delay
    zeros: NDArray[np.complex128]  # rad/s
    limit: Crossing | None  # continuous loop; gain in V/N
    sampled_limit: Crossing | None  # loop sampled every `period`; gain in V/N
    period: float  # s
    margins: Margins  # of the sampled loop with the thesis' PI controller (Table 4.6)
    pade: PadeError | None


def root_locus(loop: ForceLoop, *, period: float = 1e-3, pade: int = PADE_ORDER) -> RootLocus:
    """Poles, zeros, limits and margins of a force loop; pade: order of the approximation that shows
    the delay's poles.
    """
    rational = with_pade(loop, pade)
    exact = response(loop.plant, loop.delay)
    limit = stability_limit(exact)
    error = None
    if loop.delay > 0:
        near = stability_limit(response(rational))
        where = np.array([limit.frequency if limit else 1.0 / loop.delay])
        phase = float(np.degrees(np.angle(response(rational)(where) / exact(where)))[0])
        error = PadeError(pade, phase, near)
    seen = loop.sampled(period)
    return RootLocus(
        loop,
        np.sort_complex(rational.poles()),
        zeros_of(rational),
        limit,
        stability_limit(response(seen), period),
        period,
        margins(response(loop_with_pi(loop, period)), period),
        error,
    )


def with_pade(loop: ForceLoop, order: int) -> control.StateSpace:
    """The plant with its delay as a Padé approximation; the plant itself where there is none."""
    if loop.delay == 0:
        return loop.plant
    return control.series(control.ss(control.tf(*control.pade(loop.delay, order))), loop.plant)


def thesis_gains(axis: str) -> tuple[float, float]:
    """K_p [V/N] and K_i [V/(N s)] of the axis' force controller, Table 4.6."""
    gains = gains_named("table_4_6")
    pid = gains.f_z if axis == "z" else gains.f_x
    return pid.k_p, pid.k_i


def pi_block(k_p: float, k_i: float, period: float = 0.0) -> control.StateSpace:
    """PI controller, continuous (period 0) or with the forward rectangle rule of
    `controllers.pi`.
    """
    a, b = (1.0, period) if period else (0.0, 1.0)
    return control.StateSpace(
        [[a]], [[b]], [[k_i]], [[k_p]], period, states=["integral"], remove_useless_states=False
    )


def loop_with_pi(loop: ForceLoop, period: float = 1e-3) -> control.StateSpace:
    """Sampled loop with the thesis' PI controller, from force error to force."""
    return control.series(pi_block(*thesis_gains(loop.axis), period), loop.sampled(period))


def zeros_of(model: control.StateSpace) -> NDArray[np.complex128]:
    """The finite zeros of a one-input one-output model, as many as its relative degree leaves."""
    markov, row = [model.D], model.C
    for _ in range(model.nstates):
        markov.append(row @ model.B)
        row = row @ model.A
    scale = max(float(np.abs(np.array(markov)).max()), 1e-300)
    first = next(
        (i for i, value in enumerate(markov) if abs(value[0, 0]) > 1e-12 * scale), len(markov)
    )
    found = model.zeros()
    count = max(model.nstates - first, 0)
    return np.asarray(np.sort_complex(found[np.argsort(np.abs(found))][:count]), complex)


def closed_poles(model: control.StateSpace, gain: float) -> NDArray[np.complex128]:
    """Poles of the loop that the proportional gain closes, negative feedback."""
    feed = gain / (1 + gain * model.D[0, 0])
    return np.asarray(np.linalg.eigvals(model.A - feed * model.B @ model.C), complex)


def branches(
    model: control.StateSpace, highest: float, count: int = GAINS
) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Gains 0..highest and the closed-loop poles at each (gains, poles), each column one branch.

    Where the poles move far from one gain to the next, as at a break-in point, gains are put
    between, so that the branches are drawn smoothly.
    """
    gains = np.concatenate([[0.0], np.geomspace(1e-5 * highest, highest, count)])
    near = 5.0 * max(float(np.abs(np.r_[model.poles(), zeros_of(model)]).max()), 1.0)
    for _ in range(REFINED):
        found = _followed(model, gains)
        jumps = np.abs(np.diff(found, axis=0))
        jumps[np.abs(found[1:]) > near] = 0.0  # far out nobody looks
        wide = np.flatnonzero(jumps.max(axis=1) > SMOOTH * near)
        if len(wide) == 0:
            break
        gains = np.sort(np.r_[gains, 0.5 * (gains[wide] + gains[wide + 1])])
    return gains, _followed(model, gains)


def _followed(model: control.StateSpace, gains: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Closed-loop poles at each gain, in the order that moves them least."""
    found = [closed_poles(model, float(gains[0]))]
    for gain in gains[1:]:
        now = closed_poles(model, float(gain))
        _, order = linear_sum_assignment(np.abs(found[-1][:, None] - now[None, :]))
        found.append(now[order])
    return np.array(found)
