"""PI FV with MBPM neural compensator (Fig. 5.11; inputs Fig. 5.12 or 5.21; §6.2 for both axes).

u_NN [V] is added to c_z; with ``axes="both"`` it acts along the normal instead: a_z = u_NN cos
theta, a_x = -u_NN sin theta K_z / K_x, the thesis naming the idea only. While the z command is at a
limit the network learns only from errors that bring it back.
"""

from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable

from controllers.interface import Command, Controller, Reference, Sense
from controllers.learning import learns
from controllers.mbpm import MbpmParams, MbpmState, mbpm_learn, mbpm_output, mbpm_params, mbpm_state
from controllers.nn_inputs import checked_inputs, command_input, force_inputs
from controllers.pi_fv import PiFvOptions, PiFvParams, PiFvState, fv_errors, pi_fv_law, pi_fv_params
from controllers.sigmoid import limited
from controllers.task_frame import task_frame
from controllers.valve import K_X, K_Z


class MbpmCompParams(NamedTuple):
    fv: PiFvParams
    nn: MbpmParams
    n_i: int  # inputs, 14 or 5
    both: bool  # the output acts along the normal on both axes
    u_max: float  # V, limit of |u_NN|; Fig. D.2 has a saturation without a number
    k_zx: float  # K_z / K_x


class MbpmCompState(NamedTuple):
    fv: PiFvState
    nn: MbpmState
    p: np.ndarray  # (n_i,) inputs


@register_jitable
def mbpm_comp_kernel(
    params: MbpmCompParams, state: MbpmCompState, reference: Reference, sense: Sense
) -> tuple[MbpmCompState, Command]:
    frame = task_frame(sense)
    e = reference.f_nd - frame.f_n
    force_inputs(state.p, reference.f_nd, frame.f_n)
    u, slope_3 = mbpm_output(params.nn, state.nn, state.p, e)
    u = limited(u, params.u_max)
    a_x, a_z = 0.0, u
    if params.both:
        a_x, a_z = -u * frame.sin * params.k_zx, u * frame.cos
    fv, command = pi_fv_law(params.fv, state.fv, fv_errors(reference, frame), a_x, a_z)
    if learns(command.u_z, e):
        mbpm_learn(params.nn, state.nn, state.p, e, (slope_3, params.fv.dt))
    command_input(state.p, command.u_z)
    return MbpmCompState(fv, state.nn, state.p), command


class MbpmComp(Controller[MbpmCompParams, MbpmCompState]):
    """PI FV with MBPM network; further options are those of ``PiFvOptions`` and ``MbpmParams``."""

    kernel = staticmethod(mbpm_comp_kernel)

    def __init__(self, n_i: int = 14, axes: str = "z", u_max: float = 5.0, **options: Any) -> None:
        if axes not in ("z", "both"):
            raise ValueError(f"axes must be 'z' or 'both', got {axes!r}")
        if not u_max > 0.0:
            raise ValueError(f"u_max must be > 0 V, got {u_max}")
        fv = {name: options.pop(name) for name in PiFvOptions.__annotations__ if name in options}
        nn = mbpm_params(**options)
        n_i, both = checked_inputs(n_i), axes == "both"
        super().__init__(MbpmCompParams(pi_fv_params(**fv), nn, n_i, both, float(u_max), K_Z / K_X))

    def initial_state(self) -> MbpmCompState:
        n_i = self.params.n_i
        return MbpmCompState(PiFvState(), mbpm_state(self.params.nn, n_i), np.zeros(n_i))
