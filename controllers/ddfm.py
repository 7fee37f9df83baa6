"""Displacement dependent friction model of Dahl (Eq. 4-8).

dF/ds = (gamma/delta) (F - beta sgn v)^2; with sigma = gamma beta^2 / delta the stiffness at F = 0,
F' = sigma v (1 - F/beta sgn v)^2, |F| <= beta. F > 0 acts towards -axis.

Over a travel s of one direction the equation has a closed form, used here instead of the printed
rectangle rule, which leaves |F| <= beta at speed: with y = 1 - F/beta sgn s, y <- y / (1 + y sigma
|s| / beta).
"""

from typing import NamedTuple

from numba.extending import register_jitable


class DdfmParams(NamedTuple):
    beta: float  # N, limit force
    sigma: float  # N/m, stiffness at F = 0


DDFM_Z = DdfmParams(beta=12.0, sigma=1.0e5)  # read off Fig. 4.14 and 4.17
DDFM_X = DdfmParams(
    beta=11.0, sigma=9.2e4
)  # the thesis has none: F_dx as limit, reached over the same 0.12 mm


@register_jitable
def ddfm_step(params: DdfmParams, force: float, travel: float) -> float:
    """F [N] after a travel [m] that began at F = force."""
    if travel == 0.0:
        return force
    direction = 1.0 if travel > 0.0 else -1.0
    y = 1.0 - direction * force / params.beta
    y = y / (1.0 + y * params.sigma * direction * travel / params.beta)
    return direction * params.beta * (1.0 - y)


def ddfm_checked(params: DdfmParams, axis: str) -> DdfmParams:
    """Raises ValueError unless beta and sigma are > 0."""
    for name, value in zip(DdfmParams._fields, params, strict=True):
        if not value > 0.0:
            raise ValueError(f"{name} of axis {axis} must be > 0, got {value}")
    return DdfmParams(*map(float, params))
