"""PID law: the PI law of ``pi`` with the derivative of the error as its backward difference, 0 at
the first sample.
"""

from typing import NamedTuple

from numba.extending import register_jitable

from controllers.gains import PidGains
from controllers.pi import pi_integrate, pi_output


class PidState(NamedTuple):
    integral: float = 0.0  # V
    error: float = 0.0  # of the sample before
    started: bool = False


@register_jitable
def pid_output(gains: PidGains, state: PidState, error: float, dt: float) -> float:
    """c [V] (Eq. 3-3 to 3-6)."""
    c = pi_output(gains, state.integral, error)
    if state.started:
        c += gains.k_d * (error - state.error) / dt
    return c


@register_jitable
def pid_next(gains: PidGains, state: PidState, error: float, dt: float, barred: int) -> PidState:
    """barred: side to which the integral must not drive c, as in ``pi_integrate``."""
    return PidState(pi_integrate(gains, state.integral, error, dt, barred), error, True)
