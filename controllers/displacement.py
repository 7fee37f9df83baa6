"""Displacement since the last reversal, from a speed signal.

A reversal counts once the axis has come back by ``dead`` from its farthest point, so that noise of
the speed is none.
"""

from typing import NamedTuple

from numba.extending import register_jitable


class Displacement(NamedTuple):
    travelled: float = 0.0  # m, farthest distance from the last reversal
    back: float = 0.0  # m, distance come back from there, >= 0
    direction: float = 1.0  # +1 or -1


@register_jitable
def displacement_step(at: Displacement, travel: float, dead: float) -> Displacement:
    """After a further travel [m]; dead [m] is the distance that makes a reversal."""
    onward = at.direction * travel - at.back
    if onward >= 0.0:
        return Displacement(at.travelled + onward, 0.0, at.direction)
    if -onward > dead:
        return Displacement(-onward, 0.0, -at.direction)
    return Displacement(at.travelled, -onward, at.direction)
