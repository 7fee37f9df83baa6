"""PI law in the forward rectangle rule with conditional integration.

output: c = k_p e + I, with the integral before this sample's error is added; then I <- I + k_i dt
e.
"""

from numba.extending import register_jitable

from controllers.gains import PidGains
from controllers.interface import U_MAX, U_MIN


@register_jitable
def pi_output(gains: PidGains, integral: float, error: float) -> float:
    """c [V] from the integral [V] of the samples before and the error of this one."""
    return gains.k_p * error + integral


@register_jitable
def pi_integrate(gains: PidGains, integral: float, error: float, dt: float, barred: int) -> float:
    """Integral [V] with this sample's error added, unless it drives c further to the barred side.

    barred: +1 where c must not rise, -1 where it must not fall, 0 where it is free.
    """
    if barred * error > 0.0:
        return integral
    return integral + gains.k_i * dt * error


@register_jitable
def barred_side(u: float, valve: int) -> int:
    """Side of c that would drive an unclipped command u [V] further out of the limits.

    valve: du/dc, +1 on z and -1 on x.
    """
    if u > U_MAX:
        return valve
    if u < U_MIN:
        return -valve
    return 0
