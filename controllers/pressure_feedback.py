"""PI FV over an inner force loop on the measured actuator force: the flow valve variant (§6.2).

c_x, c_z of PI FV ask for the actuator forces f_axd = K_x c_x, f_azd = K_z c_z [N]; the inner loop
commands u_z = u_0z + k_ff c_z + k_f (f_azd - f_az) / K_z and u_x = u_0x - (k_ff c_x + k_f (f_axd -
f_ax) / K_x).

The thesis recommends flow control valves with the air pressure fed back and gives no law. On a
pressure valve (tau f' + f = K (u - u_0)) with k_ff = 1 the loop closes at tau / (1 + k_f) with
steady gain 1; a flow valve, whose force integrates the command, needs no feedforward: k_ff = 0.
"""

from typing import NamedTuple, Unpack

from numba.extending import register_jitable

from controllers.interface import Command, Controller, Reference, Sense
from controllers.pi import pi_output
from controllers.pi_fv import PiFvOptions, PiFvParams, PiFvState, fv_errors, pi_fv_law, pi_fv_params
from controllers.task_frame import task_frame
from controllers.valve import K_X, K_Z


class PressureFeedbackParams(NamedTuple):
    fv: PiFvParams
    k_f: float  # share of the force error that is commanded on top, V per V
    k_ff: float  # feedforward of the wanted force, 1 with a pressure valve, 0 with a flow valve
    k_x: float  # N/V
    k_z: float  # N/V


@register_jitable
def pressure_feedback_kernel(
    params: PressureFeedbackParams, state: PiFvState, reference: Reference, sense: Sense
) -> tuple[PiFvState, Command]:
    e, gains = fv_errors(reference, task_frame(sense)), params.fv.gains
    c_x = pi_output(gains.v_x, state.i_vx, e.v_x) + pi_output(gains.f_x, state.i_fx, e.f_x)
    c_z = pi_output(gains.f_z, state.i_fz, e.f_z) + pi_output(gains.v_z, state.i_vz, e.v_z)
    a_x = (params.k_ff - 1.0) * c_x + params.k_f * (c_x - sense.f_ax / params.k_x)
    a_z = (params.k_ff - 1.0) * c_z + params.k_f * (c_z - sense.f_az / params.k_z)
    return pi_fv_law(params.fv, state, e, a_x, a_z)


class PressureFeedback(Controller[PressureFeedbackParams, PiFvState]):
    """PI FV over an inner loop on f_a."""

    kernel = staticmethod(pressure_feedback_kernel)

    def __init__(self, k_f: float = 9.0, k_ff: float = 1.0, **fv: Unpack[PiFvOptions]) -> None:
        for name, value in (("k_f", k_f), ("k_ff", k_ff)):
            if not value >= 0.0:
                raise ValueError(f"{name} must be >= 0, got {value}")
        super().__init__(
            PressureFeedbackParams(pi_fv_params(**fv), float(k_f), float(k_ff), K_X, K_Z)
        )

    def initial_state(self) -> PiFvState:
        return PiFvState()
