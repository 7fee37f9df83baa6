"""PI FV with VDFM based compensator on x and DDFM based compensator on z (§5.2, Fig. 5.4; Eq. 3-18,
3-20, 4-8).

a_z = (F_z + C_z v_z) / K_z with F_z of Eq. 4-8 along the travel v_z dt; F_z starts at 0.
"""

from typing import NamedTuple, Unpack

from numba.extending import register_jitable

from controllers.ddfm import DDFM_Z, DdfmParams, ddfm_checked, ddfm_step
from controllers.interface import Command, Controller, Reference, Sense
from controllers.pi_fv import PiFvOptions, PiFvParams, PiFvState, fv_errors, pi_fv_law, pi_fv_params
from controllers.task_frame import task_frame
from controllers.valve import K_X, K_Z
from controllers.vdfm import VDFM_X, VDFM_Z, VdfmParams, vdfm_checked, vdfm_coulomb
from controllers.vdfm_comp import F_W


class DdfmCompParams(NamedTuple):
    fv: PiFvParams
    x: VdfmParams
    z: DdfmParams
    c_z: float  # N s/m, viscous coefficient
    net: bool  # the stick band of x is driven by the net force
    f_w: float  # N, cable force, used with net
    k_x: float  # N/V
    k_z: float  # N/V


class DdfmCompState(NamedTuple):
    fv: PiFvState
    force_z: float  # N, friction of the model


@register_jitable
def ddfm_comp_kernel(
    params: DdfmCompParams, state: DdfmCompState, reference: Reference, sense: Sense
) -> tuple[DdfmCompState, Command]:
    drive_x = sense.f_ax
    if params.net:
        drive_x -= sense.f_x + params.f_w
    a_x = (vdfm_coulomb(params.x, sense.v_x, drive_x) + params.x.c * sense.v_x) / params.k_x
    force_z = ddfm_step(params.z, state.force_z, sense.v_z * params.fv.dt)
    a_z = (force_z + params.c_z * sense.v_z) / params.k_z
    fv, command = pi_fv_law(params.fv, state.fv, fv_errors(reference, task_frame(sense)), a_x, a_z)
    return DdfmCompState(fv, force_z), command


class DdfmComp(Controller[DdfmCompParams, DdfmCompState]):
    """PI FV with VDFM on x and DDFM on z (§5.2)."""

    kernel = staticmethod(ddfm_comp_kernel)

    def __init__(
        self,
        x: VdfmParams = VDFM_X,
        z: DdfmParams = DDFM_Z,
        c_z: float = VDFM_Z.c,
        net: bool = False,
        f_w: float = F_W,
        **fv: Unpack[PiFvOptions],
    ) -> None:
        x, z = vdfm_checked(x, "x"), ddfm_checked(z, "z")
        super().__init__(
            DdfmCompParams(pi_fv_params(**fv), x, z, float(c_z), bool(net), float(f_w), K_X, K_Z)
        )

    def initial_state(self) -> DdfmCompState:
        return DdfmCompState(PiFvState(), 0.0)
