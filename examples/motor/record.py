"""The motor's logs, from a simulation that shares nothing with the model: `python -m
examples.motor.record`.

scipy integrates another law of friction (a smooth one) with other parameters than the data sheet's.
What is in the rig and not in the model: Coulomb friction of 0.15 N m, and a constant torque. A year
later (`worn_*.csv`) the friction is 0.22 N m.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

__all__ = ["CURRENTS", "main", "record"]

Array = NDArray[np.float64]
PERIOD = 5e-3  # s
LENGTH = 6.0  # s
NOISE = 0.02  # rad/s RMS, of the speed
J, K_T, B = 0.0204, 0.495, 0.021  # the rig's own: kg m2, N m/A, N m s/rad
TAU_C, TAU_O = 0.15, 0.06  # N m: what the data sheet does not hold
WORN = 0.22  # N m, Coulomb friction a year later
SMOOTH = 0.02  # rad/s, width of the friction's change of sign


def _sines(t: float) -> float:
    return 1.4 * float(np.sin(2.0 * t) + 0.5 * np.sin(5.3 * t + 1.0))


def _steps(t: float) -> float:
    return (1.5, -1.2, 0.9, -1.6)[int(t / 1.5) % 4]


CURRENTS: dict[str, Callable[[float], float]] = {"sines": _sines, "steps": _steps}  # A


def record(current: Callable[[float], float], seed: int, tau_c: float = TAU_C) -> pd.DataFrame:
    """time [s], i [A], w [rad/s] with noise; the current is held over each period. tau_c: Coulomb
    friction [N m].
    """
    time = np.arange(0.0, LENGTH, PERIOD)
    held = np.array([round(current(t), 3) for t in time])
    state, speeds = np.zeros(2), []
    for k in range(len(time)):
        speeds.append(state[1])

        def rates(_: float, y: Array, i: float = held[k]) -> list[float]:
            friction = B * y[1] + tau_c * np.tanh(y[1] / SMOOTH)
            return [y[1], (K_T * i - friction + TAU_O) / J]

        state = solve_ivp(rates, (0.0, PERIOD), state, "LSODA", rtol=1e-9, atol=1e-11).y[:, -1]
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(time))
    return pd.DataFrame({"time": time.round(6), "i": held, "w": np.round(speeds + noise, 4)})


def main(folder: Path = Path(__file__).parent / "data") -> None:
    """Writes one CSV per current, and one of the worn motor."""
    for seed, (name, current) in enumerate(CURRENTS.items(), start=1):
        for prefix, first, tau_c in (("", 0, TAU_C), ("worn_", 10, WORN)):
            path = folder / f"{prefix}{name}.csv"
            record(current, first + seed, tau_c).to_csv(path, index=False)
            print(path)


if __name__ == "__main__":
    main()
