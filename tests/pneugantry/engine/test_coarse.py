"""What a coarse converter leaves of a signal is no white noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

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
