"""Force/velocity controller with lag inversion and friction observer: built on the plant model,
beyond the thesis.

In the task frame: f_dn = f_nd + k_p e_fn + I_n - d v_n asks for a normal force, f_dt = k_v e_vt +
I_t for a tangential one; turned into the axes f_dx = f_dt cos - f_dn sin + phi_x, f_dz = f_dt sin +
f_dn cos + phi_z. v_n = -v_x sin + v_z cos is 0 while the edge is followed, so that d damps the
contact's resonance and nothing else.

Lag inversion: tau f' + f = K (u - u_0) (Eq. 4-5) is driven by u = u_0 + (f_d + k_f (f_d - f_a)) / K
with the measured f_a; the closed valve lags by tau / (1 + k_f) with steady gain 1, whatever K and
tau are precisely.

Friction observer, per axis: what the balance f_a - f_c = phi + m a (Eq. 4-1) leaves, phi = Coulomb
+ viscous friction and cable force, as phi' = (f_a - f_c - m a - phi) / T. With s = phi + m v / T it
needs no derivative of v.
"""

import math
from typing import NamedTuple

from numba.extending import register_jitable

from controllers.dfv import barred_error
from controllers.interface import Command, Controller, Reference, Sense, clip_command
from controllers.pi import barred_side
from controllers.pi_fv import DT
from controllers.task_frame import task_frame
from controllers.valve import K_X, K_Z, U_0X, U_0Z

M_X, M_Z = 7.3, 2.25  # kg, §4.1.1


class ObserverFvParams(NamedTuple):
    """Defaults: tuned on an edge and on plants that no table scores (docs/results/thesis.md)."""

    k_p: float = 1.0  # share of the force error that is added
    k_i: float = 5.0  # 1/s
    damping: float = 300.0  # N s/m, on v_n
    k_v: float = 120.0  # N s/m, on e_vt
    k_vi: float = 900.0  # N/m
    k_f: float = 50.0  # feedback of the valves' force error
    t_x: float = 0.15  # s, observer's time constant
    t_z: float = 0.01  # s
    phi_max: float = 40.0  # N, limit of the observed friction
    dt: float = DT  # s


class ObserverFvState(NamedTuple):
    i_n: float = 0.0  # N
    i_t: float = 0.0  # N
    s_x: float = 0.0  # N, phi + m v / T
    s_z: float = 0.0  # N


@register_jitable
def observed(s: float, m: float, v: float, t: float, limit: float) -> float:
    """phi [N] from the observer's state, within the limit."""
    return min(max(s - m * v / t, -limit), limit)


@register_jitable
def observer_next(s: float, m: float, v: float, net: float, t: float, dt: float) -> float:
    """s after dt of net = f_a - f_c [N]."""
    return s + dt / t * (net - (s - m * v / t))


@register_jitable
def integral_next(
    integral: float, error: float, rate: float, along: tuple[float, float], bars: tuple[int, int]
) -> float:
    """Integral [N] with rate times the error added, unless that drives a clipped axis further out;
    along: its share on x and z.
    """
    if barred_error(error, along[0], along[1], bars[0], bars[1]) != 0:
        return integral
    return integral + rate * error


@register_jitable
def observer_fv_kernel(
    params: ObserverFvParams, state: ObserverFvState, reference: Reference, sense: Sense
) -> tuple[ObserverFvState, Command]:
    frame = task_frame(sense)
    e_fn, e_vt = reference.f_nd - frame.f_n, reference.v_td - frame.v_t
    v_n = -sense.v_x * frame.sin + sense.v_z * frame.cos
    f_n = reference.f_nd + params.k_p * e_fn + state.i_n - params.damping * v_n
    f_t = params.k_v * e_vt + state.i_t
    f_x = (
        f_t * frame.cos
        - f_n * frame.sin
        + observed(state.s_x, M_X, sense.v_x, params.t_x, params.phi_max)
    )
    f_z = (
        f_t * frame.sin
        + f_n * frame.cos
        + observed(state.s_z, M_Z, sense.v_z, params.t_z, params.phi_max)
    )
    u_x = U_0X - (f_x + params.k_f * (f_x - sense.f_ax)) / K_X
    u_z = U_0Z + (f_z + params.k_f * (f_z - sense.f_az)) / K_Z
    bars = (barred_side(u_x, -1), barred_side(u_z, 1))
    moved = ObserverFvState(
        integral_next(state.i_n, e_fn, params.k_i * params.dt, (-frame.sin, frame.cos), bars),
        integral_next(state.i_t, e_vt, params.k_vi * params.dt, (frame.cos, frame.sin), bars),
        observer_next(state.s_x, M_X, sense.v_x, sense.f_ax - sense.f_x, params.t_x, params.dt),
        observer_next(state.s_z, M_Z, sense.v_z, sense.f_az - sense.f_z, params.t_z, params.dt),
    )
    return moved, Command(clip_command(u_x), clip_command(u_z))


class ObserverFv(Controller[ObserverFvParams, ObserverFvState]):
    """Lag inversion and friction observer; options are the fields of ``ObserverFvParams``."""

    kernel = staticmethod(observer_fv_kernel)

    def __init__(self, **options: float) -> None:
        known = ObserverFvParams._fields
        unknown = [name for name in options if name not in known]
        if unknown:
            raise ValueError(f"unknown option {unknown[0]!r}; known are {', '.join(known)}")
        params = ObserverFvParams(**options)
        for name, value in zip(known, params, strict=True):
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name} must be finite and >= 0, got {value}")
        for name in ("t_x", "t_z", "dt"):
            if getattr(params, name) <= 0.0:
                raise ValueError(f"{name} must be > 0 s, got {getattr(params, name)}")
        super().__init__(ObserverFvParams(*map(float, params)))

    def initial_state(self) -> ObserverFvState:
        return ObserverFvState()
