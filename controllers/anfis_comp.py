"""PI FV with VDFM on x and the ANFIS friction model on z (§4.2.4, Fig. 3.10, 4.19).

Inputs of the ANFIS: f_az, its change, f_n, z, its change, over ``PERIOD`` as in the training data;
z is the travel since the contact phase began, from the speed (the position's own noise of 0.1 mm
exceeds the presliding way). a_z = (F_z + C_z v_z) / K_z.
"""

from typing import NamedTuple, Unpack

import numpy as np
from numba.extending import register_jitable

from controllers.anfis import AnfisModel, anfis_output
from controllers.anfis_trained import trained_model
from controllers.interface import Command, Controller, Reference, Sense
from controllers.pi_fv import PiFvOptions, PiFvParams, PiFvState, fv_errors, pi_fv_law, pi_fv_params
from controllers.task_frame import task_frame
from controllers.valve import K_X, K_Z
from controllers.vdfm import VDFM_X, VDFM_Z, VdfmParams, vdfm_coulomb

PERIOD = 10  # samples over which the changes are taken, as in the training data


class AnfisCompParams(NamedTuple):
    fv: PiFvParams
    model: AnfisModel
    x: VdfmParams
    c_z: float  # N s/m
    f_max: float  # N, limit of the modelled friction


class AnfisCompState(NamedTuple):
    fv: PiFvState
    travel: float  # m, since the contact phase began
    past: np.ndarray  # (PERIOD, 2): f_az [N] and travel [m] of the last samples, a ring
    at: int  # place in the ring; < 0 before the first sample
    inputs: np.ndarray  # (5,)
    scaled: np.ndarray  # (5,) work space
    grade: np.ndarray  # (5, m) work space


@register_jitable
def anfis_comp_kernel(
    params: AnfisCompParams, state: AnfisCompState, reference: Reference, sense: Sense
) -> tuple[AnfisCompState, Command]:
    frame = task_frame(sense)
    past, inputs, at = state.past, state.inputs, state.at
    travel = state.travel + params.fv.dt * sense.v_z
    if at < 0:
        at = 0
        for k in range(PERIOD):
            past[k, 0], past[k, 1] = sense.f_az, travel
    inputs[0], inputs[1], inputs[2] = sense.f_az, sense.f_az - past[at, 0], frame.f_n
    inputs[3], inputs[4] = travel, travel - past[at, 1]
    past[at, 0], past[at, 1] = sense.f_az, travel
    force = anfis_output(params.model, inputs, state.scaled, state.grade)
    force = min(max(force, -params.f_max), params.f_max)
    a_z = (force + params.c_z * sense.v_z) / K_Z
    a_x = (vdfm_coulomb(params.x, sense.v_x, sense.f_ax) + params.x.c * sense.v_x) / K_X
    fv, command = pi_fv_law(params.fv, state.fv, fv_errors(reference, frame), a_x, a_z)
    return AnfisCompState(
        fv, travel, past, (at + 1) % PERIOD, inputs, state.scaled, state.grade
    ), command


class AnfisComp(Controller[AnfisCompParams, AnfisCompState]):
    """PI FV with VDFM on x and ANFIS on z."""

    kernel = staticmethod(anfis_comp_kernel)

    def __init__(
        self, model: AnfisModel | None = None, f_max: float = 25.0, **fv: Unpack[PiFvOptions]
    ) -> None:
        if not f_max > 0.0:
            raise ValueError(f"f_max must be > 0 N, got {f_max}")
        super().__init__(
            AnfisCompParams(
                pi_fv_params(**fv), model or trained_model(), VDFM_X, VDFM_Z.c, float(f_max)
            )
        )

    def initial_state(self) -> AnfisCompState:
        n, m = self.params.model.centre.shape
        return AnfisCompState(
            PiFvState(), 0.0, np.zeros((PERIOD, 2)), -1, np.zeros(n), np.zeros(n), np.zeros((n, m))
        )
