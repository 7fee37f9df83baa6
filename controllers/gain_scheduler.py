"""PI FV with gains looked up by the edge angle (§5.1, Table 5.1).

Set 1 for theta < 15 deg (also for theta < 0, of which the table says nothing), 2 for 15..30, 3 for
30..45, 4 from 45 deg. Eq. 3-3 to 3-6 put K_i before the integral of the error: when the set
changes, the integral part jumps with K_i (``bumpless=False``, as printed); with ``bumpless=True``
the integral part is kept.
"""

import math
from typing import NamedTuple, Unpack

from numba.extending import register_jitable

from controllers.gains import TABLE_5_1, FvGains, PidGains
from controllers.interface import Command, Controller, Reference, Sense
from controllers.pi_fv import PiFvOptions, PiFvParams, PiFvState, fv_errors, pi_fv_law, pi_fv_params
from controllers.task_frame import task_frame

STEP = math.radians(15.0)  # rad, width of a set of Table 5.1


class GainSchedulerParams(NamedTuple):
    fv: PiFvParams  # offsets and dt; its gains are not used
    sets: tuple[FvGains, FvGains, FvGains, FvGains]
    bumpless: bool


class GainSchedulerState(NamedTuple):
    fv: PiFvState
    active: int  # 0..3, or -1 before the first sample


@register_jitable
def scheduled_set(theta: float) -> int:
    """Row 0..3 of Table 5.1 for theta [rad]."""
    if theta < STEP:
        return 0
    if theta < 2.0 * STEP:
        return 1
    if theta < 3.0 * STEP:
        return 2
    return 3


@register_jitable
def rescaled(integral: float, before: PidGains, now: PidGains) -> float:
    return integral * (now.k_i / before.k_i)


@register_jitable
def gain_scheduler_kernel(
    params: GainSchedulerParams, state: GainSchedulerState, reference: Reference, sense: Sense
) -> tuple[GainSchedulerState, Command]:
    frame = task_frame(sense)
    active = scheduled_set(frame.theta)
    gains, fv = params.sets[active], state.fv
    if state.active >= 0 and active != state.active and not params.bumpless:
        before = params.sets[state.active]
        fv = PiFvState(
            rescaled(fv.i_vx, before.v_x, gains.v_x),
            rescaled(fv.i_fz, before.f_z, gains.f_z),
            rescaled(fv.i_fx, before.f_x, gains.f_x),
            rescaled(fv.i_vz, before.v_z, gains.v_z),
        )
    now = PiFvParams(gains, params.fv.u_0x, params.fv.u_0z, params.fv.dt)
    fv, command = pi_fv_law(now, fv, fv_errors(reference, frame), 0.0, 0.0)
    return GainSchedulerState(fv, active), command


class GainScheduler(Controller[GainSchedulerParams, GainSchedulerState]):
    """PI FV with the gain sets of Table 5.1."""

    kernel = staticmethod(gain_scheduler_kernel)

    def __init__(self, bumpless: bool = False, **fv: Unpack[PiFvOptions]) -> None:
        if "gains" in fv:
            raise ValueError(
                "gains must not be given to gain_scheduler: it takes the sets of Table 5.1"
            )
        super().__init__(GainSchedulerParams(pi_fv_params(**fv), TABLE_5_1, bool(bumpless)))

    def initial_state(self) -> GainSchedulerState:
        return GainSchedulerState(PiFvState(), -1)
