"""The thesis' PI force/velocity controller (Eq. 3-7 to 3-17), compiled, once a millisecond."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

GAINS = {  # Table 4.6
    "Kp_vx": 1.0,
    "Ki_vx": 4.0,
    "Kp_fz": 0.02,
    "Ki_fz": 0.08,
    "Kp_fx": 0.01,
    "Ki_fx": 0.03,
    "Kp_vz": 0.5,
    "Ki_vz": 2.0,
}
U_ZERO = (0.635, 0.735)  # V, the controller's dead points; the plant's own may differ
LEAST_FORCE = 2.0  # N, below it the edge's angle is taken as 0
PERIOD = 1e-3  # s
U_MAX = 5.0  # V


def gain_array(gains: dict[str, float] | None = None) -> np.ndarray:
    """Gains as rows (K_p [V per unit], K_i) of v_x, f_x, f_z, v_z."""
    g = GAINS if gains is None else gains
    return np.array([[g[f"Kp_{name}"], g[f"Ki_{name}"]] for name in ("vx", "fx", "fz", "vz")])


class Errors(NamedTuple):
    """Two control errors of an axis: rows in the gains, and values [m/s or N]."""

    first: int
    second: int
    e_first: float
    e_second: float


@njit
def _drive(gains: np.ndarray, integral: np.ndarray, e: Errors, base: float, sense: float) -> float:
    """Command [V] of an axis from two PI terms; their integrals [error s] advance by the forward
    rectangle rule.
    """
    c = gains[e.first, 0] * e.e_first + gains[e.first, 1] * integral[e.first]
    c += gains[e.second, 0] * e.e_second + gains[e.second, 1] * integral[e.second]
    u = base + sense * c
    for row, error in ((e.first, e.e_first), (e.second, e.e_second)):
        above, below = u > U_MAX, u < 0.0
        if (
            (not above and not below)
            or (above and sense * error < 0.0)
            or (below and sense * error > 0.0)
        ):
            integral[row] += PERIOD * error
    return min(max(u, 0.0), U_MAX)


@njit
def control(
    gains: np.ndarray, integral: np.ndarray, f_nd: float, v_td: float, sensed: np.ndarray
) -> tuple[float, float]:
    """(u_x, u_z) [V] from the eight sensed channels; `integral` is the state, 0 when the contact
    phase starts.
    """
    f_x, f_z = sensed[4], sensed[5]
    cosine, sine = 1.0, 0.0
    if math.hypot(f_x, f_z) >= LEAST_FORCE:
        theta = math.atan2(-f_x, f_z)
        cosine, sine = math.cos(theta), math.sin(theta)
    e_fn = f_nd - (-f_x * sine + f_z * cosine)
    e_vt = v_td - (sensed[2] * cosine + sensed[3] * sine)
    u_x = _drive(gains, integral, Errors(0, 1, e_vt * cosine, -e_fn * sine), U_ZERO[0], -1.0)
    u_z = _drive(gains, integral, Errors(2, 3, e_fn * cosine, e_vt * sine), U_ZERO[1], 1.0)
    return u_x, u_z
