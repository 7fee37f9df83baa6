"""Least squares on the inverse model (IDIM-LS): motor force as a linear function of the measured
motion, both behind one low-pass.

Position is differentiated behind a zero-phase Butterworth filter; force and regressors are then
decimated together. The two cut-offs are chosen: with them the published force errors on the train
record come out (lower ones leave less of the error).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.io import loadmat

__all__ = ["RUNGS", "Axis", "Rung", "ladder", "read_axis"]

Array = NDArray[np.float64]
PERIOD = 1e-3  # s
CUT_OFF = 150.0  # Hz, of the differentiation
DECIMATE = 10  # samples to one: below 50 Hz
RUNGS = ("inertia", "viscous", "coulomb", "offset", "asymmetric")


@dataclass(frozen=True, eq=False)
class Axis:
    """One record, with the motion behind the low-pass."""

    force: Array  # N, of the motor, unfiltered
    position: Array  # m
    velocity: Array
    acceleration: Array

    def regressors(self, rung: str) -> Array:
        """(N, parameters): M; F_v; F_c; offset. Asymmetric: M, F_v+, F_v-, F_c+, F_c-."""
        v, sign = self.velocity, np.sign(self.velocity)
        if rung == "asymmetric":
            return np.column_stack(
                [self.acceleration, v * (v > 0), v * (v < 0), 1.0 * (v > 0), -1.0 * (v < 0)]
            )
        return np.column_stack([self.acceleration, v, sign, np.ones_like(v)])[
            :, : 1 + RUNGS.index(rung)
        ]

    def decimated(self, rung: str) -> tuple[Array, Array]:
        columns = signal.decimate(self.regressors(rung), DECIMATE, ftype="fir", axis=0)
        return columns, signal.decimate(self.force, DECIMATE, ftype="fir")

    def fit(self, rung: str) -> Array:
        """Parameters of least squares."""
        columns, force = self.decimated(rung)
        return np.asarray(np.linalg.lstsq(columns, force, rcond=None)[0])

    def error(self, rung: str, parameters: Array) -> float:
        """|force - model| / |force|."""
        columns, force = self.decimated(rung)
        return float(np.linalg.norm(force - columns @ parameters) / np.linalg.norm(force))


@dataclass(frozen=True)
class Rung:
    """A rung's parameters, and its force errors on the record it was fitted on and on the other."""

    parameters: Array
    train: float
    pulses: float


def read_axis(path: Path) -> Axis:
    data = {
        name: np.asarray(values, dtype=np.float64).ravel()
        for name, values in loadmat(path).items()
        if not name.startswith("__")
    }
    b, a = signal.butter(4, CUT_OFF * 2 * PERIOD)
    smooth = signal.filtfilt(b, a, data["qm"])
    velocity = np.gradient(smooth, PERIOD)
    return Axis(data["gtau"][0] * data["vir"], data["qm"], velocity, np.gradient(velocity, PERIOD))


def ladder(train: Axis, pulses: Axis) -> dict[str, Rung]:
    """Every rung, fitted on `train`."""
    fitted = {rung: train.fit(rung) for rung in RUNGS}
    return {
        rung: Rung(p, train.error(rung, p), pulses.error(rung, p)) for rung, p in fitted.items()
    }
