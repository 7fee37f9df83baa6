"""The whole plant replayed over a campaign by its recorded commands: residuals in sensor noise, and
how they move with each parameter.
"""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pneugantry.analysis.identify.parameters import Coordinates
from pneugantry.analysis.identify.rounding import other_rounding, programmed
from pneugantry.analysis.identify.signals import STROKE, landings
from pyfmi_runner.campaign import Campaign, LoggedRun, LogSetup
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import MEASURED, SIGMA
from pyfmi_runner.replay import SIGMAS, Replayer

__all__ = ["Plants", "ReplayedLog", "gram", "replayed_logs", "share_steps"]

Array = NDArray[np.float64]
S = TypeVar("S")
T = TypeVar("T")
# samples added up into one residual: the plant does nothing within 4 ms, and the noise stays white
BLOCK = 4
FIRST_STEP = 1e-6  # theta, of the first difference quotient
# norm, in sensor noise, by which later difference steps move the residual: well inside what is
# linear
MOVE = 3.0
WIDER = 6.0  # times that, for central differences
STEPS = (2e-8, 1e-4)  # theta, least and largest difference step
JUMP = 30.0  # sensor noise, of a speed within 3 ms
NEAR_STOP = 2e-3  # m
STOP_ROWS, TOUCH_ROWS = 10, 5  # samples either side of a jump that do not count
_SIDE = {
    "x": ("x", "v_x", "f_ax"),
    "z": ("z", "v_z", "f_x", "f_z", "f_az"),
}  # channels of an axis where nothing couples the two


class Plants:
    """A few instances of the gantry FMU, each lent to one thread at a time; used in a `with`."""

    def __init__(self, file: FmuFile, count: int = 2) -> None:
        self._file, self._count = file, count
        self._idle: queue.SimpleQueue[Replayer] = queue.SimpleQueue()
        self._stack = ExitStack()

    def __enter__(self) -> Plants:
        for _ in range(self._count):
            self._idle.put(self._stack.enter_context(Replayer(self._file)))
        self._threads = self._stack.enter_context(ThreadPoolExecutor(self._count))
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def drive(
        self, setup: LogSetup, commands: Array, time: Array, values: dict[str, float]
    ) -> Array:
        """As `Replayer.drive`, on whichever instance is idle."""
        replayer = self._idle.get()
        try:
            return replayer.drive(setup, commands, time, values)
        finally:
            self._idle.put(replayer)

    def each(self, work: Callable[[ReplayedLog], T], logs: Sequence[ReplayedLog]) -> list[T]:
        """work(log) of every log in the logs' order, the longest jobs first."""
        order = sorted(range(len(logs)), key=lambda i: -logs[i].effort)
        jobs = {i: self._threads.submit(work, logs[i]) for i in order}
        return [jobs[i].result() for i in range(len(logs))]

    def side_by_side(self, work: Callable[[S], T], of: Sequence[S]) -> list[T]:
        """work of each, on the same threads."""
        return list(self._threads.map(work, of))


class ReplayedLog:
    """One log under the plant. `rows`: how many of its samples count, from the first on."""

    def __init__(self, run: LoggedRun, coordinates: Coordinates, plants: Plants) -> None:
        self.run, self._coordinates, self._plants = run, coordinates, plants
        log = run.log
        self.name, self.rows = log.name, len(log)
        self.commands = np.column_stack([programmed(log["u_x"]), programmed(log["u_z"])])
        self.rounded = bool(
            (other_rounding(self.commands, np.random.default_rng(0)) != self.commands).any()
        )
        self._free = {axis: not run.setup.clamp_signal(axis, log.time).all() for axis in "xz"}
        contact = run.setup.workpiece != "none"
        flat = run.setup.workpiece == "straight" and not run.setup.surface_finish
        self.coupled = contact and not flat and self._free["x"]
        shown = {
            "x": self._free["x"],
            "v_x": self._free["x"],
            "z": self._free["z"],
            "v_z": self._free["z"],
            "f_ax": True,
            "f_az": True,
        }
        shown |= {"f_x": contact and not flat, "f_z": contact}
        self.columns = np.array([i for i, name in enumerate(MEASURED) if shown[name]])
        self.measured = (log.measured() / SIGMAS)[:, self.columns]
        self.moving = np.array(
            [self._matters(u.axis, u.name, contact) for u in coordinates.unknowns]
        )
        self.groups = tuple(self._grouped())
        self.steps = np.full(len(self.moving), np.nan)  # of theta, for differences; NaN: not known
        # the last replay and the last Jacobian, with where they were taken
        self._last: tuple[bytes, Array] | None = None
        self._kept: tuple[bytes, bool, Array] | None = None
        self.counts = self._without_jumps()

    @property
    def whole(self) -> bool:
        """Every sample counts."""
        return self.rows == len(self.measured)

    @property
    def steady(self) -> bool:
        """Both axes are clamped throughout: nothing that could part."""
        return not any(self._free.values())

    @property
    def effort(self) -> int:
        """Samples that a Jacobian simulates."""
        return len(self.measured) * len(self.groups)

    def _matters(self, axis: str, name: str, contact: bool) -> bool:
        if name.startswith("valve_"):
            return True
        return contact and self._free["z"] if axis == "" else self._free[axis]

    def _grouped(self) -> Iterator[tuple[int, ...]]:
        """Parameters moved together: one of each axis where the axes do not touch each other's
        channels.
        """
        moving = [int(i) for i in np.flatnonzero(self.moving)]
        if self.coupled:
            yield from ((i,) for i in moving)
            return
        of_x = [i for i in moving if self._coordinates.unknowns[i].axis == "x"]
        of_z = [i for i in moving if self._coordinates.unknowns[i].axis != "x"]
        for k in range(max(len(of_x), len(of_z))):
            yield tuple(of_x[k : k + 1] + of_z[k : k + 1])

    def _without_jumps(self) -> Array:
        """(samples, shown channels): 1, and 0 about each instant at which a channel jumps.

        A replay that is half a sample late would be charged for a pulse there, and no derivative
        says so. A speed jumps at an end stop, a contact force at touch-down.
        """
        log = self.run.log
        counts = np.ones((len(log), len(MEASURED)))
        for axis in "xz":
            speed, position = log[f"v_{axis}"], log[axis]
            jump = (
                np.abs(np.concatenate([speed[3:] - speed[:-3], np.zeros(3)]))
                > JUMP * SIGMA[f"v_{axis}"]
            )
            at_stop = (position < NEAR_STOP) | (position > STROKE[axis] - NEAR_STOP)
            _mask(counts, MEASURED.index(f"v_{axis}"), np.flatnonzero(jump & at_stop), STOP_ROWS)
        for name in ("f_x", "f_z"):
            _mask(counts, MEASURED.index(name), landings(log), TOUCH_ROWS)
        return counts[:, self.columns]

    def simulate(self, theta: Array, commands: Array | None = None) -> Array:
        """Outputs (samples, shown channels) in units of the sensors' noise."""
        driven = self.commands if commands is None else commands
        outputs = self._plants.drive(
            self.run.setup, driven, self.run.log.time, self._coordinates.values(theta)
        )
        return np.asarray((outputs / SIGMAS)[:, self.columns])

    def residual(self, theta: Array) -> Array:
        """(measured - simulated) / sigma, (samples, shown channels); 0 about jumps."""
        return np.asarray((self.measured - self.replay(theta)) * self.counts)

    def replay(self, theta: Array) -> Array:
        """As `simulate` by the log's own commands; the last one is kept."""
        if self._last is None or self._last[0] != theta.tobytes():
            self._last = theta.tobytes(), self.simulate(theta)
        return self._last[1]

    def vector(self, values: Array) -> Array:
        """What counts of a residual (samples, shown channels): sums over blocks, noise 1; (blocks *
        channels,).
        """
        return self._blocks(values)[: self._entries]

    def _blocks(self, values: Array) -> Array:
        """As `vector`, of the whole log."""
        n = len(values) // BLOCK
        shape = (n, BLOCK, len(self.columns))
        held = self.counts[: n * BLOCK].reshape(shape).sum(axis=1)
        sums = (values * self.counts)[: n * BLOCK].reshape(shape).sum(axis=1)
        return np.asarray((sums / np.sqrt(np.maximum(held, 1.0))).ravel())

    def jacobian(self, theta: Array, central: bool = False) -> Array:
        """d vector(residual) / d theta, (blocks * channels, parameters), by differences whose steps
        follow the sensitivity.

        Forward differences are a few percent off, which is enough to walk by. The columns are
        nearly dependent, though, so intervals need central ones, about 0.05 % off: curvature
        cancels, and a wide step outweighs the small jumps that events make.
        """
        central = central and self.coupled
        if self._kept is None or self._kept[:2] != (theta.tobytes(), central):
            self._kept = (theta.tobytes(), central, self._differences(theta, central))
        return self._kept[2][: self._entries]

    def curvature(self, theta: Array, central: bool = False) -> Array:
        """J'J at theta, (parameters, parameters)."""
        return gram(self.jacobian(theta, central))

    def slope(self, theta: Array, at: Array, central: bool = False) -> tuple[Array, float]:
        """(J'r, r'r): the residual at theta, the Jacobian that of `at`."""
        residual = self.vector(self.residual(theta))
        jacobian = self.jacobian(at, central)
        return np.einsum("ki,k->i", jacobian, residual), float(np.sum(residual**2))

    def _differences(self, theta: Array, central: bool) -> Array:
        """Jacobian of the whole log."""
        base = None if central else self.replay(theta)
        result = np.zeros((len(self.measured) // BLOCK * len(self.columns), len(theta)), order="F")
        for group in self.groups:
            chosen, step = list(group), np.zeros(len(theta))
            known = np.nan_to_num(self.steps[chosen], nan=FIRST_STEP)
            step[chosen] = known * (WIDER if central else 1.0)
            ahead = self.simulate(theta + step)
            change = (self.simulate(theta - step) - ahead) / 2 if base is None else base - ahead
            for i in group:
                column = (
                    self._blocks(change if len(group) == 1 else change * self._side(i)) / step[i]
                )
                # of what counts: behind a missed event a column is wild; no BLAS, whose threads
                # would fight those of the logs
                norm = float(np.sqrt(np.sum(column[: self._entries] ** 2)))
                result[:, i] = column
                self.steps[i] = float(np.clip(MOVE / norm, *STEPS)) if norm > 0 else FIRST_STEP
        return result

    @property
    def _entries(self) -> int:
        """Length of `vector`."""
        return self.rows // BLOCK * len(self.columns)

    def _side(self, i: int) -> Array:
        """1 for the channels that parameter i may move, 0 for the other axis'."""
        side = _SIDE["x" if self._coordinates.unknowns[i].axis == "x" else "z"]
        return np.array([1.0 if MEASURED[c] in side else 0.0 for c in self.columns])


def share_steps(logs: Sequence[ReplayedLog]) -> None:
    """Logs that know no difference steps yet take the least that others have found."""
    least = np.fmin.reduce([log.steps for log in logs])
    for log in logs:
        log.steps = np.where(np.isnan(log.steps), least, log.steps)


def gram(jacobian: Array) -> Array:
    """J'J, on the calling thread alone: several logs are at it, and a threaded BLAS would get in
    its own way.
    """
    return np.asarray(np.einsum("ki,kj->ij", jacobian, jacobian))


def _mask(counts: Array, column: int, rows: NDArray[np.intp], reach: int) -> None:
    for row in rows:
        counts[max(0, row - reach) : row + reach + 1, column] = 0.0


def replayed_logs(
    campaign: Campaign, coordinates: Coordinates, plants: Plants
) -> list[ReplayedLog]:
    return [ReplayedLog(run, coordinates, plants) for run in campaign]
