"""Neural network with the modified back propagation method (Eq. 5-1 to 5-3, 5-18 to 5-22, Table
5.4).

net_i = sum_j V_ij p_j + b, sigma_i = logistic(s net_i), net_3 = sum_i W_i sigma_i + b, u =
sigma_3(net_3) + D (5-20), D = k_z (|G| + G_max) e + k_v e (5-21), |G|^2 = sum V^2 + sum W^2 (5-22),
V_ij += dt (H_1 p_j W_i sigma_i' sigma_3' e - lambda H_1 V_ij |e|) (5-18), W_i += dt (H_2 sigma_i
sigma_3' e - H_2 sigma_i' (sum_j V_ij p_j) sigma_3' e - lambda H_2 W_i |e|) (5-19).

Departures from the print, each with its reason:
- D carries the sign of e: with the printed minus and k_v = 0.1 V/N the force loop has a positive
feedback five times
  its K_p (measured: f_n runs away); Lewis et al. add the term along the error.
- H_1, H_2 act per second, not per sample: Fig. D.3 integrates the updates with K Ts / (z - 1). Per
sample, H = 0.4
  makes an integral gain of some 1e2 V/(N s) where the loop bears 2.
- the error modification uses |e| (the printed |e| e would grow the weights where e < 0); Fig. D.3:
lambda n(z) W.
Silent: G_max (0 here). ``linear=True`` drops sigma_3, as Fig. D.3 draws it.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable

from controllers.sigmoid import limited, logistic


class MbpmParams(NamedTuple):
    n_h: int = 20  # nodes of the hidden layer
    h_1: float = 0.4  # 1/s, learning rate of V
    h_2: float = 0.4  # 1/s, learning rate of W
    lam: float = 0.1  # adaptation parameter lambda
    slope: float = 1.0
    bias: float = 1.0  # of both layers
    k_z: float = 0.01  # V/N
    k_v: float = 0.1  # V/N
    g_max: float = 0.0  # largest expected |G|
    weight: float = 0.0  # initial V and W
    limit: float = 1e37  # of V and W
    linear: bool = False  # output node without activation function


class MbpmState(NamedTuple):
    v: np.ndarray  # (n_h, n_i)
    w: np.ndarray  # (n_h,)
    vp: np.ndarray  # (n_h,) sum_j V_ij p_j of this sample
    sigma: np.ndarray  # (n_h,) outputs of the hidden layer of this sample


@register_jitable
def mbpm_output(
    params: MbpmParams, state: MbpmState, p: np.ndarray, e: float
) -> tuple[float, float]:
    """u_NN [V] and sigma_3'; leaves vp and sigma for ``mbpm_learn``."""
    v, w, vps, sigmas = state
    n_h, n_i = params.n_h, p.shape[0]
    net, norm = params.bias, 0.0
    for i in range(n_h):
        vp = 0.0
        for j in range(n_i):
            vp += v[i, j] * p[j]
            norm += v[i, j] * v[i, j]
        vps[i] = vp
        sigmas[i] = logistic(params.slope * (vp + params.bias))
        net += w[i] * sigmas[i]
        norm += w[i] * w[i]
    d = params.k_z * (math.sqrt(norm) + params.g_max) * e + params.k_v * e
    if params.linear:
        return net - params.bias + d, 1.0
    y = logistic(params.slope * net)
    return y + d, params.slope * y * (1.0 - y)


@register_jitable
def mbpm_learn(
    params: MbpmParams, state: MbpmState, p: np.ndarray, e: float, step: tuple[float, float]
) -> None:
    """Update V and W in place; step: sigma_3' of this sample and dt [s]."""
    slope_3, dt = step
    v, w, vps, sigmas = state
    n_h, n_i = params.n_h, p.shape[0]
    fade = params.lam * abs(e)
    for i in range(n_h):
        sigma = sigmas[i]
        slope_2 = params.slope * sigma * (1.0 - sigma)
        back = w[i] * slope_2 * slope_3 * e
        for j in range(n_i):
            v[i, j] = limited(
                v[i, j] + dt * params.h_1 * (p[j] * back - fade * v[i, j]), params.limit
            )
        ahead = (sigma - slope_2 * vps[i]) * slope_3 * e
        w[i] = limited(w[i] + dt * params.h_2 * (ahead - fade * w[i]), params.limit)


def mbpm_state(params: MbpmParams, n_i: int) -> MbpmState:
    n_h, weight = params.n_h, params.weight
    return MbpmState(
        np.full((n_h, n_i), weight), np.full(n_h, weight), np.zeros(n_h), np.zeros(n_h)
    )


def mbpm_params(**options: Any) -> MbpmParams:
    """Raises ValueError for n_h < 1, a negative rate or gain and a slope or limit <= 0."""
    params = MbpmParams(**options)
    if params.n_h < 1:
        raise ValueError(f"n_h must be >= 1, got {params.n_h}")
    for name in ("h_1", "h_2", "lam", "k_z", "k_v", "g_max"):
        if not getattr(params, name) >= 0.0:
            raise ValueError(f"{name} must be >= 0, got {getattr(params, name)}")
    for name in ("slope", "limit"):
        if not getattr(params, name) > 0.0:
            raise ValueError(f"{name} must be > 0, got {getattr(params, name)}")
    floats = {
        name: float(value)
        for name, value in params._asdict().items()
        if name not in ("n_h", "linear")
    }
    return MbpmParams(n_h=int(params.n_h), linear=bool(params.linear), **floats)
