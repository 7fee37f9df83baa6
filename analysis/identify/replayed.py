"""The whole plant replayed over a campaign by its recorded commands: residuals in sensor noise, and how they move with each parameter."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from analysis.identify.parameters import Coordinates
from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.log import MEASURED, SIGMA, STROKE_X, STROKE_Z
from pyfmi_runner.replay import SIGMAS, Replayer

__all__ = ["ReplayedLog", "replayed_logs"]

Array = NDArray[np.float64]
FIRST_STEP = 1e-6  # theta, of the first difference quotient
MOVE = 3.0  # norm, in sensor noise, by which later difference steps move the residual: well inside what is linear
STEPS = (2e-8, 1e-4)  # theta, least and largest difference step
JUMP = 30.0  # sensor noise, of a speed within 3 ms
NEAR_STOP = 2e-3  # m
STOP_ROWS, TOUCH_ROWS = 10, 5  # samples either side of a jump that do not count
TOUCH = 0.8  # N
STROKE = {"x": STROKE_X, "z": STROKE_Z}
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
        self.weight = self._jumps()  # (samples, channels)

    def _matters(self, axis: str, name: str, contact: bool) -> bool:
        if name.startswith("valve_"):
            return True
        return contact and self._free["z"] if axis == "" else self._free[axis]

    def _jumps(self) -> Array:
        """1, and 0 about each instant at which a channel jumps: a replay that is half a sample late would be charged for a pulse there,
        and no derivative says so. A speed jumps at an end stop, a contact force at touch-down."""
        log = self.run.log
        weight = np.ones((len(log), len(MEASURED)))
        for axis in "xz":
            speed, position = log[f"v_{axis}"], log[axis]
            jump = np.abs(np.concatenate([speed[3:] - speed[:-3], np.zeros(3)])) > JUMP * SIGMA[f"v_{axis}"]
            at_stop = (position < NEAR_STOP) | (position > STROKE[axis] - NEAR_STOP)
            _mask(weight, MEASURED.index(f"v_{axis}"), np.flatnonzero(jump & at_stop), STOP_ROWS)
        force = np.hypot(log["f_x"], log["f_z"])
        loose = np.convolve(force < TOUCH, np.ones(10), mode="full")[: len(force)] >= 9
        landing = np.flatnonzero(loose[:-1] & (force[1:] >= TOUCH)) + 1
        for name in ("f_x", "f_z"):
            _mask(weight, MEASURED.index(name), landing, TOUCH_ROWS)
        return weight[:, self.columns]

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
        return np.asarray((values[: self.rows] * self.weight[: self.rows]).ravel())

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


def _mask(weight: Array, column: int, rows: NDArray[np.intp], reach: int) -> None:
    for row in rows:
        weight[max(0, row - reach) : row + reach + 1, column] = 0.0


def replayed_logs(campaign: Campaign, coordinates: Coordinates, replayer: Replayer) -> list[ReplayedLog]:
    return [ReplayedLog(run, coordinates, replayer) for run in campaign]
