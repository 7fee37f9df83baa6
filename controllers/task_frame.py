"""Task frame at the contact point, estimated from the contact force (Eq. 3-7 to 3-9).

Tangent (cos theta, sin theta), normal (-sin theta, cos theta). Eq. 3-7 as printed, theta =
atan2(f_x, f_z), contradicts Eq. 3-8 in sign: the contact force is f_n (-sin theta, cos theta),
hence theta = atan2(-f_x, f_z).
"""

import math
from typing import NamedTuple

from numba.extending import register_jitable

from controllers.interface import Sense

F_MIN = 2.0  # N, below this contact force the angle is taken as 0


class TaskFrame(NamedTuple):
    theta: float  # rad, slope angle of the edge
    sin: float
    cos: float
    f_n: float  # N, > 0 presses
    v_t: float  # m/s, > 0 moves along +x at theta = 0


@register_jitable
def edge_angle(f_x: float, f_z: float) -> float:
    """Slope angle theta [rad] of the edge from the contact force [N]; 0 below F_MIN."""
    if f_x * f_x + f_z * f_z < F_MIN * F_MIN:
        return 0.0
    return math.atan2(-f_x, f_z)


@register_jitable
def task_frame(sense: Sense) -> TaskFrame:
    theta = edge_angle(sense.f_x, sense.f_z)
    s, c = math.sin(theta), math.cos(theta)
    f_n = -sense.f_x * s + sense.f_z * c  # Eq. 3-8
    v_t = sense.v_x * c + sense.v_z * s  # Eq. 3-9
    return TaskFrame(theta, s, c, f_n, v_t)
