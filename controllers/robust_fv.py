"""Force/velocity controller that bears other friction laws, dead time and a second valve stage:
lag inversion with a rate term, friction observer with a lead, proportional-integral action.

In the task frame a normal force f_dn = f_nd + k_p e_fn + I_n - d v_n (k_p and d of each axis) and a
tangential one f_dt = k_v e_vt + I_t are asked for, and turned into the axes. Each axis adds a share
of its friction as observed and led, f_d = f + share (phi + lead phi'), and drives its valve
(tau f' + f = K (u - u_0), Eq. 4-5) by u = u_0 + (f_d + k_f (f_d - f_a) - k_d f_a') / K. k_d acts
as a longer lag: it leaves room for k_f and k_p where dead time and the valve's own stages take
phase (Table 3.2: 40 ms).

Observer: phi' = (f_a - f_c - m a - phi) / T, written with s = phi + m v / T so that no acceleration
is needed; its bandwidth is 1 / T: 200 rad/s on z, 15 rad/s on x. A second stage of the same T gives
the lead: phi_2' = (phi - phi_2) / T, phi + lead phi' ~ phi_2 + lead (phi - phi_2) / T. Friction is
measured as soon as it acts, so only the actuator is late: in sliding the error is phi times
s (tau + k_d - (1 + k_f) lead) over (1 + k_f) (1 + k_p). Stuck, part of phi is the answer of the
presliding spring to f_a itself, a positive feedback: hence a share below 1.

Anti-windup: integrals wait while an axis is clipped outwards; the observer reads the measured f_a
and needs none. Gains: `pneugantry.thesis.robust_design`.
"""

import math
from typing import NamedTuple

from numba.extending import register_jitable

from controllers.interface import Command, Controller, Reference, Sense, clip_command
from controllers.observer_fv import M_X, M_Z, integral_next, observed, observer_next
from controllers.pi import barred_side
from controllers.pi_fv import DT
from controllers.task_frame import task_frame
from controllers.valve import K_X, K_Z, U_0X, U_0Z


class RobustFvParams(NamedTuple):
    """Defaults: tuned on runs that no board scores (`pneugantry.thesis.robust_design`)."""

    k_px: float = 3.6  # share of the normal force error that is added, x axis
    k_pz: float = 0.98  # z axis
    k_i: float = 0.49  # 1/s
    damping_x: float = 480.0  # N s/m, on v_n, x axis
    damping_z: float = 420.0  # N s/m, z axis
    k_v: float = 127.0  # N s/m, on e_vt
    k_vi: float = 40.0  # N/m
    k_fx: float = 6.3  # feedback of the x valve's force error
    k_fz: float = 1.6  # of the z valve's
    t_x: float = 0.065  # s, observer's time constants
    t_z: float = 0.005  # s
    lead_x: float = 0.0  # s
    lead_z: float = 0.092  # s
    k_dx: float = 0.012  # s, on the rate of the actuator force
    k_dz: float = 0.075  # s
    t_d: float = 0.018  # s, filter of that rate
    share_x: float = 0.6  # share of the observed friction that is added
    share_z: float = 0.84
    phi_max: float = 40.0  # N, limit of the observed friction, and of its lead's part
    dt: float = DT  # s


class RobustFvState(NamedTuple):
    i_n: float = 0.0  # N
    i_t: float = 0.0  # N
    s_x: float = 0.0  # N, phi + m v / T
    s_z: float = 0.0  # N
    slow_x: float = 0.0  # N, phi_2
    slow_z: float = 0.0  # N
    held_x: float = 0.0  # N, filtered actuator force
    held_z: float = 0.0  # N
    started: bool = False


@register_jitable
def led(phi: float, slow: float, lead: float, t: float, limit: float) -> float:
    """phi_2 + lead phi' [N]; the lead's part within the limit."""
    part = lead * (phi - slow) / t
    return slow + min(max(part, -limit), limit)


@register_jitable
def robust_fv_kernel(
    params: RobustFvParams, state: RobustFvState, reference: Reference, sense: Sense
) -> tuple[RobustFvState, Command]:
    frame = task_frame(sense)
    e_fn, e_vt = reference.f_nd - frame.f_n, reference.v_td - frame.v_t
    v_n = -sense.v_x * frame.sin + sense.v_z * frame.cos
    f_nx = reference.f_nd + params.k_px * e_fn + state.i_n - params.damping_x * v_n
    f_nz = reference.f_nd + params.k_pz * e_fn + state.i_n - params.damping_z * v_n
    f_t = params.k_v * e_vt + state.i_t
    phi_x = observed(state.s_x, M_X, sense.v_x, params.t_x, params.phi_max)
    phi_z = observed(state.s_z, M_Z, sense.v_z, params.t_z, params.phi_max)
    f_x = f_t * frame.cos - f_nx * frame.sin
    f_z = f_t * frame.sin + f_nz * frame.cos
    f_x += params.share_x * led(phi_x, state.slow_x, params.lead_x, params.t_x, params.phi_max)
    f_z += params.share_z * led(phi_z, state.slow_z, params.lead_z, params.t_z, params.phi_max)
    held_x = state.held_x if state.started else sense.f_ax
    held_z = state.held_z if state.started else sense.f_az
    rate_x = (sense.f_ax - held_x) / params.t_d
    rate_z = (sense.f_az - held_z) / params.t_d
    u_x = U_0X - (f_x + params.k_fx * (f_x - sense.f_ax) - params.k_dx * rate_x) / K_X
    u_z = U_0Z + (f_z + params.k_fz * (f_z - sense.f_az) - params.k_dz * rate_z) / K_Z
    bars, dt = (barred_side(u_x, -1), barred_side(u_z, 1)), params.dt
    moved = RobustFvState(
        integral_next(state.i_n, e_fn, params.k_i * dt, (-frame.sin, frame.cos), bars),
        integral_next(state.i_t, e_vt, params.k_vi * dt, (frame.cos, frame.sin), bars),
        observer_next(state.s_x, M_X, sense.v_x, sense.f_ax - sense.f_x, params.t_x, dt),
        observer_next(state.s_z, M_Z, sense.v_z, sense.f_az - sense.f_z, params.t_z, dt),
        state.slow_x + dt / params.t_x * (phi_x - state.slow_x),
        state.slow_z + dt / params.t_z * (phi_z - state.slow_z),
        held_x + dt * rate_x,
        held_z + dt * rate_z,
        True,
    )
    return moved, Command(clip_command(u_x), clip_command(u_z))


class RobustFv(Controller[RobustFvParams, RobustFvState]):
    """Lag inversion and led friction observer; options are the fields of ``RobustFvParams``."""

    kernel = staticmethod(robust_fv_kernel)

    def __init__(self, **options: float) -> None:
        known = RobustFvParams._fields
        unknown = [name for name in options if name not in known]
        if unknown:
            raise ValueError(f"unknown option {unknown[0]!r}; known are {', '.join(known)}")
        params = RobustFvParams(**options)
        for name, value in zip(known, params, strict=True):
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name} must be finite and >= 0, got {value}")
        for name in ("t_x", "t_z", "t_d"):
            if getattr(params, name) < params.dt:
                raise ValueError(f"{name} must be >= dt, got {getattr(params, name)} s")
        if params.dt <= 0.0:
            raise ValueError(f"dt must be > 0 s, got {params.dt}")
        super().__init__(RobustFvParams(*map(float, params)))

    def initial_state(self) -> RobustFvState:
        return RobustFvState()
