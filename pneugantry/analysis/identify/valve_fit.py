"""K, u_0 and tau of a valve by one fit of Eq. 4-5 to whole logs of the actuator force."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pneugantry.analysis.identify.gauss_newton import least_squares
from pneugantry.analysis.identify.interval import Estimate
from pyfmi_runner.campaign import LoggedRun
from pyfmi_runner.first_order import first_order
from pyfmi_runner.log import PERIOD, SIGMA

__all__ = ["ValveFit", "valve_fit"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ValveFit:
    """K [N/V], u_0 [V], tau [s] of Eq. 4-5 by one fit to a whole log; `gap`: RMS of its residual in
    sensor noise.
    """

    log: str
    axis: str
    position: float  # m, mean
    K: Estimate
    u_0: Estimate
    tau: Estimate
    gap: float


def valve_fit(
    runs: Sequence[LoggedRun],
    axis: str,
    direction: float,
    guess: tuple[float, float, float],
    limit: float,
) -> ValveFit | None:
    """Fit of Eq. 4-5 to the measured actuator force of some logs for their recorded commands.
    guess: K, u_0, tau; limit: f_max [N].

    None where the command never opens the valve far enough to tell the three apart.
    """
    commands = [run.log[f"u_{axis}"] for run in runs]
    forces = [run.log[f"f_a{axis}"] for run in runs]

    def residual(p: Array) -> Array:
        return np.concatenate(
            [
                (_lagged(u, p, direction, limit) - f) / SIGMA["f_ax"]
                for u, f in zip(commands, forces, strict=True)
            ]
        )

    scale = np.array(guess)
    found = least_squares(residual, scale, scale, (0.02 * scale, 50 * scale))
    information = found.information * np.outer(scale, scale)
    if not (np.diag(information) > 0).all() or np.linalg.cond(information) > 1e13:
        return None
    gap = math.sqrt(float(np.mean(found.residual**2)))
    sigma = max(1.0, gap) * np.sqrt(np.diag(np.linalg.inv(information))) * scale
    K, u_0, tau = (Estimate(float(v), float(s)) for v, s in zip(found.x, sigma, strict=True))
    position = float(np.mean(np.concatenate([run.log[axis] for run in runs])))
    return ValveFit(" ".join(run.log.name for run in runs), axis, position, K, u_0, tau, gap)


def _lagged(command: Array, p: Array, direction: float, limit: float) -> Array:
    """Force at each sample for commands held over the millisecond behind it; exact for Eq. 4-5."""
    K, u_0, tau = p
    fade = math.exp(-PERIOD / tau)
    target = direction * np.minimum(K * np.maximum(command - u_0, 0.0), limit)
    return first_order(np.concatenate([[0.0], target[:-1]]), 1.0 - fade, fade)
