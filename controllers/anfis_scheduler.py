"""PI FV with an ANFIS gain scheduler (Fig. 3.10): Table 5.1 made smooth over the edge angle.

One input, theta, with four Gaussian memberships at the middles of the table's rows, and for each of
the eight gains a constant consequent per rule, by least squares to the lookup table over 0..60
degrees. The integral parts keep their value when gains change: a smooth schedule has no jump to
carry through (``gain_scheduler`` has the printed one).
"""

import math
from typing import NamedTuple, Unpack

import numpy as np
from numba.extending import register_jitable

from controllers.gain_scheduler import STEP, scheduled_set
from controllers.gains import TABLE_5_1, FvGains, PidGains
from controllers.interface import Command, Controller, Reference, Sense
from controllers.pi_fv import PiFvOptions, PiFvParams, PiFvState, fv_errors, pi_fv_law, pi_fv_params
from controllers.task_frame import task_frame

CENTRES = tuple((row + 0.5) * STEP for row in range(4))  # rad
WIDTH = 0.42 * STEP  # rad: neighbours cross at a half
HIGHEST = math.radians(60.0)  # rad, end of the training range


class AnfisSchedulerParams(NamedTuple):
    fv: PiFvParams  # offsets and dt; its gains are not used
    consequent: np.ndarray  # (4, 8): k_p and k_i of v_x, f_z, f_x, v_z per rule


@register_jitable
def scheduled_gains(consequent: np.ndarray, theta: float) -> FvGains:
    """Gains at theta [rad]; below the first and above the last row theirs."""
    at = min(max(theta, CENTRES[0]), CENTRES[3])
    w_0, w_1 = grade(at, CENTRES[0]), grade(at, CENTRES[1])
    w_2, w_3 = grade(at, CENTRES[2]), grade(at, CENTRES[3])
    total = w_0 + w_1 + w_2 + w_3
    w_0, w_1, w_2, w_3 = w_0 / total, w_1 / total, w_2 / total, w_3 / total
    c = consequent
    return FvGains(
        PidGains(mixed(c, 0, w_0, w_1, w_2, w_3), mixed(c, 1, w_0, w_1, w_2, w_3), 0.0),
        PidGains(mixed(c, 2, w_0, w_1, w_2, w_3), mixed(c, 3, w_0, w_1, w_2, w_3), 0.0),
        PidGains(mixed(c, 4, w_0, w_1, w_2, w_3), mixed(c, 5, w_0, w_1, w_2, w_3), 0.0),
        PidGains(mixed(c, 6, w_0, w_1, w_2, w_3), mixed(c, 7, w_0, w_1, w_2, w_3), 0.0),
    )


@register_jitable
def grade(theta: float, centre: float) -> float:
    a = (theta - centre) / WIDTH
    return math.exp(-0.5 * a * a)


@register_jitable
def mixed(c: np.ndarray, gain: int, w_0: float, w_1: float, w_2: float, w_3: float) -> float:
    return max(w_0 * c[0, gain] + w_1 * c[1, gain] + w_2 * c[2, gain] + w_3 * c[3, gain], 0.0)


@register_jitable
def anfis_scheduler_kernel(
    params: AnfisSchedulerParams, state: PiFvState, reference: Reference, sense: Sense
) -> tuple[PiFvState, Command]:
    frame = task_frame(sense)
    now = PiFvParams(
        scheduled_gains(params.consequent, frame.theta),
        params.fv.u_0x,
        params.fv.u_0z,
        params.fv.dt,
    )
    return pi_fv_law(now, state, fv_errors(reference, frame), 0.0, 0.0)


def fitted_consequents() -> np.ndarray:
    """Least squares to Table 5.1, (4, 8)."""
    theta = np.linspace(0.0, HIGHEST, 241)[:-1]
    weights = np.array([[grade(float(t), centre) for centre in CENTRES] for t in theta])
    weights /= weights.sum(axis=1, keepdims=True)
    table = np.array(
        [[k for pid in TABLE_5_1[scheduled_set(float(t))] for k in pid[:2]] for t in theta]
    )
    return np.asarray(np.linalg.lstsq(weights, table, rcond=None)[0])


class AnfisScheduler(Controller[AnfisSchedulerParams, PiFvState]):
    """PI FV with an ANFIS over Table 5.1."""

    kernel = staticmethod(anfis_scheduler_kernel)

    def __init__(self, **fv: Unpack[PiFvOptions]) -> None:
        if "gains" in fv:
            raise ValueError(
                "gains must not be given to anfis_scheduler: it takes the sets of Table 5.1"
            )
        super().__init__(AnfisSchedulerParams(pi_fv_params(**fv), fitted_consequents()))

    def initial_state(self) -> PiFvState:
        return PiFvState()
