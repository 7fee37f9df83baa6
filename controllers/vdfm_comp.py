"""PI FV with VDFM based friction compensator (Fig. 3.11, Eq. 3-18 to 3-21).

a_x = (F_x + C_x v_x) / K_x and a_z = (F_z + C_z v_z) / K_z [V] are added to c_x, c_z of PI FV.
Within the stick band the driving force is f_a, as printed, or the net force f_a - f_c - F_w that
the friction really holds (``net=True``).
"""

from typing import NamedTuple, Unpack

from numba.extending import register_jitable

from controllers.interface import Command, Controller, Reference, Sense
from controllers.pi_fv import PiFvOptions, PiFvParams, PiFvState, fv_errors, pi_fv_law, pi_fv_params
from controllers.task_frame import task_frame
from controllers.valve import K_X, K_Z
from controllers.vdfm import VDFM_X, VDFM_Z, VdfmParams, vdfm_checked, vdfm_coulomb

F_W = 5.0  # N, cable force of the position transducer, towards -axis


class VdfmCompParams(NamedTuple):
    fv: PiFvParams
    x: VdfmParams
    z: VdfmParams
    net: bool  # the stick band is driven by the net force
    f_w: float  # N, cable force, used with net
    k_x: float  # N/V
    k_z: float  # N/V


@register_jitable
def vdfm_volts(params: VdfmCompParams, sense: Sense) -> tuple[float, float]:
    """a_x, a_z [V] (Eq. 3-20, 3-21)."""
    drive_x, drive_z = sense.f_ax, sense.f_az
    if params.net:
        drive_x -= sense.f_x + params.f_w
        drive_z -= sense.f_z + params.f_w
    force_x = vdfm_coulomb(params.x, sense.v_x, drive_x) + params.x.c * sense.v_x
    force_z = vdfm_coulomb(params.z, sense.v_z, drive_z) + params.z.c * sense.v_z
    return force_x / params.k_x, force_z / params.k_z


@register_jitable
def vdfm_comp_kernel(
    params: VdfmCompParams, state: PiFvState, reference: Reference, sense: Sense
) -> tuple[PiFvState, Command]:
    a_x, a_z = vdfm_volts(params, sense)
    return pi_fv_law(params.fv, state, fv_errors(reference, task_frame(sense)), a_x, a_z)


class VdfmComp(Controller[VdfmCompParams, PiFvState]):
    """PI FV with VDFM on both axes (§3.7)."""

    kernel = staticmethod(vdfm_comp_kernel)

    def __init__(
        self,
        x: VdfmParams = VDFM_X,
        z: VdfmParams = VDFM_Z,
        net: bool = False,
        f_w: float = F_W,
        **fv: Unpack[PiFvOptions],
    ) -> None:
        x, z = vdfm_checked(x, "x"), vdfm_checked(z, "z")
        super().__init__(VdfmCompParams(pi_fv_params(**fv), x, z, bool(net), float(f_w), K_X, K_Z))

    def initial_state(self) -> PiFvState:
        return PiFvState()
