"""PI force/velocity controller (Eq. 3-3 to 3-17, gains Table 3.11 = 4.6).

e_fn = f_nd - f_n, e_vt = v_td - v_t (3-10, 3-11); e_fz = e_fn cos, e_vz = e_vt sin, e_fx = -e_fn
sin, e_vx = e_vt cos of theta (3-12 to 3-15); c_z = PI(e_fz) + PI(e_vz), c_x = PI(e_vx) + PI(e_fx)
(3-16, 3-17); u_x = u_0x - c_x (the x valve pushes towards -x), u_z = u_0z + c_z, each clipped to
0..5 V.
"""

from typing import NamedTuple, TypedDict, Unpack

from numba.extending import register_jitable

from controllers.gains import FvGains, Gains, gains_named
from controllers.interface import Command, Controller, Reference, Sense, clip_command
from controllers.pi import barred_side, pi_integrate, pi_output
from controllers.task_frame import TaskFrame, task_frame
from controllers.valve import U_0X, U_0Z

DT = 1e-3  # s, sampling time, §3.1


class PiFvParams(NamedTuple):
    gains: FvGains
    u_0x: float = U_0X  # V
    u_0z: float = U_0Z  # V
    dt: float = DT  # s


class PiFvOptions(TypedDict, total=False):
    """What every controller built on PI FV takes besides its own options."""

    gains: Gains
    u_0x: float
    u_0z: float
    dt: float


class PiFvState(NamedTuple):
    """Integrals [V] of the four PI controllers."""

    i_vx: float = 0.0
    i_fz: float = 0.0
    i_fx: float = 0.0
    i_vz: float = 0.0


class FvErrors(NamedTuple):
    """Errors of the four loops, in the order of the gain tables."""

    v_x: float  # m/s
    f_z: float  # N
    f_x: float  # N
    v_z: float  # m/s


@register_jitable
def fv_errors(reference: Reference, frame: TaskFrame) -> FvErrors:
    """Eq. 3-10 to 3-15."""
    e_fn = reference.f_nd - frame.f_n
    e_vt = reference.v_td - frame.v_t
    return FvErrors(e_vt * frame.cos, e_fn * frame.cos, -e_fn * frame.sin, e_vt * frame.sin)


@register_jitable
def pi_fv_law(
    params: PiFvParams, state: PiFvState, errors: FvErrors, a_x: float, a_z: float
) -> tuple[PiFvState, Command]:
    """Eq. 3-16, 3-17 with a_x, a_z [V] of a compensator added to c_x, c_z; > 0 pushes towards +x,
    +z.
    """
    gains, dt = params.gains, params.dt
    c_x = (
        pi_output(gains.v_x, state.i_vx, errors.v_x)
        + pi_output(gains.f_x, state.i_fx, errors.f_x)
        + a_x
    )
    c_z = (
        pi_output(gains.f_z, state.i_fz, errors.f_z)
        + pi_output(gains.v_z, state.i_vz, errors.v_z)
        + a_z
    )
    u_x = params.u_0x - c_x
    u_z = params.u_0z + c_z
    x_bar, z_bar = barred_side(u_x, -1), barred_side(u_z, 1)
    moved = PiFvState(
        pi_integrate(gains.v_x, state.i_vx, errors.v_x, dt, x_bar),
        pi_integrate(gains.f_z, state.i_fz, errors.f_z, dt, z_bar),
        pi_integrate(gains.f_x, state.i_fx, errors.f_x, dt, x_bar),
        pi_integrate(gains.v_z, state.i_vz, errors.v_z, dt, z_bar),
    )
    return moved, Command(clip_command(u_x), clip_command(u_z))


@register_jitable
def pi_fv_kernel(
    params: PiFvParams, state: PiFvState, reference: Reference, sense: Sense
) -> tuple[PiFvState, Command]:
    return pi_fv_law(params, state, fv_errors(reference, task_frame(sense)), 0.0, 0.0)


def pi_fv_params(
    gains: Gains = "table_3_11", u_0x: float = U_0X, u_0z: float = U_0Z, dt: float = DT
) -> PiFvParams:
    """Raises ValueError for gains with a derivative part (Table 3.5), an offset outside 0..5 V and
    dt <= 0.
    """
    named = gains_named(gains)
    for loop, pid in zip(FvGains._fields, named, strict=True):
        if pid.k_d != 0.0:
            raise ValueError(f"{loop}.k_d must be 0 in a PI controller, got {pid.k_d}; take pid_fv")
    for name, u_0 in (("u_0x", u_0x), ("u_0z", u_0z)):
        if not 0.0 <= u_0 <= 5.0:
            raise ValueError(f"{name} must be within 0..5 V, got {u_0}")
    if not dt > 0.0:
        raise ValueError(f"dt must be > 0 s, got {dt}")
    return PiFvParams(named, float(u_0x), float(u_0z), float(dt))


class PiFv(Controller[PiFvParams, PiFvState]):
    """PI force/velocity controller of the thesis."""

    kernel = staticmethod(pi_fv_kernel)

    def __init__(self, **options: Unpack[PiFvOptions]) -> None:
        super().__init__(pi_fv_params(**options))

    def initial_state(self) -> PiFvState:
        return PiFvState()
