"""Whether a run's force swings in a limit cycle, which no RMSE tells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pneugantry.analysis.metrics import task_frame
from pyfmi_runner.log import PERIOD, PHASES, Log

__all__ = ["LimitCycle", "limit_cycle"]

LEAST_SWING = 1.0  # N RMS, 20 times the sensor's noise
# Autocorrelation one period later. Over the catalogue's controllers on the default plant: 0.87 and
# more where the straight edge makes one swing, 0.04 where it is held within the noise.
REPEATS = 0.5
SAME = 0.95  # of the highest autocorrelation: a multiple of the period is as high
SETTLING = 1 / 3  # of the contouring phase, left out


class LimitCycle(NamedTuple):
    period: float  # s
    amplitude: float  # N, of a sine of the same RMS


def limit_cycle(log: Log) -> LimitCycle | None:
    """Period and amplitude of a force error that repeats itself over the contouring phase; None
    where it does not. An edge with waves swings the force too: ask only for one without a finish.
    """
    rows = log["phase"] == PHASES.index("contour")
    error = (log["f_nd"] - task_frame(log).f_n)[rows]
    error = error[round(SETTLING * len(error)) :]
    swing = error - error.mean() if len(error) else error
    rms = float(np.sqrt(np.mean(swing**2))) if len(swing) else 0.0
    if rms < LEAST_SWING:
        return None
    lag, repeats = _repetition(swing)
    if repeats < REPEATS:
        return None
    return LimitCycle(lag * PERIOD, float(np.sqrt(2.0) * rms))


def _repetition(swing: NDArray[np.float64]) -> tuple[int, float]:
    """Lag [samples] of the highest autocorrelation past its first zero, and that
    autocorrelation.
    """
    n = len(swing)
    spectrum = np.fft.rfft(swing, 2 * n)
    power = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    correlation = power / power[0] * n / np.arange(n, 0, -1)
    negative = np.flatnonzero(correlation < 0)
    if len(negative) == 0 or negative[0] >= n // 2:
        return 0, 0.0
    first = int(negative[0])
    seen = correlation[first : n // 2]
    near = int(np.argmax(seen >= SAME * float(seen.max())))  # on the way up to the first such peak
    while near + 1 < len(seen) and seen[near + 1] > seen[near]:
        near += 1
    return first + near, float(seen[near])
