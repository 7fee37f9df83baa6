"""MBPM network against the equations in numpy, and where its output acts."""

import copy
import math

import numpy as np
import pytest

from controllers.catalogue import make_controller
from controllers.interface import Reference, Sense
from controllers.mbpm import MbpmParams, MbpmState, mbpm_learn, mbpm_output, mbpm_state
from controllers.pi_fv import PiFv

PARAMS = MbpmParams(
    n_h=5, h_1=0.7, h_2=0.5, lam=0.2, slope=1.3, bias=0.4, k_z=0.02, k_v=0.05, g_max=2.0
)
DT = 1e-3


def drawn_network(seed: int) -> tuple[MbpmState, np.ndarray]:
    rng = np.random.default_rng(seed)
    state = mbpm_state(PARAMS, 14)
    state.v[:] = 0.3 * rng.standard_normal((5, 14))
    state.w[:] = rng.standard_normal(5)
    return state, rng.standard_normal(14)


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("e", [3.0, -2.0])
def test_output_and_updates_are_those_of_eq_5_18_to_5_22(linear, e):
    params = PARAMS._replace(linear=linear)
    state, p = drawn_network(1)
    v, w = state.v.copy(), state.w.copy()
    sigma = 1 / (1 + np.exp(-params.slope * (v @ p + params.bias)))
    prime = params.slope * sigma * (1 - sigma)
    y = 1 / (1 + np.exp(-params.slope * (w @ sigma + params.bias)))
    slope_3 = 1.0 if linear else params.slope * y * (1 - y)
    norm = math.sqrt((v**2).sum() + (w**2).sum())
    output = (w @ sigma if linear else y) + params.k_z * (norm + params.g_max) * e + params.k_v * e
    d_v = params.h_1 * np.outer(w * prime, p) * slope_3 * e - params.lam * params.h_1 * v * abs(e)
    d_w = params.h_2 * slope_3 * e * (sigma - prime * (v @ p)) - params.lam * params.h_2 * w * abs(
        e
    )
    u, slope = mbpm_output(params, state, p, e)
    mbpm_learn(params, state, p, e, (slope, DT))
    assert u == pytest.approx(output, rel=1e-12)
    np.testing.assert_allclose(state.v - v, DT * d_v, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(state.w - w, DT * d_w, rtol=1e-9, atol=1e-15)


def test_error_modification_bounds_the_weights_under_a_lasting_error():
    state, p = drawn_network(2)
    for _ in range(200_000 // 100):
        _, slope = mbpm_output(PARAMS, state, p, 40.0)
        mbpm_learn(PARAMS, state, p, 40.0, (slope, DT))
    assert np.abs(state.w).max() <= (1.0 + PARAMS.slope) / PARAMS.lam
    assert np.isfinite(state.v).all()


def first_command(name: str, degrees: float) -> tuple[float, float]:
    """a_x, a_z [V] at the first sample on a slope, f_n = 28 N where 30 N are asked."""
    theta = math.radians(degrees)
    sense = Sense(0.5, 0.05, 0.0, 0.0, -28.0 * math.sin(theta), 28.0 * math.cos(theta), 0.0, 0.0)
    with_it, without = (
        c.step(Reference(30.0, 0.0), sense) for c in (make_controller(name), PiFv())
    )
    return without.u_x - with_it.u_x, with_it.u_z - without.u_z


def test_first_output_of_zero_weights_is_the_bias_and_the_robustifying_term():
    a_x, a_z = first_command("pi_fv_mbpm", 20.0)
    assert a_x == pytest.approx(0.0, abs=1e-15)
    assert a_z == pytest.approx(1.0 / (1.0 + math.exp(-1.0)) + 0.1 * 2.0)


def test_on_both_axes_the_output_is_a_force_along_the_normal():
    a_x, a_z = first_command("pi_fv_mbpm_both", 20.0)
    assert 186.0 * a_x / (100.0 * a_z) == pytest.approx(-math.tan(math.radians(20.0)))
    assert a_z == pytest.approx((1.0 / (1.0 + math.exp(-1.0)) + 0.2) * math.cos(math.radians(20.0)))


def test_network_does_not_learn_while_the_command_is_clipped_outwards():
    controller = make_controller("pi_fv_mbpm")
    before = copy.deepcopy(controller.state.nn)
    controller.step(Reference(900.0, 0.0), Sense(0.9, 0.04, 0.0, 0.0, 0.0, 28.0, 0.0, 15.0))
    assert np.array_equal(before.w, controller.state.nn.w)


@pytest.mark.parametrize(
    "options",
    [{"n_h": 0}, {"lam": -1.0}, {"slope": 0.0}, {"axes": "x"}, {"u_max": 0.0}, {"n_i": 4}],
)
def test_impossible_options_are_refused_by_name(options):
    with pytest.raises(ValueError, match=f"{next(iter(options))} must be"):
        make_controller("pi_fv_mbpm", **options)
