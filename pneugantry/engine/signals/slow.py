"""What a slow sensor's reading stands for: Wiener's filter.

A reading that comes late, behind a lag or as a mean over a window has lost what moved faster; its
inverse brings noise for it. The mean of what the signal may have been, given the reading, its noise
and a spectrum that falls with the third power of frequency (between that of a speed that jumps and
that of one whose acceleration does), loses as little as can be (Wiener, Extrapolation,
Interpolation and Smoothing of Stationary Time Series, 1949, ch. 3).
"""

from __future__ import annotations

from functools import lru_cache
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
        found = np.ones(len(omega), dtype=complex)
        if self.lag:
            found /= 1 + 1j * omega * self.lag
        if late := self.delay + 0.5 * self.window:
            found *= np.exp(-1j * omega * late)
        if self.window:
            found *= np.sinc(omega * self.window / (2 * np.pi))
        return found


def stood_for(reading: Array, slow: Slowness, sigma: float, period: float) -> Array:
    """Mean (N,) of a signal given its reading (N,), of white noise sigma. period: s, of a row."""
    rest = REST + int(4 * sum(slow) / period)
    rows = next_fast_len(len(reading) + 2 * rest)
    read = rfft(np.pad(reading, (rest, rows - rest - len(reading)), "edge"))
    omega, falls = _frequencies(rows, period)
    response = slow.response(omega)
    passed = response.real**2 + response.imag**2
    doubt = sigma**2 / _level(read[1:], passed[1:], falls[1:], sigma) * falls
    signal = np.conj(response) * read / (passed + doubt)
    return np.asarray(irfft(signal, rows)[rest : rest + len(reading)])


@lru_cache(maxsize=32)
def _frequencies(rows: int, period: float) -> tuple[Array, Array]:
    """Those (rows // 2 + 1,) of a transform, rad/s, and their power `FALL`."""
    omega = np.asarray(2 * np.pi * np.fft.rfftfreq(rows, period), dtype=float)
    return omega, omega**FALL


def _level(read: NDArray[np.complex128], passed: Array, falls: Array, sigma: float) -> float:
    """What the spectrum of a signal is at 1 rad/s, per row, as its sensor tells. passed: share of
    the signal's power; falls: frequencies, by the power `FALL`.
    """
    clear = passed > TOLD
    power = np.maximum(np.abs(read[clear]) ** 2 / (2 * len(read)) - sigma**2, 0.0) / passed[clear]
    return max(float(np.mean(falls[clear] * power)), 1e-12 * sigma**2)
