"""A force that swings is said; one that is held, or only noisy, is not."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pneugantry.analysis.limit_cycle import limit_cycle
from pyfmi_runner.log import Log


def log(force: np.ndarray) -> Log:
    n = len(force)
    zero = np.zeros(n)
    return Log(
        pd.DataFrame(
            {
                "f_x": zero,
                "f_z": force,
                "v_x": zero,
                "v_z": zero,
                "f_nd": zero + 30.0,
                "phase": zero + 2,
            }
        )
    )


def test_period_and_amplitude_of_a_swing() -> None:
    time = np.arange(9000) * 1e-3
    noise = np.random.default_rng(0).normal(0, 0.3, len(time))
    found = limit_cycle(log(30.0 + 5.0 * np.sin(2 * np.pi * time / 0.3) + noise))
    assert found is not None
    assert found.period == pytest.approx(0.3, abs=0.002)
    assert found.amplitude == pytest.approx(5.0, rel=0.02)


@pytest.mark.parametrize("kind", ["noise", "small", "ramp", "constant"])
def test_what_is_no_swing(kind: str) -> None:
    time = np.arange(9000) * 1e-3
    force = {
        "noise": np.random.default_rng(0).normal(30, 3, len(time)),
        "small": 30 + 0.5 * np.sin(20 * time),
        "ramp": 20 + 2 * time,
        "constant": 30 + 0 * time,
    }[kind]
    assert limit_cycle(log(force)) is None
