"""Neural network with the extended back propagation algorithm (Eq. 5-2 to 5-17, Table 5.3).

sigma = (U - Q) y + Q with y = logistic(net / s) (5-4); net_i = sum_j V_ij p_j + b, u = sigma_3(sum_i W_i sigma_i + b)
(5-5). Each quantity moves by its update plus alpha times its last one, once a sample:
V_ij: H_1 p_j W_i sigma_i' sigma_3' e (5-6); W_i: H_2 sigma_i sigma_3' e (5-10);
U_i, Q_i, s_i of the hidden layer: H_3 W_i (d sigma_i/d.) (d sigma_3/d.) e (5-7 to 5-9, with the derivative of the output
node by its own U, Q or s as printed, not by net_3 as the chain rule has it); U, Q, s of the output: H_3 (d sigma_3/d.) e
(5-11 to 5-13). d sigma/d net = (U - Q) y (1 - y) / s, which is Eq. 5-14 without its division by U - Q;
d/dU = y, d/dQ = 1 - y, d/ds = -net/s d sigma/d net (5-15 to 5-17).

Silent in the thesis: the initial U, Q, s (1, 0, 1: Eq. 5-1) and the biases (0 and constant; no equation moves them).
A slope is kept >= 0.05, so that no update divides by 0.
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
def node(state: EbpaState, i: int, net: float) -> float:
    """Output sigma of node i; leaves net and y for ``ebpa_learn``."""
    at = state.at
    y = logistic(net / at.slope[i])
    state.net[i] = net
    state.y[i] = y
    return (at.upper[i] - at.lower[i]) * y + at.lower[i]


@register_jitable
def ebpa_output(params: EbpaParams, state: EbpaState, p: np.ndarray) -> float:
    """u_NN [V] (Eq. 5-2 to 5-5)."""
    n_h, n_i = state.at.v.shape
    net_3 = params.bias
    for i in range(n_h):
        net = params.bias
        for j in range(n_i):
            net += state.at.v[i, j] * p[j]
        net_3 += state.at.w[i] * node(state, i, net)
    return node(state, n_h, net_3)


@register_jitable
def net_derivative(state: EbpaState, i: int) -> float:
    """d sigma_i / d net_i (Eq. 5-14)."""
    at, y = state.at, state.y[i]
    return (at.upper[i] - at.lower[i]) * y * (1.0 - y) / at.slope[i]


@register_jitable
def move_activation(params: EbpaParams, state: EbpaState, i: int, by: tuple[float, float, float]) -> None:
    """Update U, Q and s of node i in place; by: H_3 times the error that each derivative of the node meets."""
    at, last, y = state.at, state.last, state.y[i]
    d_s = -state.net[i] / at.slope[i] * net_derivative(state, i)
    last.upper[i] = by[0] * y + params.alpha * last.upper[i]
    last.lower[i] = by[1] * (1.0 - y) + params.alpha * last.lower[i]
    last.slope[i] = by[2] * d_s + params.alpha * last.slope[i]
    at.upper[i] = limited(at.upper[i] + last.upper[i], params.limit)
    at.lower[i] = limited(at.lower[i] + last.lower[i], params.limit)
    at.slope[i] = max(limited(at.slope[i] + last.slope[i], params.limit), S_MIN)


@register_jitable
def ebpa_learn(params: EbpaParams, state: EbpaState, p: np.ndarray, e: float) -> None:
    """Update all weights and activation functions in place from the error e [N] of this sample."""
    at, last = state.at, state.last
    n_h, n_i = at.v.shape
    slope_3, y_3 = net_derivative(state, n_h), state.y[n_h]
    d_s3 = -state.net[n_h] / at.slope[n_h] * slope_3
    for i in range(n_h):
        w, y = at.w[i], state.y[i]
        sigma = (at.upper[i] - at.lower[i]) * y + at.lower[i]
        back = params.h_1 * w * net_derivative(state, i) * slope_3 * e
        for j in range(n_i):
            move = p[j] * back + params.alpha * last.v[i, j]
            last.v[i, j] = move
            at.v[i, j] = limited(at.v[i, j] + move, params.limit)
        by = params.h_3 * w * e
        move_activation(params, state, i, (by * y_3, by * (1.0 - y_3), by * d_s3))
        last.w[i] = params.h_2 * sigma * slope_3 * e + params.alpha * last.w[i]
        at.w[i] = limited(w + last.w[i], params.limit)
    by = params.h_3 * e
    move_activation(params, state, n_h, (by, by, by))
