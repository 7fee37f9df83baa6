"""What a coarse converter leaves of a signal is no white noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pneugantry.engine.fitting.noise import level_of, usual_size
from pneugantry.engine.plant import Plant, Record, Signal
from pneugantry.engine.views.synthetic import noisy

PERIOD, STEP = 1e-3, 0.2


def plant_of(sigma: float) -> Plant:
    error = float(np.hypot(sigma, STEP / np.sqrt(12)))
    signals = (Signal("f", "f", error, step=STEP), Signal("v", "v", 0.01))
    return Plant("none", Path("none.mo"), "None", (), signals, {}, (), {})


def coarse(true: np.ndarray, sigma: float) -> Record:
    read = true + sigma * np.random.default_rng(3).standard_normal(len(true))
    signals = {"f": STEP * np.round(read / STEP), "v": np.zeros(len(true))}
    return Record("log", PERIOD, {}, signals, {})


def drawn(true: np.ndarray, sigma: float) -> np.ndarray:
    """(draws, rows): what draws of noise add to f."""
    record = coarse(true, sigma)
    others = [
        noisy(plant_of(sigma), Record(f"log, draw {k}", PERIOD, {}, record.signals, {}), "f")
        for k in range(40)
    ]
    assert not any(np.any(o.signals["v"]) for o in others)
    return np.array([o.signals["f"] - record.signals["f"] for o in others])


def test_of_a_signal_at_rest_the_error_of_a_converter_lasts() -> None:
    errors = drawn(np.full(2000, 0.93), 0.0)
    assert np.ptp(errors, axis=1).max() < 1e-12
    assert np.abs(errors).max() <= STEP / 2
    assert np.std(errors[:, 0]) == pytest.approx(STEP / np.sqrt(12), rel=0.3)


def test_of_a_signal_that_moves_it_is_what_rounding_leaves() -> None:
    """A ramp crosses a cell in 50 rows: an error of its size, that hardly changes in ten."""
    true = 4e-3 * np.arange(4000)
    errors = drawn(true, 0.0)
    left = coarse(true, 0.0).signals["f"] - true
    assert np.std(errors) == pytest.approx(np.std(left), rel=0.05)
    for lag in (10, 25, 40):
        own, other = (np.mean(e[..., lag:] * e[..., :-lag]) for e in (errors, left))
        assert own == pytest.approx(other, abs=0.1 * np.var(left)), lag


def test_noise_that_crosses_cells_stays_white() -> None:
    errors = drawn(np.full(4000, 0.93), STEP)
    assert np.mean(errors[:, 1:] * errors[:, :-1]) < 0.25 * np.var(errors)


@pytest.mark.parametrize("sigma", [0.0, 0.1, 0.2, 0.5])
def test_a_mean_keeps_what_noise_does_not_spread_over_cells(sigma: float) -> None:
    """Against means of so many readings at rest, anywhere in a cell."""
    rows, draw = 50, np.random.default_rng(5)
    at = STEP * draw.random((4000, 1))
    read = at + sigma * STEP * draw.standard_normal((4000, rows))
    left = (STEP * np.round(read / STEP)).mean(axis=1) - at[:, 0]
    signal = plant_of(sigma * STEP).signals[0]
    assert signal.averaged(rows) == pytest.approx(np.std(left), rel=0.03)
    assert signal.averaged(1) == pytest.approx(signal.sigma)


def test_noise_that_reaches_no_other_cell_is_not_read() -> None:
    errors = drawn(np.full(2000, 0.93), 0.01 * STEP)
    assert np.mean(np.ptp(errors, axis=1) < 1e-12) > 0.8


def test_how_noisy_sensors_are_is_told_by_what_no_converter_hides() -> None:
    """Three channels of sensors 1.3 times as noisy as quoted, their converters as they are."""
    shares = (0.0, 0.2, 0.99)
    sizes = [usual_size(1.3, share) for share in shares]
    assert level_of(list(zip(sizes, shares, strict=True)), 0.6) == pytest.approx(1.3)
    assert level_of([(0.1, 0.99)], 0.6) == 1.0
    assert level_of([(0.1, 0.0)], 0.6) == 0.6
    assert usual_size(0.7, 1.0) == 1.0
