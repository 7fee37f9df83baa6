"""Grids of coarse converters and encoders, as readings show them."""

from __future__ import annotations

import numpy as np
import pytest

from pneugantry.engine.plant import Record, Signal
from pneugantry.engine.signals.converter import converted, converter_step, grid_of, step_and_grid

SIGMA = 0.05


def swept(rows: int = 4000, sigma: float = SIGMA) -> np.ndarray:
    """A signal that never dwells, over 40 noises and more."""
    true = np.linspace(0.0, 2.0, rows) + 20 * np.sin(np.linspace(0.0, 5.0, rows))
    return np.asarray(true + sigma * np.random.default_rng(4).standard_normal(rows))


def cells(values: np.ndarray, step: float) -> np.ndarray:
    return np.asarray(step * np.round(values / step))


@pytest.mark.parametrize(
    ("step", "found"), [(0.0, False), (0.01, False), (0.05, True), (0.5, True)]
)
def test_a_coarse_converter_is_seen_and_a_logs_own_rounding_is_not(
    step: float, found: bool
) -> None:
    generator = np.random.default_rng(2)
    level = np.repeat(generator.uniform(0.0, 5.0, 40), 500)
    reading = level + SIGMA * generator.standard_normal(len(level))
    if step:
        reading = step * np.round(reading / step)
    reading = 0.01 * np.round(reading / 0.01)
    measured = converter_step(reading, SIGMA)
    assert (measured > 0) == found
    if found:
        assert measured == pytest.approx(step, rel=0.05)


def test_a_coarse_converter_is_seen_on_a_channel_that_mostly_rests_in_one_of_its_cells() -> None:
    generator = np.random.default_rng(6)
    level = np.concatenate([np.full(60_000, 0.05), generator.uniform(0.0, 40.0, 15_000)])
    coarse = 0.17 * np.floor((level + SIGMA * generator.standard_normal(len(level))) / 0.17)
    assert converter_step(0.01 * np.round(coarse / 0.01), SIGMA) == pytest.approx(0.17)
    fine = np.concatenate(
        [np.zeros(60_000), level[60_000:] + SIGMA * generator.standard_normal(15_000)]
    )
    assert converter_step(0.01 * np.round(fine / 0.01), SIGMA) == 0.0


def test_cells_in_which_a_signal_dwells_may_be_far_apart() -> None:
    """A force at rest, and in contact about two cells: 0.5 is the step, not the 3 between both."""
    generator = np.random.default_rng(7)
    passed = 0.5 * generator.integers(-60, 60, 3000)
    dwelt = np.repeat([0.0, 14.0, 14.5, 17.5], [90_000, 300, 300, 300])
    assert converter_step(np.concatenate([dwelt, passed]), SIGMA) == pytest.approx(0.5)


@pytest.mark.parametrize("step", [0.03, 0.1, 0.5])
def test_an_encoder_whose_cells_are_passed_is_seen(step: float) -> None:
    assert converter_step(cells(swept(), step), SIGMA) == pytest.approx(step)


@pytest.mark.parametrize("digits", [0.001, 0.01, 0.02])
def test_what_a_log_rounds_is_no_converter(digits: float) -> None:
    assert converter_step(cells(swept(), digits), SIGMA) == 0.0


def test_significant_digits_are_no_converter() -> None:
    """A decade higher cells are ten times as wide, yet finer than the noise."""
    assert converter_step(np.array([float(f"{v:.4g}") for v in 8 * swept()]), 8 * SIGMA) == 0.0


def test_means_of_an_encoder_s_neighbours_show_it_and_stay_as_they_are() -> None:
    mean = np.convolve(cells(swept(), 0.5), np.ones(7) / 7, mode="valid")
    assert step_and_grid(mean, SIGMA) == (pytest.approx(0.5), None)


def test_what_holds_no_numbers_or_one_value_is_no_converter() -> None:
    for values in (np.zeros(0), np.zeros(500), np.full(500, np.nan), np.array([0.0, 1.0] * 300)):
        assert step_and_grid(values, SIGMA) == (0.0, None)
    for values in (np.zeros(0), np.zeros(500), np.array([0.0, np.nan])):
        assert grid_of(values, 0.5) is None


def test_readings_go_back_on_the_grid_off_which_a_log_moved_them() -> None:
    step, true = 0.28097, swept()
    read = cells(true, step)
    logged = np.round(read, 2)
    records = [Record("log", 1e-3, {}, {"f": logged, "v": true}, {})]
    signals, (back,) = converted([Signal("f", "f", SIGMA), Signal("v", "v", SIGMA)], records)
    assert [s.step for s in signals] == [pytest.approx(step, rel=1e-5), 0.0]
    np.testing.assert_allclose(back.signals["f"], read, atol=2e-3)
    np.testing.assert_array_equal(back.signals["v"], true)


def test_long_gaps_are_counted_by_a_step_that_short_ones_make_sure() -> None:
    """A force at rest and in contact: 74 cells between both, of 0.12 or 0.13 as the log rounds."""
    step, generator = 0.12462, np.random.default_rng(3)
    rest = step * generator.integers(-1, 2, 4000)
    contact = step * (74 + generator.integers(0, 60, 4000) + 3 * generator.integers(0, 40, 4000))
    logged = np.round(np.concatenate([rest, contact]), 2)
    found, grid = step_and_grid(logged, 0.05)
    assert grid is not None
    assert found == pytest.approx(step, rel=1e-4)


@pytest.mark.parametrize(("quoted", "counted"), [(0.1, 0.1756), (0.2, 0.2)])
def test_a_quoted_noise_without_what_the_converter_leaves_gets_it(
    quoted: float, counted: float
) -> None:
    """0.5/sqrt(12) is 0.144: what is quoted above that has it."""
    records = [Record("log", 1e-3, {}, {"q": cells(swept(), 0.5)}, {})]
    ((signal,), _) = converted([Signal("q", "q", quoted)], records)
    assert signal.sigma == pytest.approx(counted, abs=1e-4)
    assert signal.white == pytest.approx(np.sqrt(counted**2 - 0.25 / 12), abs=1e-3)


def test_a_grid_goes_through_zero_where_readings_allow_and_says_what_rounding_leaves_open() -> None:
    """A log of so few digits moves cells to and fro; far from zero that tells the step best."""
    step, digits = 0.004_250_33, 2e-4
    number = np.arange(-145, 2)
    stored = digits * np.round(step * number / digits)
    grid = grid_of(stored, 0.00425)
    assert grid is not None
    assert grid.first == pytest.approx(-145 * grid.step, rel=1e-12)
    assert abs(grid.step - step) < grid.open < digits / 145
    aside = grid_of(stored + 0.4 * step, 0.00425)  # no cell at zero
    assert aside is not None
    assert aside.first == pytest.approx(-144.6 * step, abs=digits / 2)
    exact = grid_of(step * number, step)
    assert exact is not None
    assert exact.open < 1e-9 * step
