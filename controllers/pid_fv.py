"""PID force/velocity controller (Eq. 3-3 to 3-17): PI FV with the derivative parts of Table 3.5.

The thesis dropped them after tuning step 2 (§3.4.2).
"""

from typing import NamedTuple

from numba.extending import register_jitable

from controllers.gains import FvGains, Gains, gains_named
from controllers.interface import Command, Controller, Reference, Sense, clip_command
from controllers.pi import barred_side
from controllers.pi_fv import DT, PiFvParams, fv_errors, pi_fv_params
from controllers.pid import PidState, pid_next, pid_output
from controllers.task_frame import task_frame
from controllers.valve import U_0X, U_0Z


class PidFvState(NamedTuple):
    v_x: PidState = PidState()
    f_z: PidState = PidState()
    f_x: PidState = PidState()
    v_z: PidState = PidState()


@register_jitable
def pid_fv_kernel(
    params: PiFvParams, state: PidFvState, reference: Reference, sense: Sense
) -> tuple[PidFvState, Command]:
    gains, dt = params.gains, params.dt
    e = fv_errors(reference, task_frame(sense))
    c_x = pid_output(gains.v_x, state.v_x, e.v_x, dt) + pid_output(gains.f_x, state.f_x, e.f_x, dt)
    c_z = pid_output(gains.f_z, state.f_z, e.f_z, dt) + pid_output(gains.v_z, state.v_z, e.v_z, dt)
    u_x = params.u_0x - c_x
    u_z = params.u_0z + c_z
    x_bar, z_bar = barred_side(u_x, -1), barred_side(u_z, 1)
    moved = PidFvState(
        pid_next(gains.v_x, state.v_x, e.v_x, dt, x_bar),
        pid_next(gains.f_z, state.f_z, e.f_z, dt, z_bar),
        pid_next(gains.f_x, state.f_x, e.f_x, dt, x_bar),
        pid_next(gains.v_z, state.v_z, e.v_z, dt, z_bar),
    )
    return moved, Command(clip_command(u_x), clip_command(u_z))


class PidFv(Controller[PiFvParams, PidFvState]):
    """PID force/velocity controller of tuning step 1."""

    kernel = staticmethod(pid_fv_kernel)

    def __init__(
        self, gains: Gains = "table_3_5", u_0x: float = U_0X, u_0z: float = U_0Z, dt: float = DT
    ) -> None:
        named: FvGains = gains_named(gains)
        super().__init__(pi_fv_params(u_0x=u_0x, u_0z=u_0z, dt=dt)._replace(gains=named))

    def initial_state(self) -> PidFvState:
        return PidFvState()
