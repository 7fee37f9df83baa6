"""Logistic function against its closed form, and at its ends."""

import math

import pytest

from controllers.sigmoid import limited, logistic


@pytest.mark.parametrize("a", [-30.0, -1.0, 0.0, 0.5, 20.0])
def test_logistic_is_that_of_eq_5_1(a):
    assert logistic(a) == pytest.approx(0.5 * (1.0 + math.tanh(a / 2.0)), rel=1e-12, abs=1e-13)


def test_logistic_ends_at_0_and_1_without_overflow():
    assert logistic(-1e6) == pytest.approx(0.0, abs=1e-43)
    assert logistic(1e6) == 1.0


def test_limited_keeps_the_sign():
    assert [limited(value, 2.0) for value in (-5.0, -1.0, 5.0)] == [-2.0, -1.0, 2.0]
