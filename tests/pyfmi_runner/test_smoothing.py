"""The smoother against brute-force least squares on the same two sensors."""

import numpy as np
import pytest

from pyfmi_runner.smoothing import jumps, smooth_axis, within_jumps

DT = 1e-3


def least_squares(
    position: np.ndarray, speed: np.ndarray, sigma_s: float, sigma_v: float
) -> tuple[np.ndarray, np.ndarray]:
    """Positions that fit all readings best, and their variances: each position read with sigma_s,
    each difference of neighbours with sigma_v*dt as the mean of the two speeds says it. The first
    position is also known from its own reading, as the filter starts on it.
    """
    n = len(position)
    differences = (np.eye(n, k=1) - np.eye(n))[:-1]
    design = np.vstack([np.eye(n) / sigma_s, differences / (sigma_v * DT)])
    seen = np.concatenate(
        [position / sigma_s, 0.5 * DT * (speed[1:] + speed[:-1]) / (sigma_v * DT)]
    )
    covariance = np.linalg.inv(design.T @ design)
    return covariance @ design.T @ seen, np.diag(covariance)


def readings(
    n: int, sigma_s: float, sigma_v: float, seed: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True position, and both sensors; the motion is an oscillation of 3 mm."""
    rng = np.random.default_rng(seed)
    time = np.arange(n) * DT
    true = 0.003 * np.sin(20 * time)
    return (
        true,
        true + sigma_s * rng.standard_normal(n),
        0.06 * np.cos(20 * time) + sigma_v * rng.standard_normal(n),
    )


@pytest.mark.parametrize(("sigma_s", "sigma_v"), [(1e-4, 5e-4), (3e-4, 1e-3), (1e-6, 0.1)])
def test_it_is_the_least_squares_estimate(sigma_s: float, sigma_v: float) -> None:
    _, position, speed = readings(400, sigma_s, sigma_v)
    found = smooth_axis(position, speed, sigma_s, sigma_v)
    wanted, variance = least_squares(position, speed, sigma_s, sigma_v)
    assert found.position == pytest.approx(wanted, abs=1e-4 * sigma_s)
    assert found.sigma**2 == pytest.approx(variance[200], rel=1e-6)


def test_it_is_ten_times_as_exact_as_the_reading_and_says_so() -> None:
    sigma_s, sigma_v = 1e-4, 5e-4
    true, position, speed = readings(8000, sigma_s, sigma_v, seed=1)
    found = smooth_axis(position, speed, sigma_s, sigma_v)
    error = float(np.std((found.position - true)[500:-500]))
    assert error < 0.1 * sigma_s
    assert error == pytest.approx(
        found.sigma, rel=0.35
    )  # few independent samples: the correlation is long


def test_innovations_are_white_and_of_unit_size_where_the_sensors_agree() -> None:
    _, position, speed = readings(8000, 1e-4, 5e-4, seed=2)
    inner = smooth_axis(position, speed, 1e-4, 5e-4).innovation[200:]
    assert float(np.sqrt(np.mean(inner**2))) == pytest.approx(1.0, abs=0.03)
    assert abs(float(np.mean(inner[1:] * inner[:-1]))) < 0.04


def test_a_tachometer_that_is_off_shows_in_the_innovations() -> None:
    _, position, speed = readings(8000, 1e-4, 5e-4, seed=2)
    assert (
        float(
            np.sqrt(np.mean(smooth_axis(position, speed + 0.005, 1e-4, 5e-4).innovation[200:] ** 2))
        )
        > 3
    )


def test_an_axis_that_does_not_move_stays_where_it_is() -> None:
    found = smooth_axis(np.full(50, 0.04), np.zeros(50), 1e-4, 5e-4)
    assert found.position == pytest.approx(np.full(50, 0.04), abs=1e-15)
    assert np.abs(found.innovation).max() < 1e-9


def stopped(into: float, sigma_s: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True position, and both sensors, of an axis that runs into its end `into` of the step from
    row 300 to the next; 0.5 m/s before.
    """
    rng = np.random.default_rng(seed)
    rows = np.arange(600)
    true = 0.5 * DT * np.minimum(rows, 300 + into)
    speed = np.where(rows <= 300, 0.5, 0.0)
    noise = rng.standard_normal((2, 600))
    return true, true + sigma_s * noise[0], speed + 5e-4 * noise[1]


def test_when_a_speed_jumped_within_a_step_its_position_tells() -> None:
    off, smoothed = [], []
    for seed, into in enumerate(np.linspace(0.02, 0.98, 25)):
        true, position, speed = stopped(into, 3e-4, seed)
        found = within_jumps(position, speed, 3e-4, 5e-4)
        assert found is not None
        assert np.flatnonzero(found).tolist() == [300]
        off.append(found[300] / 0.5 - (into - 0.5))
        smoothed.append(
            np.std(smooth_axis(position, speed, 3e-4, 5e-4).position[200:400] - true[200:400])
        )
    assert np.sqrt(np.mean(np.square(off))) < 0.16  # 0.29 where nothing is known of it
    assert np.mean(smoothed) < 5e-5  # a tenth of what the axis goes in a step


def test_a_position_that_is_too_coarse_changes_nothing() -> None:
    _, position, speed = stopped(0.9, 0.01, 0)
    found = within_jumps(position, speed, 0.01, 5e-4)
    assert found is not None
    assert abs(found[300]) < 0.05 * 0.5


def test_noise_and_steady_motion_have_no_jumps() -> None:
    rng = np.random.default_rng(2)
    rows = np.arange(20_000)
    speed = 0.3 * np.sin(2e-3 * rows) + 5e-4 * rng.standard_normal(len(rows))
    assert not jumps(speed, 5e-4).any()
    assert within_jumps(speed, speed, 1e-4, 5e-4) is None
