"""Smith predictor on the z force loop (§5.3, Fig. 5.8).

Model of the loop (Fig. 5.7 with the lag of Eq. 4-5): tau f' + f = K_z (u_z - u_0z); m d" + (C_c +
C_z) d' + K_c d = f; f_z = C_c d' + K_c d. The PI law acts on the lag free part: e_fz <- e_fz - (f_z
without lag - f_z with lag). As the model is linear this difference is its response to the force
difference K_z (u_z - u_0z) - f: three states, advanced with the exact solution for a command held
over dt. The lagged force starts at the measured f_az.
"""

import math
from typing import NamedTuple, Unpack

import numpy as np
from numba.extending import register_jitable

from controllers.interface import Command, Controller, Reference, Sense
from controllers.pi_fv import (
    FvErrors,
    PiFvOptions,
    PiFvParams,
    PiFvState,
    fv_errors,
    pi_fv_law,
    pi_fv_params,
)
from controllers.task_frame import task_frame
from controllers.valve import K_Z, TAU_Z

Row = tuple[float, float, float, float]


class ForceLoop(NamedTuple):
    """Plant of the z force loop."""

    tau: float = TAU_Z  # s
    k: float = K_Z  # N/V
    m: float = 2.25  # kg
    c: float = 40.0  # N s/m, viscous friction
    k_c: float = 1.0e4  # N/m, contact stiffness
    c_c: float = 30.0  # N s/m, contact damping


FORCE_LOOP = ForceLoop()


class SmithParams(NamedTuple):
    fv: PiFvParams
    loop: ForceLoop
    force: Row  # next lagged force from (f, d, d', K_z (u_z - u_0z))
    position: Row  # next d
    speed: Row  # next d'


class SmithState(NamedTuple):
    fv: PiFvState
    force: float = 0.0  # N, lagged actuator force of the model
    position: float = 0.0  # m, d without lag less d with lag
    speed: float = 0.0  # m/s
    started: bool = False


def held_rows(loop: ForceLoop, dt: float) -> tuple[Row, Row, Row]:
    """Rows of the exact transition over dt of (f, d, d') and the held force K_z (u_z - u_0z)."""
    a = np.zeros((4, 4))
    a[0, 0], a[0, 3] = -1.0 / loop.tau, 1.0 / loop.tau
    a[1, 2] = 1.0
    a[2] = np.array([-1.0, -loop.k_c, -(loop.c_c + loop.c), 1.0]) / loop.m
    halvings = max(0, math.ceil(math.log2(float(np.abs(a).sum(axis=1).max()) * dt)) + 1)
    a *= dt / 2**halvings
    transition, term = np.eye(4), np.eye(4)
    for order in range(
        1, 20
    ):  # Taylor series of a matrix of norm <= 1/2: the remainder is below 1e-23
        term = term @ a / order
        transition += term
    for _ in range(halvings):
        transition = transition @ transition
    f, d, s = (tuple(row) for row in transition[:3].tolist())
    return f, d, s


@register_jitable
def row_times(row: Row, f: float, d: float, s: float, held: float) -> float:
    return row[0] * f + row[1] * d + row[2] * s + row[3] * held


@register_jitable
def smith_kernel(
    params: SmithParams, state: SmithState, reference: Reference, sense: Sense
) -> tuple[SmithState, Command]:
    e = fv_errors(reference, task_frame(sense))
    ahead = (
        params.loop.c_c * state.speed + params.loop.k_c * state.position
    )  # N, f_z without lag - f_z with lag
    fv, command = pi_fv_law(
        params.fv, state.fv, FvErrors(e.v_x, e.f_z - ahead, e.f_x, e.v_z), 0.0, 0.0
    )
    held = params.loop.k * (command.u_z - params.fv.u_0z)
    f, d, s = state.force, state.position, state.speed
    if not state.started:
        f = sense.f_az
    moved = SmithState(
        fv,
        row_times(params.force, f, d, s, held),
        row_times(params.position, f, d, s, held),
        row_times(params.speed, f, d, s, held),
        True,
    )
    return moved, command


class Smith(Controller[SmithParams, SmithState]):
    """PI FV with a Smith predictor on the z force loop."""

    kernel = staticmethod(smith_kernel)

    def __init__(self, loop: ForceLoop = FORCE_LOOP, **fv: Unpack[PiFvOptions]) -> None:
        for name, value in zip(ForceLoop._fields, loop, strict=True):
            if not value > 0.0:
                raise ValueError(f"{name} must be > 0, got {value}")
        base = pi_fv_params(**fv)
        loop = ForceLoop(*map(float, loop))
        super().__init__(SmithParams(base, loop, *held_rows(loop, base.dt)))

    def initial_state(self) -> SmithState:
        return SmithState(PiFvState())
