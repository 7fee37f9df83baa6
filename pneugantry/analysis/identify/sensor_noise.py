"""Noise of the sensors from stretches in which nothing moves (section 3.2, Table 3.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.log import MEASURED, SIGMA

__all__ = ["Noise", "sensor_noise"]

FULL_SCALE = {
    "f_x": 250.0,
    "f_z": 250.0,
    "v_x": 1.0,
    "v_z": 1.0,
    "x": 1.0,
    "z": 0.101,
    "f_ax": 400.0,
    "f_az": 157.0,
}  # Table 3.3
WINDOW = 50  # samples that are put straight before their scatter is taken
STILL = 1500  # samples since the command last moved: ten lags of z, five of x


@dataclass(frozen=True)
class Noise:
    """A row of Table 3.3. low, high: 95 % interval of the RMS; snr: 20 log10(full scale / RMS),
    infinite for a channel that does not move at all, as of a simulation without noise.
    """

    channel: str
    rms: float
    low: float
    high: float
    snr: float
    printed: float  # RMS in Table 3.3
    samples: int


def sensor_noise(campaign: Campaign) -> list[Noise]:
    """Every channel over the stretches in which it is at rest: positions and speeds of a clamped
    axis, contact forces without a workpiece, actuator forces once the command has rested long
    enough. Straightened over 50 ms; empty stretches leave a channel out.
    """
    found = []
    for channel in MEASURED:
        squares, freedom = 0.0, 0
        for run in campaign:
            windows = _windows(run, channel)
            t = np.linspace(-1.0, 1.0, WINDOW)
            rest = windows - windows.mean(axis=1, keepdims=True)
            rest -= np.outer(windows @ t, t) / (t @ t)
            squares += float(np.sum(rest**2))
            freedom += len(windows) * (WINDOW - 2)
        if freedom:
            rms = math.sqrt(squares / freedom)
            low, high = (math.sqrt(squares / float(chdtri(freedom, p))) for p in (0.025, 0.975))
            found.append(
                Noise(
                    channel,
                    rms,
                    low,
                    high,
                    20 * math.log10(FULL_SCALE[channel] / rms) if rms else math.inf,
                    SIGMA[channel],
                    freedom,
                )
            )
    return found


def _windows(run: LoggedRun, channel: str) -> NDArray[np.float64]:
    """(windows, WINDOW) readings at rest."""
    log, setup = run.log, run.setup
    axis = channel[-1]
    if channel in ("f_x", "f_z"):
        still = np.full(len(log), setup.workpiece == "none")
    elif channel.startswith("f_a"):
        moves = np.flatnonzero(np.diff(log[f"u_{axis}"], prepend=log[f"u_{axis}"][0] + 1.0))
        last = moves[np.searchsorted(moves, np.arange(len(log)), side="right") - 1]
        off = log[f"u_{axis}"] < 0.5  # a shut valve stays at 0 from the start
        still = (np.arange(len(log)) - last >= STILL - 2 * WINDOW) | (off & (last == 0))
    else:
        still = setup.clamp_signal(axis, log.time)
    rows = len(log) // WINDOW * WINDOW
    at_rest = still[:rows].reshape(-1, WINDOW).all(axis=1)
    return np.asarray(log[channel][:rows].reshape(-1, WINDOW)[at_rest])
