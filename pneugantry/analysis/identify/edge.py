"""K_c and C_c (Eq. 4-3): the measured contact force over the deflection that the measured positions
and the known edge give.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pneugantry.analysis.identify.interval import Estimate
from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.log import SIGMA
from pyfmi_runner.smoothing import smooth_axis
from pyfmi_runner.workpiece import workpiece

__all__ = ["Edge", "edge_test"]

Array = NDArray[np.float64]
DEEP = 1e-4  # m of deflection from which on a sample counts
FEWEST = 500  # samples


@dataclass(frozen=True)
class Edge:
    """Stiffness [N/m] and damping [N s/m] of the contact; `gap`: RMS of what is left, in noise of
    the force sensor.
    """

    K_c: Estimate
    C_c: Estimate
    gap: float


def edge_test(campaign: Campaign) -> Edge | None:
    """Regression of f_n on delta and its rate over all samples in contact; None without contact.

    The measured speeds are noisy regressors: what their known noise adds to the normal matrix is
    taken off again.
    """
    parts = list(_contacts(campaign))
    if sum(len(force) for force, _, _ in parts) < FEWEST:
        return None
    force, design, noise = (np.concatenate([part[i] for part in parts]) for i in range(3))
    normal = design.T @ design
    normal[1, 1] -= float(noise.sum())
    if normal[1, 1] <= 0:
        return None
    inverse = np.linalg.inv(normal)
    K_c, C_c = inverse @ design.T @ force
    rest = force - design @ (K_c, C_c)
    sigma = np.sqrt(np.diag(inverse)) * float(np.std(rest))
    return Edge(
        Estimate(float(K_c), float(sigma[0])),
        Estimate(float(C_c), float(sigma[1])),
        float(np.std(rest)) / SIGMA["f_z"],
    )


def _contacts(campaign: Campaign) -> Iterator[tuple[Array, Array, Array]]:
    """(f_n, [delta, rate], variance of the rate's noise) of the samples in contact, log by log."""
    for run in campaign:
        if run.setup.workpiece != "none":
            yield _contact(run)


def _contact(run: LoggedRun) -> tuple[Array, Array, Array]:
    log, setup = run.log, run.setup
    x, z = (smooth_axis(log[a], log[f"v_{a}"], SIGMA[a], SIGMA[f"v_{a}"]).position for a in "xz")
    edge = workpiece(setup.workpiece, surface_finish=setup.surface_finish)
    slope = edge.slope(x)
    c = 1 / np.sqrt(1 + slope**2)
    delta = (z - setup.z_0 - edge.height(x)) * c
    rate = (log["v_z"] - slope * log["v_x"]) * c
    force = (log["f_z"] - slope * log["f_x"]) * c
    noise = (SIGMA["v_z"] ** 2 + (slope * SIGMA["v_x"]) ** 2) * c**2
    deep = (delta > DEEP) & (force > 20 * math.sqrt(2) * SIGMA["f_z"])
    return force[deep], np.column_stack([delta, rate])[deep], noise[deep]
