"""Savitzky-Golay filters against scipy's."""

import numpy as np
import pytest
from scipy.signal import savgol_filter

from pneugantry.engine.smooth import savgol


@pytest.mark.parametrize(("window", "degree", "derivative"), [(3, 1, 0), (9, 2, 1), (9, 3, 2)])
def test_as_scipy(window: int, degree: int, derivative: int) -> None:
    values = np.random.default_rng(1).standard_normal(200)
    expected = savgol_filter(values, window, degree, deriv=derivative)
    np.testing.assert_allclose(savgol(values, window, degree, derivative), expected, atol=1e-12)


def test_short_signal() -> None:
    values = np.array([1.0, 3.0, 5.0, 7.0])
    np.testing.assert_allclose(savgol(values, 9, 1, 1), 2.0)
