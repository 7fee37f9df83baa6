"""Dual force/velocity controller of Jatta et al. (§3.3, Fig. 3.6): two PID loops in the task frame.

c_n = PID(e_fn), c_t = PID(e_vt) with the errors of Eq. 3-10, 3-11; turned into the axes c_x = c_t
cos - c_n sin, c_z = c_t sin + c_n cos of theta; an estimate of the friction is added per axis, here
that of the VDFM (Eq. 3-18 to 3-21) in the share ``friction`` (0 leaves it out); u_x = u_0x - c_x,
u_z = u_0z + c_z, each clipped to 0..5 V.

Silent in the thesis: the gains (taken from the f_z and v_x loops of Table 3.11, so that both
controllers agree on a flat edge), Jatta's recursive update of the friction parameters (constant
here), and windup (both integrators stop taking errors that drive a clipped axis further out).
"""

from typing import NamedTuple

from numba.extending import register_jitable

from controllers.gains import TABLE_3_11, PidGains
from controllers.interface import Command, Controller, Reference, Sense, clip_command
from controllers.pi import barred_side
from controllers.pi_fv import DT, pi_fv_params
from controllers.pid import PidState, pid_next, pid_output
from controllers.task_frame import TaskFrame, task_frame
from controllers.valve import K_X, K_Z, U_0X, U_0Z
from controllers.vdfm import VDFM_X, VDFM_Z, VdfmParams, vdfm_coulomb


class DfvParams(NamedTuple):
    force: PidGains  # V/N, V/(N s), V s/N
    velocity: PidGains  # V/(m/s), V/m, V s/(m/s)
    friction: float  # share 0..1 of the friction estimate that is added
    x: VdfmParams
    z: VdfmParams
    k_x: float  # N/V
    k_z: float  # N/V
    u_0x: float  # V
    u_0z: float  # V
    dt: float  # s


class DfvState(NamedTuple):
    normal: PidState = PidState()
    tangential: PidState = PidState()


@register_jitable
def barred_error(error: float, along_x: float, along_z: float, x_bar: int, z_bar: int) -> int:
    """Sign of error where it drives a clipped axis further out, else 0; along_x, along_z: dc_x/dc,
    dc_z/dc.
    """
    if x_bar * along_x * error > 0.0 or z_bar * along_z * error > 0.0:
        return 1 if error > 0.0 else -1
    return 0


@register_jitable
def friction_volts(params: DfvParams, sense: Sense) -> tuple[float, float]:
    """Friction estimate as a_x, a_z [V] (Eq. 3-18 to 3-21)."""
    friction_x = vdfm_coulomb(params.x, sense.v_x, sense.f_ax) + params.x.c * sense.v_x
    friction_z = vdfm_coulomb(params.z, sense.v_z, sense.f_az) + params.z.c * sense.v_z
    return params.friction * friction_x / params.k_x, params.friction * friction_z / params.k_z


@register_jitable
def dfv_kernel(
    params: DfvParams, state: DfvState, reference: Reference, sense: Sense
) -> tuple[DfvState, Command]:
    frame: TaskFrame = task_frame(sense)
    e_fn = reference.f_nd - frame.f_n
    e_vt = reference.v_td - frame.v_t
    c_n = pid_output(params.force, state.normal, e_fn, params.dt)
    c_t = pid_output(params.velocity, state.tangential, e_vt, params.dt)
    a_x, a_z = friction_volts(params, sense)
    u_x = params.u_0x - (c_t * frame.cos - c_n * frame.sin + a_x)
    u_z = params.u_0z + (c_t * frame.sin + c_n * frame.cos + a_z)
    x_bar, z_bar = barred_side(u_x, -1), barred_side(u_z, 1)
    n_bar = barred_error(e_fn, -frame.sin, frame.cos, x_bar, z_bar)
    t_bar = barred_error(e_vt, frame.cos, frame.sin, x_bar, z_bar)
    normal = pid_next(params.force, state.normal, e_fn, params.dt, n_bar)
    tangential = pid_next(params.velocity, state.tangential, e_vt, params.dt, t_bar)
    return DfvState(normal, tangential), Command(clip_command(u_x), clip_command(u_z))


class Dfv(Controller[DfvParams, DfvState]):
    """Dual force/velocity controller in the task frame."""

    kernel = staticmethod(dfv_kernel)

    def __init__(
        self,
        *,
        force: PidGains = TABLE_3_11.f_z,
        velocity: PidGains = TABLE_3_11.v_x,
        friction: float = 1.0,
        u_0x: float = U_0X,
        u_0z: float = U_0Z,
        dt: float = DT,
    ) -> None:
        if not 0.0 <= friction <= 1.0:
            raise ValueError(f"friction must be within 0..1, got {friction}")
        base = pi_fv_params(u_0x=u_0x, u_0z=u_0z, dt=dt)
        force, velocity = PidGains(*map(float, force)), PidGains(*map(float, velocity))
        super().__init__(
            DfvParams(
                force,
                velocity,
                float(friction),
                VDFM_X,
                VDFM_Z,
                K_X,
                K_Z,
                base.u_0x,
                base.u_0z,
                base.dt,
            )
        )

    def initial_state(self) -> DfvState:
        return DfvState()
