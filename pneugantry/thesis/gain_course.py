"""The gains that the scheduler of Table 5.1 takes along an edge (Fig. 5.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from controllers.gain_scheduler import scheduled_set
from controllers.gains import TABLE_5_1

__all__ = ["scheduled_course"]


def scheduled_course(theta: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """K_p of v_x and f_z, K_i of v_x and f_z at each angle [rad]."""
    sets = [TABLE_5_1[scheduled_set(float(angle))] for angle in theta]
    return {
        "K_p of v_x": np.array([s.v_x.k_p for s in sets]),
        "K_i of v_x": np.array([s.v_x.k_i for s in sets]),
        "K_p of f_z": np.array([s.f_z.k_p for s in sets]),
        "K_i of f_z": np.array([s.f_z.k_i for s in sets]),
    }
