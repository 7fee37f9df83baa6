"""Whether the two valve commands of a log are swapped: each force must follow its own valve."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pyfmi_runner.first_order import first_order

__all__ = ["commands_swapped"]

Array = NDArray[np.float64]
VALVES = {"x": (0.3, 0.635), "z": (0.15, 0.735)}  # tau [s], u_0 [V]: the plant sheet
QUIET = 4.0  # N^2, mean square of a force that says nothing
# Share of a force's power that its own valve leaves: 0.03 at most over 42 logs of six rigs, with
# effects in valve and friction; swapped it is 0.06 at least, and 35 times the own or more.
LEFT = 0.04
RATIO = 0.1


def commands_swapped(command: Mapping[str, Array], force: Mapping[str, Array], dt: float) -> bool:
    """command: u [V] by axis; force: actuator forces [N] by axis; shape (n,) each. True where
    each force follows the other axis' valve and not its own.
    """
    own = sum(_unexplained(a, command[a], force[a], dt) for a in "xz")
    if own <= LEFT:
        return False
    crossed = sum(_unexplained(a, command[b], force[a], dt) for a, b in (("x", "z"), ("z", "x")))
    return crossed < RATIO * own


def _unexplained(axis: str, command: Array, force: Array, dt: float) -> float:
    """Share of a force's power that a command through this axis' nominal valve leaves, at the best
    gain.
    """
    tau, u_0 = VALVES[axis]
    share = dt / tau
    driven = first_order(np.maximum(command - u_0, 0.0), share, 1.0 - share)
    size = np.abs(force)
    power = max(float(size @ size), QUIET * len(size))
    gain = float(driven @ size) / max(float(driven @ driven), 1e-12)
    return float(np.sum((size - gain * driven) ** 2)) / power
