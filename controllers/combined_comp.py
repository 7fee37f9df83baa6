"""PI FV with DDFM and VDFM based compensators on each axis, chosen by displacement (§5.2, §6.2).

The DDFM is active where the displacement since the last reversal is very small, the VDFM where it
is significant. The thesis gives no bounds: below ``small`` the DDFM alone acts, above ``large`` the
VDFM, between them a linear blend.
"""

from typing import NamedTuple, Unpack

from numba.extending import register_jitable

from controllers.ddfm import DDFM_X, DDFM_Z, DdfmParams, ddfm_checked, ddfm_step
from controllers.displacement import Displacement, displacement_step
from controllers.interface import Command, Controller, Reference, Sense
from controllers.pi_fv import PiFvOptions, PiFvParams, PiFvState, fv_errors, pi_fv_law, pi_fv_params
from controllers.task_frame import task_frame
from controllers.valve import K_X, K_Z
from controllers.vdfm import VDFM_X, VDFM_Z, VdfmParams, vdfm_checked, vdfm_coulomb


class AxisModel(NamedTuple):
    ddfm: DdfmParams
    vdfm: VdfmParams
    small: float  # m
    large: float  # m
    dead: float  # m, come back by this much, the axis has reversed


class AxisState(NamedTuple):
    force: float = 0.0  # N, friction of the DDFM
    displacement: Displacement = Displacement()


class CombinedParams(NamedTuple):
    fv: PiFvParams
    x: AxisModel
    z: AxisModel
    k_x: float  # N/V
    k_z: float  # N/V


class CombinedState(NamedTuple):
    fv: PiFvState
    x: AxisState
    z: AxisState


@register_jitable
def axis_friction(
    model: AxisModel, state: AxisState, v: float, f_a: float, dt: float
) -> tuple[AxisState, float]:
    """State after the sample and the friction with its viscous part [N]."""
    force = ddfm_step(model.ddfm, state.force, v * dt)
    displacement = displacement_step(state.displacement, v * dt, model.dead)
    share = (displacement.travelled - model.small) / (model.large - model.small)
    share = min(max(share, 0.0), 1.0)
    friction = (1.0 - share) * force + share * vdfm_coulomb(model.vdfm, v, f_a) + model.vdfm.c * v
    return AxisState(force, displacement), friction


@register_jitable
def combined_comp_kernel(
    params: CombinedParams, state: CombinedState, reference: Reference, sense: Sense
) -> tuple[CombinedState, Command]:
    x, friction_x = axis_friction(params.x, state.x, sense.v_x, sense.f_ax, params.fv.dt)
    z, friction_z = axis_friction(params.z, state.z, sense.v_z, sense.f_az, params.fv.dt)
    errors = fv_errors(reference, task_frame(sense))
    fv, command = pi_fv_law(
        params.fv, state.fv, errors, friction_x / params.k_x, friction_z / params.k_z
    )
    return CombinedState(fv, x, z), command


class CombinedComp(Controller[CombinedParams, CombinedState]):
    """PI FV with DDFM and VDFM on both axes (§6.2)."""

    kernel = staticmethod(combined_comp_kernel)

    def __init__(
        self,
        small: float = 5e-4,
        large: float = 1e-3,
        dead: float = 5e-5,
        **fv: Unpack[PiFvOptions],
    ) -> None:
        if not 0.0 <= small < large:
            raise ValueError(
                f"small and large must be 0 <= small < large [m], got {small} and {large}"
            )
        if not dead >= 0.0:
            raise ValueError(f"dead must be >= 0 m, got {dead}")
        x = AxisModel(
            ddfm_checked(DDFM_X, "x"),
            vdfm_checked(VDFM_X, "x"),
            float(small),
            float(large),
            float(dead),
        )
        z = AxisModel(
            ddfm_checked(DDFM_Z, "z"),
            vdfm_checked(VDFM_Z, "z"),
            float(small),
            float(large),
            float(dead),
        )
        super().__init__(CombinedParams(pi_fv_params(**fv), x, z, K_X, K_Z))

    def initial_state(self) -> CombinedState:
        return CombinedState(PiFvState(), AxisState(), AxisState())
