"""Velocity dependent friction model of a cylinder, as a compensator sees it (Eq. 3-18, 3-19).

Sliding, |v| > v_th: F = F_d sgn v. Within the band: F = sgn(f) min(|f|, F_s), f the driving force.
F > 0 acts towards -axis, as in f_a - f_c - C v - F = m a. As printed the two equations carry the
opposite sign (the force on the piston), yet Eq. 3-20 adds the viscous part with this one; and their
max(f_a, F_s) would exceed the break-away force: min is meant.
"""

from typing import NamedTuple

from numba.extending import register_jitable


class VdfmParams(NamedTuple):
    f_s: float  # N, static Coulomb friction
    f_d: float  # N, dynamic Coulomb friction
    c: float  # N s/m, viscous coefficient
    v_th: float = 0.01  # m/s, half width of the band


VDFM_X = VdfmParams(f_s=25.0, f_d=11.0, c=74.0)  # Table 3.13
VDFM_Z = VdfmParams(
    f_s=20.0, f_d=15.0, c=40.0
)  # Table 3.13; F_dz = 15 is the mean of its tests, printed 10


@register_jitable
def vdfm_coulomb(params: VdfmParams, v: float, drive: float) -> float:
    """Coulomb part F [N] at speed v [m/s]; drive [N] is the force that it holds within the band."""
    if v > params.v_th:
        return params.f_d
    if v < -params.v_th:
        return -params.f_d
    if drive > params.f_s:
        return params.f_s
    if drive < -params.f_s:
        return -params.f_s
    return drive


def vdfm_checked(params: VdfmParams, axis: str) -> VdfmParams:
    """Raises ValueError for a negative entry."""
    for name, value in zip(VdfmParams._fields, params, strict=True):
        if not value >= 0.0:
            raise ValueError(f"{name} of axis {axis} must be >= 0, got {value}")
    return VdfmParams(*map(float, params))
