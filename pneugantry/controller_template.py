"""A controller of one's own: force on z by PI, speed on x by PI, for edges that are nearly level.

Parameters and state are NamedTuples; `step` is a pure function of them. It runs as Python and in
the compiled loop with the same bits, so keep to arithmetic, `math.*` and plain loops.
"""

from typing import NamedTuple

from numba.extending import register_jitable

from controllers.interface import Command, Controller, Reference, Sense, clip_command

DT = 1e-3  # s, a sample


class Gains(NamedTuple):
    """`--gains kp_f=0.02` changes one of them."""

    kp_f: float = 0.01  # V/N
    ki_f: float = 0.05  # V/(N s)
    kp_v: float = 1.0  # V s/m
    ki_v: float = 4.0  # V/m
    u_0x: float = 0.635  # V, at which the x valve begins to push
    u_0z: float = 0.735  # V, at which the z valve does


class Integrals(NamedTuple):
    force: float = 0.0  # V
    speed: float = 0.0  # V


@register_jitable
def step(
    params: Gains, state: Integrals, reference: Reference, sense: Sense
) -> tuple[Integrals, Command]:
    """Commands at t_k [V], and the integrals at t_k + 1 ms."""
    e_f = reference.f_nd - sense.f_z  # N, > 0: press harder
    e_v = reference.v_td - sense.v_x  # m/s, < 0: move faster towards -x
    u_z = params.u_0z + params.kp_f * e_f + state.force
    u_x = params.u_0x - params.kp_v * e_v - state.speed  # the x valve pushes towards -x
    force = state.force + params.ki_f * e_f * DT if 0.0 < u_z < 5.0 else state.force
    speed = state.speed + params.ki_v * e_v * DT if 0.0 < u_x < 5.0 else state.speed
    return Integrals(force, speed), Command(clip_command(u_x), clip_command(u_z))


class MyController(Controller[Gains, Integrals]):
    kernel = staticmethod(step)

    def __init__(self, gains: dict[str, float] | None = None) -> None:
        super().__init__(Gains(**(gains or {})))

    def initial_state(self) -> Integrals:
        return Integrals()
