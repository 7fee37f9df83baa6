"""Input vectors p of the neural compensators, shifted by one sample a step; samples before the
start are 0.

14 inputs (Fig. 5.12): e_fn(t), e_fn(t-1), e_fn(t-2), e_fn(t) - e_fn(t-1), f_nd(t..t-4),
f_n(t..t-4), all in N. 5 inputs (Fig. 5.21): e_fn(t), e_fn(t-1), e_fn(t-2) in N, u_z(t-1), u_z(t-2)
in V, u_z the total clipped command.
"""

import numpy as np
from numba.extending import register_jitable


@register_jitable
def shift_in(p: np.ndarray, first: int, last: int, value: float) -> None:
    """Move p[first..last] on by one and put value at first."""
    for i in range(last, first, -1):
        p[i] = p[i - 1]
    p[first] = value


@register_jitable
def force_inputs(p: np.ndarray, f_nd: float, f_n: float) -> None:
    """Take in the forces at t; p has 14 or 5 entries."""
    shift_in(p, 0, 2, f_nd - f_n)
    if p.shape[0] == 14:
        p[3] = p[0] - p[1]
        shift_in(p, 4, 8, f_nd)
        shift_in(p, 9, 13, f_n)


@register_jitable
def command_input(p: np.ndarray, u_z: float) -> None:
    """Take in the command of this sample: it is u_z(t-1) at the next."""
    if p.shape[0] == 5:
        shift_in(p, 3, 4, u_z)


def checked_inputs(n_i: int) -> int:
    """Raises ValueError for another number than 14 or 5."""
    if n_i not in (14, 5):
        raise ValueError(f"n_i must be 14 (Fig. 5.12) or 5 (Fig. 5.21), got {n_i}")
    return n_i
