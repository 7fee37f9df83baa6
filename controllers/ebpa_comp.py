"""PI FV with EBPA neural compensator on z (Fig. 5.11, 5.12; Table 5.3).

u_NN [V] is added to c_z. While the z command is at a limit the network learns only from errors that
bring it back.
"""

from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable

from controllers.ebpa import EbpaParams, EbpaState, EbpaWeights, ebpa_learn, ebpa_output
from controllers.interface import Command, Controller, Reference, Sense
from controllers.learning import learns
from controllers.nn_inputs import checked_inputs, command_input, force_inputs
from controllers.pi_fv import PiFvOptions, PiFvParams, PiFvState, fv_errors, pi_fv_law, pi_fv_params
from controllers.sigmoid import limited
from controllers.task_frame import task_frame


class EbpaCompParams(NamedTuple):
    fv: PiFvParams
    nn: EbpaParams
    n_i: int  # inputs, 14 or 5
    u_max: float  # V, limit of |u_NN|; Fig. D.2 has a saturation without a number


class EbpaCompState(NamedTuple):
    fv: PiFvState
    nn: EbpaState
    p: np.ndarray  # (n_i,) inputs


@register_jitable
def ebpa_comp_kernel(
    params: EbpaCompParams, state: EbpaCompState, reference: Reference, sense: Sense
) -> tuple[EbpaCompState, Command]:
    frame = task_frame(sense)
    e = reference.f_nd - frame.f_n
    force_inputs(state.p, reference.f_nd, frame.f_n)
    u = limited(ebpa_output(params.nn, state.nn, state.p), params.u_max)
    fv, command = pi_fv_law(params.fv, state.fv, fv_errors(reference, frame), 0.0, u)
    if learns(command.u_z, e):
        ebpa_learn(params.nn, state.nn, state.p, e)
    command_input(state.p, command.u_z)
    return EbpaCompState(fv, state.nn, state.p), command


def ebpa_params(**options: Any) -> EbpaParams:
    """Raises ValueError for n_h < 1, a negative rate, alpha outside 0..1, U <= Q and a slope or
    limit <= 0.
    """
    params = EbpaParams(**options)
    if params.n_h < 1:
        raise ValueError(f"n_h must be >= 1, got {params.n_h}")
    for name in ("h_1", "h_2", "h_3"):
        if not getattr(params, name) >= 0.0:
            raise ValueError(f"{name} must be >= 0, got {getattr(params, name)}")
    if not 0.0 <= params.alpha < 1.0:
        raise ValueError(f"alpha must be within 0..1, got {params.alpha}")
    if not params.upper > params.lower:
        raise ValueError(f"upper must be > lower, got {params.upper} and {params.lower}")
    for name in ("slope", "limit"):
        if not getattr(params, name) > 0.0:
            raise ValueError(f"{name} must be > 0, got {getattr(params, name)}")
    return EbpaParams(int(params.n_h), *map(float, params[1:]))


def ebpa_state(params: EbpaParams, n_i: int) -> EbpaState:
    n_h = params.n_h
    at = EbpaWeights(
        np.full((n_h, n_i), params.weight),
        np.full(n_h, params.weight),
        np.full(n_h + 1, params.upper),
        np.full(n_h + 1, params.lower),
        np.full(n_h + 1, params.slope),
    )
    return EbpaState(
        at,
        EbpaWeights(*(np.zeros_like(array) for array in at)),
        np.zeros(n_h + 1),
        np.zeros(n_h + 1),
    )


class EbpaComp(Controller[EbpaCompParams, EbpaCompState]):
    """PI FV with EBPA network; further options are those of ``PiFvOptions`` and ``EbpaParams``."""

    kernel = staticmethod(ebpa_comp_kernel)

    def __init__(self, n_i: int = 14, u_max: float = 5.0, **options: Any) -> None:
        if not u_max > 0.0:
            raise ValueError(f"u_max must be > 0 V, got {u_max}")
        fv = {name: options.pop(name) for name in PiFvOptions.__annotations__ if name in options}
        nn = ebpa_params(**options)
        super().__init__(EbpaCompParams(pi_fv_params(**fv), nn, checked_inputs(n_i), float(u_max)))

    def initial_state(self) -> EbpaCompState:
        n_i = self.params.n_i
        return EbpaCompState(PiFvState(), ebpa_state(self.params.nn, n_i), np.zeros(n_i))
