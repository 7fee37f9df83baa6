"""What a slow sensor's reading stands for: Wiener's filter.

A reading that comes late, behind a lag or as a mean over a window has lost what moved faster; its
inverse brings noise for it. The mean of what the signal may have been, given the reading, its noise
and a spectrum that falls with the third power of frequency (between that of a speed that jumps and
that of one whose acceleration does), loses as little as can be (Wiener, Extrapolation,
Interpolation and Smoothing of Stationary Time Series, 1949, ch. 3).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from pneugantry.engine.plant import Array

__all__ = ["Slowness", "stood_for"]

FALL = 3  # power of frequency with which the spectrum of a signal falls
TOLD = 0.5  # share of a signal's power that its sensor lets through where it tells the spectrum
REST = 512  # rows before the first and behind the last in which it stays as it was there


class Slowness(NamedTuple):
    """Of a sensor, s."""

    lag: float
    delay: float
    window: float

    def response(self, omega: Array) -> NDArray[np.complex128]:
        """Reading per signal at frequencies in rad/s."""
        mean = np.sinc(omega * self.window / (2 * np.pi))
        late = np.exp(-1j * omega * (self.delay + 0.5 * self.window))
        return np.asarray(mean * late / (1 + 1j * omega * self.lag))


def stood_for(reading: Array, slow: Slowness, sigma: float, period: float) -> Array:
    """Mean (N,) of a signal given its reading (N,), of white noise sigma. period: s, of a row."""
    rest = REST + int(4 * sum(slow) / period)
    rows = next_fast_len(len(reading) + 2 * rest)
    read = rfft(np.pad(reading, (rest, rows - rest - len(reading)), "edge"))
    omega = np.asarray(2 * np.pi * np.fft.rfftfreq(rows, period), dtype=float)
    response = slow.response(omega)
    doubt = sigma**2 * omega**FALL / _level(read[1:], response[1:], omega[1:], sigma)
    signal = np.conj(response) * read / (np.abs(response) ** 2 + doubt)
    return np.asarray(irfft(signal, rows)[rest : rest + len(reading)])


def _level(
    read: NDArray[np.complex128],
    response: NDArray[np.complex128],
    omega: Array,
    sigma: float,
) -> float:
    """What the spectrum of a signal is at 1 rad/s, per row, as its sensor tells."""
    passed = np.abs(response) ** 2
    clear = passed > TOLD
    power = np.maximum(np.abs(read[clear]) ** 2 / (2 * len(read)) - sigma**2, 0.0) / passed[clear]
    return max(float(np.mean(omega[clear] ** FALL * power)), 1e-12 * sigma**2)
