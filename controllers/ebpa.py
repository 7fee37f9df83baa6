"""Neural network with the extended back propagation algorithm (Eq. 5-2 to 5-17, Table 5.3).

sigma = (U - Q) y + Q with y = logistic(net / s) (5-4); net_i = sum_j V_ij p_j + b, u =
sigma_3(sum_i W_i sigma_i + b) (5-5). Each quantity moves by its update plus alpha times its last
one, once a sample: V_ij: H_1 p_j W_i sigma_i' sigma_3' e (5-6); W_i: H_2 sigma_i sigma_3' e (5-10);
U_i, Q_i, s_i of the hidden layer: H_3 W_i (d sigma_i/d.) (d sigma_3/d.) e (5-7 to 5-9, with the
derivative of the output node by its own U, Q or s as printed, not by net_3 as the chain rule has
it); U, Q, s of the output: H_3 (d sigma_3/d.) e (5-11 to 5-13). d sigma/d net = (U - Q) y (1 - y) /
s, which is Eq. 5-14 without its division by U - Q; d/dU = y, d/dQ = 1 - y, d/ds = -net/s d sigma/d
net (5-15 to 5-17).

Silent in the thesis: the initial U, Q, s (1, 0, 1: Eq. 5-1) and the biases (0 and constant; no
equation moves them). A slope is kept >= 0.05, so that no update divides by 0.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from controllers.sigmoid import limited, logistic

S_MIN = 0.05  # smallest slope


class EbpaParams(NamedTuple):
    n_h: int = 50  # nodes of the hidden layer
    h_1: float = 0.0006  # learning rate of V, per sample
    h_2: float = 0.0006  # learning rate of W
    h_3: float = 0.0006  # learning rate of the activation functions
    alpha: float = 0.0  # momentum
    weight: float = 0.1  # initial V and W; Table 5.5 has 0 and 0.1
    upper: float = 1.0  # initial U
    lower: float = 0.0  # initial Q
    slope: float = 1.0  # initial s
    bias: float = 0.0  # of both layers
    limit: float = 1e37  # of V, W, U, Q and s


class EbpaWeights(NamedTuple):
    v: np.ndarray  # (n_h, n_i)
    w: np.ndarray  # (n_h,)
    upper: np.ndarray  # (n_h + 1,) U of the hidden nodes, last that of the output
    lower: np.ndarray  # (n_h + 1,) Q
    slope: np.ndarray  # (n_h + 1,) s


class EbpaState(NamedTuple):
    at: EbpaWeights
    last: EbpaWeights  # updates of the sample before
    net: np.ndarray  # (n_h + 1,) of this sample, last that of the output
    y: np.ndarray  # (n_h + 1,) logistic(net / s) of this sample


@register_jitable
def net_derivative(spread: float, slope: float, y: float) -> float:
    """d sigma / d net (Eq. 5-14); spread: U - Q."""
    return spread * y * (1.0 - y) / slope


@register_jitable
def ebpa_output(params: EbpaParams, state: EbpaState, p: np.ndarray) -> float:
    """u_NN [V] (Eq. 5-2 to 5-5); leaves net and y for ``ebpa_learn``."""
    v, w, upper, lower, slope = state.at
    nets, ys = state.net, state.y
    n_h, n_i = params.n_h, p.shape[0]
    net_3 = params.bias
    for i in range(n_h):
        net = params.bias
        for j in range(n_i):
            net += v[i, j] * p[j]
        y = logistic(net / slope[i])
        nets[i], ys[i] = net, y
        net_3 += w[i] * ((upper[i] - lower[i]) * y + lower[i])
    y = logistic(net_3 / slope[n_h])
    nets[n_h], ys[n_h] = net_3, y
    return (upper[n_h] - lower[n_h]) * y + lower[n_h]


@register_jitable
def ebpa_learn(params: EbpaParams, state: EbpaState, p: np.ndarray, e: float) -> None:
    """Update all weights and activation functions in place from the error e [N] of this sample."""
    v, w, upper, lower, slope = state.at
    last_v, last_w, last_upper, last_lower, last_slope = state.last
    nets, ys = state.net, state.y
    n_h, n_i = params.n_h, p.shape[0]
    alpha, limit = params.alpha, params.limit
    y_3 = ys[n_h]
    slope_3 = net_derivative(upper[n_h] - lower[n_h], slope[n_h], y_3)
    d_s3 = -nets[n_h] / slope[n_h] * slope_3
    for i in range(n_h + 1):
        y, spread = ys[i], upper[i] - lower[i]
        d_net = net_derivative(spread, slope[i], y)
        d_s = -nets[i] / slope[i] * d_net
        by = params.h_3 * e
        by_u, by_q, by_s = by, by, by  # Eq. 5-11 to 5-13
        if i < n_h:
            back = params.h_1 * w[i] * d_net * slope_3 * e  # Eq. 5-6
            for j in range(n_i):
                last_v[i, j] = p[j] * back + alpha * last_v[i, j]
                v[i, j] = limited(v[i, j] + last_v[i, j], limit)
            by = by * w[i]
            by_u, by_q, by_s = by * y_3, by * (1.0 - y_3), by * d_s3  # Eq. 5-7 to 5-9
            last_w[i] = (
                params.h_2 * (spread * y + lower[i]) * slope_3 * e + alpha * last_w[i]
            )  # Eq. 5-10
            w[i] = limited(w[i] + last_w[i], limit)
        last_upper[i] = by_u * y + alpha * last_upper[i]
        last_lower[i] = by_q * (1.0 - y) + alpha * last_lower[i]
        last_slope[i] = by_s * d_s + alpha * last_slope[i]
        upper[i] = limited(upper[i] + last_upper[i], limit)
        lower[i] = limited(lower[i] + last_lower[i], limit)
        slope[i] = max(limited(slope[i] + last_slope[i], limit), S_MIN)
