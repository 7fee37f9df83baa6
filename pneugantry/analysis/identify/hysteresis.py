"""beta and sigma of the DDFM (Eq. 4-8) from the hysteresis of a constrained open-loop test (section
4.2.2, Fig. 4.14, 4.17).

The workpiece holds the piston while the valve pushes and lets go. Eq. 4-6 gives the friction, F =
f_a - f_c - F_w - C v - m a, over the displacement s. From a reversal on, F' = sigma v (1 - F/beta
sgn v)^2 is solved by 1/(1 - F/beta) = 1/(1 - F_0/beta) + sigma s/beta (both counted in the
direction of motion), so the branch behind the reversal gives beta and sigma.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.log import PERIOD, SIGMA
from pyfmi_runner.smoothing import smooth_axis

__all__ = ["Branch", "Hysteresis", "branch", "hysteresis", "loop"]

Array = NDArray[np.float64]
MEAN = 25  # samples averaged into one point
LEAST_TRAVEL = 2e-4  # m, of a branch that shows anything
# m per 25 ms; faster points leave the branch: friction is a rate law there, or the mass is in
# flight
SLIP = 2e-5
FORCE_NOISE = 0.5  # N, of one point: 5 um of position on the steep part
# m; a creep between half the limit force either way that is less is the smoothed position's own
# error
SEEN = 3e-5
GRID = 500  # points of the drawn law


@dataclass(frozen=True, eq=False)
class Branch:
    """Friction [N] over displacement from the reversal [m], both in the direction of motion; and
    the fitted law [N] on a grid of displacements [m], for a smooth curve.
    """

    log: str
    displacement: Array
    friction: Array
    grid: Array
    fitted: Array


@dataclass(frozen=True, eq=False)
class Hysteresis:
    """beta [N] and sigma [N/m] of Eq. 4-8; rms [N] of what the branch leaves. presliding: it creeps
    by more than the sensors' error.
    """

    beta: float
    sigma: float
    rms: float
    presliding: bool
    branch: Branch


def loop(run: LoggedRun, m: float, C: float, cable: float) -> tuple[Array, Array]:
    """(z [m], friction [N]) of a log as in Fig. 4.14, means over 25 ms."""
    log = run.log
    z = smooth_axis(log["z"], log["v_z"], SIGMA["z"], SIGMA["v_z"]).position
    rate = np.gradient(_means(log["v_z"]), MEAN * PERIOD)
    return _means(z), _means(log["f_az"] - log["f_z"] - C * log["v_z"]) - cable - m * rate


def _means(values: Array) -> Array:
    n = len(values) // MEAN
    return np.asarray(values[: n * MEAN].reshape(n, MEAN).mean(axis=1))


def branch(run: LoggedRun, m: float, C: float, cable: float) -> tuple[Array, Array] | None:
    """(displacement, friction) from the deepest point on, in the direction of motion (back); None
    without a reversal.
    """
    z, friction = loop(run, m, C, cable)
    pressed = _means(run.log["f_z"])
    deepest = int(np.flatnonzero(pressed > pressed.max() - 0.5)[-1])
    before = friction[: deepest + 1]
    turn = int(
        np.flatnonzero(before > before[deepest // 2 :].max() - 1.0)[-1]
    )  # where the friction begins to let go
    back = z[turn] - z[turn:]
    if len(back) < 20 or back.max() < LEAST_TRAVEL:
        return None
    held = (pressed[turn:] > 1.0) & (np.abs(np.gradient(back)) < SLIP)
    return back[held], -friction[turn:][held]


def hysteresis(campaign: Campaign, m: float, C: float, cable: float) -> Hysteresis | None:
    """From the open-loop log in which the workpiece is pressed hardest; None where there is none.
    m, C, cable (F_w) of the z axis.
    """
    pushes = [run for run in campaign if run.setup.loop == "open" and run.setup.workpiece != "none"]
    if not pushes:
        return None
    run = max(pushes, key=lambda run: float(run.log["f_z"].max()))
    points = branch(run, m, C, cable)
    if points is None:
        return None
    travel, friction = points

    def law(p: Array, travel: Array = travel) -> Array:
        beta, sigma = np.exp(p[:2])
        first = min(p[2] / beta, 0.99)
        return np.asarray(
            beta * (1.0 - 1.0 / (1.0 / (1.0 - first) + sigma * np.maximum(travel, 0.0) / beta))
        )

    def residual(p: Array) -> Array:
        return (friction - law(p)) / FORCE_NOISE

    top = max(float(np.max(friction)), 1.0)
    first = float(friction[:3].mean())
    start = np.array([math.log(top), math.log(top / 1e-4), first])
    bounds = np.array([[0.0, math.log(1e2), first - 2.0], [6.0, math.log(1e8), first + 2.0]])
    found = least_squares(
        residual, np.clip(start, bounds[0] + 1e-3, bounds[1] - 1e-3), loss="soft_l1", bounds=bounds
    )
    beta, sigma = (float(v) for v in np.exp(found.x[:2]))
    rms = float(np.sqrt(np.mean((friction - law(found.x)) ** 2)))
    grid = np.linspace(0.0, float(travel.max()), GRID)
    return Hysteresis(
        beta,
        sigma,
        rms,
        beta / sigma * (2.0 - 2.0 / 3.0) > SEEN,
        Branch(run.log.name, travel, friction, grid, law(found.x, grid)),
    )
