"""Sensors: closed forms of each stage, and the same bits in Python and compiled."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from numba import njit

from pyfmi_runner import log
from pyfmi_runner.sensors import (
    SIGMA,
    SensorParams,
    check_sensors,
    initial_state,
    noise_rows,
    sense,
)

QUIET = SensorParams(noise=False)
ROW = noise_rows(1, 0)[0]
TRUE = (0.5, 0.05, -0.06, 0.01, 2.0, 30.0, -40.0, 50.0)


@njit
def sense_compiled(params, state, true, noise):  # type: ignore[no-untyped-def]
    return sense(params, state, true, noise)


def test_noise_is_that_of_the_log_table() -> None:
    assert dict(zip(log.MEASURED, SIGMA, strict=True)) == dict(log.SIGMA)


def test_perfect_sensors_say_the_truth() -> None:
    assert sense(QUIET, initial_state(), TRUE, ROW)[1] == TRUE


def test_python_and_compiled_give_the_same_bits() -> None:
    params = SensorParams(
        quantum=(1e-3, 1e-4, 1e-3, 1e-3, 0.0, 0.1, 0.5, 0.0),
        bias_f_x=0.3,
        gain_f_z=1.1,
        crosstalk_f_x=0.02,
        crosstalk_f_z=-0.01,
        tau_v_x=0.013,
        tau_v_z=0.0004,
    )
    truth, noise = np.random.default_rng(5).normal(size=(500, 8)), noise_rows(500, 7)
    interpreted = compiled = initial_state(0.1, -0.2)
    for k in range(500):
        interpreted, said = sense(params, interpreted, tuple(truth[k].tolist()), noise[k])
        compiled, compiled_said = sense_compiled(
            params, compiled, tuple(truth[k].tolist()), noise[k]
        )
        assert said == compiled_said
        assert tuple(interpreted) == tuple(compiled)


def test_lag_is_exact_for_a_ramp() -> None:
    tau, slope, dt = 0.02, 0.7, 0.001
    params, state = QUIET._replace(tau_v_x=tau), initial_state()
    for k in range(1, 300):
        t = k * dt
        state, said = sense(params, state, (0.0, 0.0, slope * t, 0.0, 0.0, 0.0, 0.0, 0.0), ROW)
        assert said[2] == pytest.approx(slope * (t - tau * (1 - math.exp(-t / tau))), abs=1e-14)


def test_bias_gain_and_crosstalk_act_on_the_true_forces() -> None:
    params = QUIET._replace(
        bias_f_x=1.0, gain_f_z=1.2, crosstalk_f_x=0.1, crosstalk_f_z=0.5, gain_f_ax=2.0
    )
    said = sense(params, initial_state(), TRUE, ROW)[1]
    assert said[4:] == pytest.approx((2.0 + 0.1 * 30.0 + 1.0, 1.2 * 30.0 + 0.5 * 2.0, -80.0, 50.0))


def test_quantisation_comes_after_noise() -> None:
    params = SensorParams(quantum=(0.0, 0.0, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0))
    said = [sense(params, initial_state(), TRUE, row)[1][5] for row in noise_rows(200, 3)]
    assert all(value % 0.25 == 0 for value in said)
    noiseless = [
        sense(params, initial_state(), (*TRUE[:5], v, *TRUE[6:]), 0 * ROW)[1][5]
        for v in (30.12, 30.13)
    ]
    assert noiseless == [30.0, 30.25]


def test_noise_has_the_sigma_it_is_given_and_follows_the_seed() -> None:
    rows = noise_rows(4000, 11)
    said = np.array([sense(SensorParams(), initial_state(), TRUE, row)[1] for row in rows])
    assert (said - TRUE).std(axis=0) == pytest.approx(SIGMA, rel=0.05)
    assert np.array_equal(rows, noise_rows(4000, 11))
    assert not np.array_equal(rows, noise_rows(4000, 12))


def test_params_and_state_pickle() -> None:
    assert pickle.loads(pickle.dumps((QUIET, initial_state()))) == (QUIET, initial_state())


@pytest.mark.parametrize(
    "change",
    [
        {"tau_v_x": -1.0},
        {"sigma": (1.0,)},
        {"gain_f_x": math.nan},
        {"dt": 0.0},
        {"quantum": (-1.0,) * 8},
    ],
)
def test_values_out_of_range_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        check_sensors(SensorParams(**change))  # type: ignore[arg-type]
