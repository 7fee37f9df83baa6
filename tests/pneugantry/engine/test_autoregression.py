"""Whitening of noise of unknown colour."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from pneugantry.engine.fitting.autoregression import (
    DRIFT,
    LASTING,
    LONGEST,
    _kernels,
    drifting,
    quoted,
    undrifted,
    whitener_of,
)

NOISE = np.random.default_rng(5).normal(0, 3.0, (3, 4000))


def test_coloured_noise_becomes_white_of_size_one() -> None:
    series = [np.asarray(lfilter([1.0], [1.0, -1.4, 0.5], n)) for n in NOISE]
    whiten = whitener_of(series)
    assert whiten.coefficients[:2] == pytest.approx([1.4, -0.5], abs=0.05)
    assert whiten.sigma == pytest.approx(3.0, rel=0.03)
    white = whiten(series[0])
    assert len(white) == 4000 - LONGEST
    assert np.std(white) == pytest.approx(1.0, rel=0.05)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.05


def test_the_size_is_that_of_the_innovations() -> None:
    series = [
        np.asarray(lfilter([1.0], [1.0, -1.9, 0.95], n))[:k]
        for n, k in zip(NOISE, (4000, 900, 40), strict=True)
    ]
    whiten = whitener_of(series)
    white = np.concatenate([whiten(s) for s in series])
    assert len(whiten.coefficients) >= 2
    assert np.sqrt(np.mean(white**2)) == pytest.approx(1.0, rel=1e-9)


def test_white_noise_pays_for_no_order() -> None:
    assert len(whitener_of(list(NOISE)).coefficients) == 0


def test_a_constant_error_is_left_in_where_noise_is_white() -> None:
    whiten = whitener_of([n + 0.5 for n in NOISE])
    assert np.mean(whiten(NOISE[0] + 0.5) - whiten(NOISE[0])) > 0.1


def test_an_error_that_hardly_changes_is_no_noise() -> None:
    """An offset of 200 sigma: a free colour takes all of it, a bounded one leaves it in sight."""
    offset = [n + 200.0 for n in NOISE]
    free, bounded = whitener_of(offset, 1.0), whitener_of(offset, 1.0, slow=20.0)
    assert np.abs(free(offset[0])).mean() < 2.0
    assert np.abs(bounded(offset[0]) * bounded.sigma).mean() > 100.0


def test_a_bound_that_is_kept_changes_nothing() -> None:
    np.testing.assert_array_equal(
        whitener_of(list(NOISE), 0.1, slow=20.0).coefficients,
        whitener_of(list(NOISE), 0.1).coefficients,
    )


@pytest.mark.parametrize("size", [0.01, 1.0, 10.0])
def test_the_bound_holds_for_the_size_that_is_used(size: float) -> None:
    """A smooth error has innovations far below the least size: its roots would be as good as 1."""
    smooth = [size * np.sin(np.arange(4000) / 300 + k) for k in range(3)]
    whiten = whitener_of(smooth, 1.0, slow=20.0)
    assert whiten.sigma >= 1.0
    assert whiten.sigma / (1 - whiten.coefficients.sum()) <= 20.0 * (1 + 1e-6)


def test_a_larger_smooth_error_costs_more() -> None:
    """Though either could be predicted from its own past."""
    costs = []
    for size in (3.0, 10.0, 30.0):
        error = size * np.sin(np.arange(4000) / 60)
        whiten = whitener_of([error], 1.0, slow=20.0)
        costs.append(float(np.sum(whiten(error) ** 2)) + 2 * 4000 * np.log(whiten.sigma))
    assert costs[1] > costs[0] + 100
    assert costs[2] > costs[1] + 100


@pytest.mark.parametrize("sigma", [0.0, 0.1, 0.5])
def test_a_quoted_error_has_its_size_and_lasts_as_long(sigma: float) -> None:
    whiten = quoted(sigma, 1.0, 40.0)
    noise = whiten.drawn(np.random.default_rng(2).standard_normal(400_000))
    assert np.std(noise) == pytest.approx(np.hypot(sigma, 1.0), rel=0.05)
    assert np.mean(noise[40:] * noise[:-40]) == pytest.approx(np.exp(-1), abs=0.12)
    assert np.std(whiten(noise)) == pytest.approx(1.0, rel=0.01)


def test_every_order_is_the_best_predictor_of_its_length() -> None:
    """Against a solver of the normal equations that knows no recursion."""
    series = np.asarray(lfilter([1.0], [1.0, -1.4, 0.5], NOISE[0]))
    lags = np.array([series[: len(series) - k] @ series[k:] for k in range(LONGEST + 1)])
    for order, kernel in enumerate(_kernels(lags)):
        expected = solve_toeplitz(lags[:order], lags[1 : order + 1]) if order else []
        assert -kernel[1 : order + 1] == pytest.approx(expected, rel=1e-6, abs=1e-9)
        assert not kernel[order + 1 :].any()


def test_many_residuals_become_white_as_each_alone() -> None:
    whiten = whitener_of([np.asarray(lfilter([1.0], [1.0, -1.4, 0.5], n)) for n in NOISE])
    together = whiten(NOISE)
    for row, alone in zip(together, NOISE, strict=True):
        assert row == pytest.approx(whiten(alone), rel=1e-12, abs=1e-12)


def walking(lasting: float, rng: np.random.Generator, rows: int = 4000) -> np.ndarray:
    """White noise of size 1 above a random walk of steps 1 / lasting."""
    return rng.standard_normal(rows) + np.cumsum(rng.standard_normal(rows)) / lasting


@pytest.mark.parametrize("lasting", LASTING)
def test_what_a_view_adds_up_is_a_drift(lasting: float) -> None:
    """The best predictor of a random walk under noise is a mean that forgets by the factor e in as
    many rows as the noise is larger than a step (Muth 1960).
    """
    rng = np.random.default_rng(7)
    series = [walking(lasting, rng) for _ in range(4)]
    found = drifting(series, 0.1)
    assert 0.5 * lasting <= found.lasting <= 2 * lasting
    assert len(found.coefficients) <= 3
    white = np.concatenate([found(s) for s in series])
    assert np.std(white) == pytest.approx(1.0, rel=0.08)
    for rows in (1, 5, 30, 100):
        assert abs(np.corrcoef(white[rows:], white[:-rows])[0, 1]) < 0.05


def test_lags_alone_do_not_reach_as_far() -> None:
    rng = np.random.default_rng(8)
    series = [walking(32.0, rng) for _ in range(4)]
    alone, found = whitener_of(series, 0.1), drifting(series, 0.1)

    def cost(whitener) -> float:
        white = np.concatenate([whitener(s) for s in series])
        return float(white @ white) + 2 * len(white) * np.log(whitener.sigma)

    assert cost(found) < cost(alone) - 100
    assert len(found.coefficients) < len(alone.coefficients)


def test_white_noise_has_no_drift() -> None:
    assert drifting(list(NOISE), 0.1).lasting == 0


def test_a_constant_error_stays_in_sight_behind_a_drift() -> None:
    still = undrifted(np.full(2000, 3.0), 32.0)
    assert still[0] == 3.0
    assert still[-1] == pytest.approx(3.0 * (1 - DRIFT))


@pytest.mark.parametrize("size", [0.01, 1.0, 10.0])
def test_the_bound_holds_behind_a_drift(size: float) -> None:
    smooth = [size * np.sin(np.arange(4000) / 300 + k) for k in range(3)]
    whiten = whitener_of(smooth, 1.0, slow=20.0, lasting=32.0)
    there = (1 - DRIFT) * (1 - whiten.coefficients.sum())
    assert whiten.sigma / there <= 20.0 * (1 + 1e-6)


def test_noise_with_a_drift_is_drawn_as_it_is_made_white() -> None:
    rng = np.random.default_rng(9)
    whiten = drifting([walking(16.0, rng) for _ in range(4)], 0.1)
    innovations = rng.standard_normal(3000)
    noise = whiten.drawn(innovations)
    assert whiten(noise) == pytest.approx(innovations[LONGEST:], abs=1e-9)


def test_many_residuals_are_freed_of_their_drift_as_each_alone() -> None:
    both = np.cumsum(NOISE.reshape(3, 2, 2000), axis=-1)
    together = undrifted(both, 16.0)
    for place in np.ndindex(3, 2):
        np.testing.assert_array_equal(together[place], undrifted(both[place], 16.0))
