"""Savitzky-Golay filters against scipy's."""

import numpy as np
import pytest
from scipy.signal import savgol_filter

from pneugantry.engine.signals.smooth import savgol, widest, widest_slope


@pytest.mark.parametrize(("window", "degree", "derivative"), [(3, 1, 0), (9, 2, 1), (9, 3, 2)])
def test_as_scipy(window: int, degree: int, derivative: int) -> None:
    values = np.random.default_rng(1).standard_normal(200)
    expected = savgol_filter(values, window, degree, deriv=derivative)
    np.testing.assert_allclose(savgol(values, window, degree, derivative), expected, atol=1e-12)


def test_short_signal() -> None:
    values = np.array([1.0, 3.0, 5.0, 7.0])
    np.testing.assert_allclose(savgol(values, 9, 1, 1), 2.0)


def test_standstill_is_smoothed_most() -> None:
    """A ramp between two stands, with noise: the stands lose most of it, the corners stay."""
    rng = np.random.default_rng(2)
    true = np.interp(np.arange(1000), [0, 450, 500, 1000], [0.0, 0.0, 30.0, 30.0])
    found = widest(true + rng.standard_normal(1000), 1.0).values
    stand = np.r_[100:400, 600:900]
    assert np.std(found[stand] - true[stand]) < 0.25
    assert np.abs(found - true)[430:520].max() < 3.0


def test_a_line_stays_a_line() -> None:
    line = np.linspace(-3, 5, 200)
    np.testing.assert_allclose(widest(line, 1e-3).values, line, atol=1e-12)


def test_what_stands_still_is_at_rest_whatever_the_bias() -> None:
    rng = np.random.default_rng(3)
    true = np.interp(np.arange(1000), [0, 450, 500, 1000], [0.0, 0.0, 30.0, 30.0])
    found = widest(1.02 * true + 7.0 + 0.1 * rng.standard_normal(1000), 0.1).less(1.02, 7.0, 0.0)
    assert not found[100:400].any()
    assert np.std(found[600:900] - 30.0) < 0.02


def test_a_slope_is_taken_over_as_wide_a_window_as_the_signal_allows() -> None:
    """Of a stand, a ramp and a stand: where it is steady noise leaves a tenth of what a window of
    nine rows has, and about the corners that ends within a few rows.
    """
    rng = np.random.default_rng(4)
    true = np.interp(np.arange(1000), [0, 400, 600, 1000], [0.0, 0.0, 100.0, 100.0])
    found = widest_slope(true + 0.3 * rng.standard_normal(1000), 0.3)
    steady = np.r_[50:390, 640:950]
    nine = savgol(0.3 * rng.standard_normal(1000), 9, 2, 1)
    assert np.std(found[steady]) < 0.1 * np.std(nine)
    assert found[440:560] == pytest.approx(0.5, abs=0.02)
    assert found[405:415] == pytest.approx(0.5, abs=0.2)
    assert found[385:395] == pytest.approx(0.0, abs=0.2)
