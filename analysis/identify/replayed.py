"""The whole plant replayed over a campaign by its recorded commands: residuals in sensor noise, and how they move with each parameter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.identify.parameters import Coordinates
from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.log import MEASURED
from pyfmi_runner.replay import SIGMAS, Replayer

__all__ = ["ReplayedLog", "replayed_logs"]

Array = NDArray[np.float64]
FIRST_STEP = 1e-6  # theta, of the first difference quotient
MOVE = 3.0  # norm, in sensor noise, by which later difference steps move the residual: well inside what is linear
STEPS = (2e-8, 1e-4)  # theta, least and largest difference step
_SIDE = {"x": ("x", "v_x", "f_ax"), "z": ("z", "v_z", "f_x", "f_z", "f_az")}  # channels of an axis where nothing couples the two


class ReplayedLog:
    """One log under the plant. `rows`: how many of its samples count, from the first on."""

    def __init__(self, run: LoggedRun, coordinates: Coordinates, replayer: Replayer) -> None:
        self.run, self._coordinates, self._replayer = run, coordinates, replayer
        log = run.log
        self.name, self.rows = log.name, len(log)
        self.commands = np.column_stack([log["u_x"], log["u_z"]])
        self.measured = log.measured() / SIGMAS
        self._free = {axis: not run.setup.clamp_signal(axis, log.time).all() for axis in "xz"}
        contact = run.setup.workpiece != "none"
        flat = run.setup.workpiece == "straight" and not run.setup.surface_finish
        self.coupled = contact and not flat and self._free["x"]
        shown = {"x": self._free["x"], "v_x": self._free["x"], "z": self._free["z"], "v_z": self._free["z"], "f_ax": True, "f_az": True}
        shown |= {"f_x": contact and not flat, "f_z": contact}
        self.columns = np.array([i for i, name in enumerate(MEASURED) if shown[name]])
        self.moving = np.array([self._matters(u.axis, u.name, contact) for u in coordinates.unknowns])
        self._steps = np.full(len(self.moving), FIRST_STEP)
        self.weight: Array | float = 1.0  # (samples, channels) or 1

    def _matters(self, axis: str, name: str, contact: bool) -> bool:
        if name.startswith("valve_"):
            return True
        return contact and self._free["z"] if axis == "" else self._free[axis]

    def simulate(self, theta: Array, commands: Array | None = None) -> Array:
        """Outputs (samples, shown channels) in units of the sensors' noise."""
        values = self._coordinates.values(theta)
        driven = self.commands if commands is None else commands
        outputs = self._replayer.drive(self.run.setup, driven, self.run.log.time, values)
        return np.asarray((outputs / SIGMAS)[:, self.columns])

    def residual(self, theta: Array) -> Array:
        """(measured - simulated) / sigma, (samples, shown channels), unweighted, whether they count or not."""
        return self.measured[:, self.columns] - self.simulate(theta)

    def weighted(self, values: Array) -> Array:
        """The part that counts as a vector."""
        return np.asarray((values * self.weight)[: self.rows].ravel())

    def jacobian(self, theta: Array) -> Array:
        """d residual / d theta, (rows * channels, parameters), by forward differences whose steps follow the sensitivity."""
        base = self.simulate(theta)
        result = np.zeros((self.rows * len(self.columns), len(theta)))
        for group in self._groups():
            moved = theta.copy()
            for i in group:
                moved[i] += self._steps[i]
            change = (base - self.simulate(moved))[: self.rows]
            for i in group:
                column = change if len(group) == 1 else change * self._side(i)
                norm = float(np.sqrt(np.sum(column**2))) / self._steps[i]
                result[:, i] = self.weighted(column) / self._steps[i]
                self._steps[i] = float(np.clip(MOVE / norm, *STEPS)) if norm > 0 else FIRST_STEP
        return result

    def _groups(self) -> Iterator[tuple[int, ...]]:
        """Parameters moved together: one of each axis where the axes do not touch each other's channels."""
        moving = np.flatnonzero(self.moving)
        if self.coupled:
            yield from ((int(i),) for i in moving)
            return
        of_x = [int(i) for i in moving if self._coordinates.unknowns[i].axis == "x"]
        of_z = [int(i) for i in moving if self._coordinates.unknowns[i].axis != "x"]
        for k in range(max(len(of_x), len(of_z))):
            yield tuple(of_x[k : k + 1] + of_z[k : k + 1])

    def _side(self, i: int) -> Array:
        """1 for the channels that parameter i may move, 0 for the other axis'."""
        side = _SIDE["x" if self._coordinates.unknowns[i].axis == "x" else "z"]
        return np.array([1.0 if MEASURED[c] in side else 0.0 for c in self.columns])


def replayed_logs(campaign: Campaign, coordinates: Coordinates, replayer: Replayer) -> list[ReplayedLog]:
    return [ReplayedLog(run, coordinates, replayer) for run in campaign]
