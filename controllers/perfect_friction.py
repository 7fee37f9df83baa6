"""PI FV with a perfect friction compensator (§5.2, Fig. 5.5): the hook of a study, not for a rig.

The loop tells the true friction of the plant at t_k in ``SenseWithFriction``; a_x = (F_x + C_x v_x)
/ K_x and a_z = (F_z + C_z v_z) / K_z are added to c_x, c_z. Every other kernel takes a
``SenseWithFriction`` too.
"""

from typing import NamedTuple, Unpack

from numba.extending import register_jitable

from controllers.interface import Command, Controller, Reference
from controllers.pi_fv import PiFvOptions, PiFvParams, PiFvState, fv_errors, pi_fv_law, pi_fv_params
from controllers.task_frame import task_frame
from controllers.valve import K_X, K_Z
from controllers.vdfm import VDFM_X, VDFM_Z


class SenseWithFriction(NamedTuple):
    """``Sense`` and the plant's own Coulomb friction."""

    x: float  # m
    z: float  # m
    v_x: float  # m/s
    v_z: float  # m/s
    f_x: float  # N
    f_z: float  # N
    f_ax: float  # N
    f_az: float  # N
    friction_x: float  # N, F of f_a - f_c - C v - F - F_w = m a
    friction_z: float  # N


class PerfectFrictionParams(NamedTuple):
    fv: PiFvParams
    c_x: float  # N s/m
    c_z: float  # N s/m
    k_x: float  # N/V
    k_z: float  # N/V


@register_jitable
def perfect_friction_kernel(
    params: PerfectFrictionParams, state: PiFvState, reference: Reference, sense: SenseWithFriction
) -> tuple[PiFvState, Command]:
    a_x = (sense.friction_x + params.c_x * sense.v_x) / params.k_x
    a_z = (sense.friction_z + params.c_z * sense.v_z) / params.k_z
    frame = task_frame(sense)  # type: ignore[arg-type]  # has every field of Sense
    return pi_fv_law(params.fv, state, fv_errors(reference, frame), a_x, a_z)


class PerfectFriction(Controller[PerfectFrictionParams, PiFvState]):
    """PI FV told the plant's friction; step takes ``SenseWithFriction``."""

    kernel = staticmethod(perfect_friction_kernel)

    def __init__(
        self, c_x: float = VDFM_X.c, c_z: float = VDFM_Z.c, **fv: Unpack[PiFvOptions]
    ) -> None:
        super().__init__(
            PerfectFrictionParams(pi_fv_params(**fv), float(c_x), float(c_z), K_X, K_Z)
        )

    def initial_state(self) -> PiFvState:
        return PiFvState()
