"""PI FV that is told a wrong edge angle (§4.3.3, Fig. 4.31): the hook of a study, not for a rig.

theta of Eq. 3-7 is off by ``error``; Eq. 3-8 to 3-15 follow with the wrong angle, so that f_n is
read as f_n cos(error).
"""

import math
from typing import NamedTuple, Unpack

from numba.extending import register_jitable

from controllers.interface import Command, Controller, Reference, Sense
from controllers.pi_fv import PiFvOptions, PiFvParams, PiFvState, fv_errors, pi_fv_law, pi_fv_params
from controllers.task_frame import TaskFrame, edge_angle


class WrongAngleParams(NamedTuple):
    fv: PiFvParams
    error: float  # rad, added to theta


@register_jitable
def wrong_angle_kernel(
    params: WrongAngleParams, state: PiFvState, reference: Reference, sense: Sense
) -> tuple[PiFvState, Command]:
    theta = edge_angle(sense.f_x, sense.f_z) + params.error
    s, c = math.sin(theta), math.cos(theta)
    frame = TaskFrame(theta, s, c, -sense.f_x * s + sense.f_z * c, sense.v_x * c + sense.v_z * s)
    return pi_fv_law(params.fv, state, fv_errors(reference, frame), 0.0, 0.0)


class WrongAngle(Controller[WrongAngleParams, PiFvState]):
    """PI FV with an error [rad] in theta."""

    kernel = staticmethod(wrong_angle_kernel)

    def __init__(self, error: float, **fv: Unpack[PiFvOptions]) -> None:
        if not math.isfinite(error):
            raise ValueError(f"error must be finite, got {error}")
        super().__init__(WrongAngleParams(pi_fv_params(**fv), float(error)))

    def initial_state(self) -> PiFvState:
        return PiFvState()
