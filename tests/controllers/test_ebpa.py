"""EBPA network against the printed equations in numpy and against numerical derivatives."""

import copy

import numpy as np
import pytest

from controllers.catalogue import make_controller
from controllers.ebpa import EbpaParams, EbpaState, ebpa_learn, ebpa_output
from controllers.ebpa_comp import ebpa_state
from controllers.interface import Reference, Sense
from controllers.pi_fv import PiFv

PARAMS = EbpaParams(n_h=6, h_1=2e-3, h_2=3e-3, h_3=5e-3, alpha=0.4, bias=0.3)


def drawn_network(seed: int) -> tuple[EbpaState, np.ndarray]:
    rng = np.random.default_rng(seed)
    state = ebpa_state(PARAMS, 14)
    state.at.v[:] = 0.3 * rng.standard_normal((6, 14))
    state.at.w[:] = rng.standard_normal(6)
    state.at.upper[:] = 1.0 + 0.2 * rng.standard_normal(7)
    state.at.lower[:] = 0.2 * rng.standard_normal(7)
    state.at.slope[:] = 1.0 + 0.2 * rng.random(7)
    return state, rng.standard_normal(14)


def printed(state: EbpaState, p: np.ndarray, e: float) -> tuple[float, dict[str, np.ndarray]]:
    """Output and first updates (no momentum yet), Eq. 5-2 to 5-17 line by line."""
    v, w, u, q, s = (array.copy() for array in state.at)
    net2 = v @ p + PARAMS.bias
    sig2 = (u[:-1] - q[:-1]) / (1 + np.exp(-net2 / s[:-1])) + q[:-1]
    net = np.append(net2, w @ sig2 + PARAMS.bias)
    sig = (u - q) / (1 + np.exp(-net / s)) + q
    d_net = -(sig - u) * (sig - q) / (s * (u - q))
    d_u = 1 / (1 + np.exp(-net / s))
    d_q = 1 - d_u
    d_s = -net / s * d_net
    moves = {
        "v": PARAMS.h_1 * np.outer(w * d_net[:-1], p) * d_net[-1] * e,
        "w": PARAMS.h_2 * sig2 * d_net[-1] * e,
        "upper": PARAMS.h_3 * np.append(w * d_u[:-1] * d_u[-1], d_u[-1]) * e,
        "lower": PARAMS.h_3 * np.append(w * d_q[:-1] * d_q[-1], d_q[-1]) * e,
        "slope": PARAMS.h_3 * np.append(w * d_s[:-1] * d_s[-1], d_s[-1]) * e,
    }
    return sig[-1], moves


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_output_and_updates_are_the_printed_ones(seed):
    state, p = drawn_network(seed)
    before = copy.deepcopy(state)
    output, moves = printed(state, p, -2.5)
    assert ebpa_output(PARAMS, state, p) == pytest.approx(output, rel=1e-12)
    ebpa_learn(PARAMS, state, p, -2.5)
    for name, move in moves.items():
        moved = getattr(state.at, name) - getattr(before.at, name)
        np.testing.assert_allclose(moved, move, rtol=1e-6, atol=1e-15, err_msg=name)


def test_momentum_adds_its_share_of_the_last_update():
    state, p = drawn_network(4)
    ebpa_output(PARAMS, state, p)
    ebpa_learn(PARAMS, state, p, 1.0)
    first = {name: getattr(state.last, name).copy() for name in state.last._fields}
    _, moves = printed(state, p, -0.5)
    ebpa_output(PARAMS, state, p)
    ebpa_learn(PARAMS, state, p, -0.5)
    for name, move in moves.items():
        expected = move + PARAMS.alpha * first[name]
        np.testing.assert_allclose(
            getattr(state.last, name), expected, rtol=1e-9, atol=1e-15, err_msg=name
        )


@pytest.mark.parametrize(("name", "rate"), [("v", PARAMS.h_1), ("w", PARAMS.h_2)])
def test_weights_move_along_the_numerical_gradient_of_the_output(name, rate):
    state, p = drawn_network(5)
    weights = getattr(state.at, name)
    gradient = np.empty_like(weights)
    for index in np.ndindex(weights.shape):
        kept = weights[index]
        weights[index] = kept + 1e-6
        above = ebpa_output(PARAMS, state, p)
        weights[index] = kept - 1e-6
        gradient[index] = (above - ebpa_output(PARAMS, state, p)) / 2e-6
        weights[index] = kept
    before = weights.copy()
    ebpa_output(PARAMS, state, p)
    ebpa_learn(PARAMS, state, p, 1.0)
    np.testing.assert_allclose(weights - before, rate * gradient, rtol=1e-5, atol=1e-12)


def test_slope_is_held_at_its_smallest_value():
    state, p = drawn_network(6)
    state.at.slope[:] = 0.0501
    for e in [50.0] * 5 + [-50.0] * 5:
        ebpa_output(PARAMS, state, p)
        ebpa_learn(PARAMS, state, p, e)
    assert state.at.slope.min() == 0.05


@pytest.mark.parametrize(("lower", "volts"), [(0.0, 0.5), (-1.0, 0.0)])
def test_first_output_of_zero_weights_is_the_middle_of_its_bounds(lower, volts):
    sense = Sense(0.9, 0.04, 0.0, 0.0, 0.0, 28.0, 0.0, 15.0)
    network = make_controller("pi_fv_ebpa_zero", upper=1.0, lower=lower)
    with_it, without = (c.step(Reference(30.0, 0.0), sense) for c in (network, PiFv()))
    assert with_it.u_z - without.u_z == pytest.approx(volts)
    assert with_it.u_x == without.u_x


def test_network_does_not_learn_while_the_command_is_clipped_outwards():
    controller = make_controller("pi_fv_ebpa")
    before = copy.deepcopy(controller.state.nn.at)
    controller.step(Reference(900.0, 0.0), Sense(0.9, 0.04, 0.0, 0.0, 0.0, 28.0, 0.0, 15.0))
    assert all(np.array_equal(a, b) for a, b in zip(before, controller.state.nn.at, strict=True))


@pytest.mark.parametrize(
    "options",
    [
        {"n_h": 0},
        {"h_2": -1.0},
        {"alpha": 1.0},
        {"upper": -5.0},
        {"slope": 0.0},
        {"u_max": 0.0},
        {"n_i": 30},
    ],
)
def test_impossible_options_are_refused_by_name(options):
    with pytest.raises(ValueError, match=f"{next(iter(options))} must be"):
        make_controller("pi_fv_ebpa", **options)
