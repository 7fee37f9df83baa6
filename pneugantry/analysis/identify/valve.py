"""The thesis' valve tests (section 4.1.3, Tables 4.1-4.5): lag at each step by the 65 % rule and by
fit, K and u_0.

The thesis takes the time to 65 % of a step for tau; a first-order lag passes 65 % at 1.05 tau, so
tau_65 is that time / 1.0498.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import fdtrc

from pneugantry.analysis.identify.interval import Estimate, Line, line, quantile
from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.log import PERIOD, SIGMA

__all__ = ["Comparison", "Step", "comparisons", "steady_line", "steps"]

Array = NDArray[np.float64]
PART = 0.65
FULL = -math.log(1.0 - PART)  # 1.0498: a first-order lag reaches 65 % after so many tau
SHORTEST = 500  # samples of a plateau that counts
LEAST_STEP = 2.0  # N, 40 times the sensor's noise
SMOOTH = (
    10  # samples either side over which the force is averaged before the 65 % crossing is sought
)
STEPPED = 3  # plateaus from which on a log is a test by steps


@dataclass(frozen=True)
class Step:
    """One step of the command with the axis held still: a row of Tables 4.1-4.5."""

    log: str
    axis: str
    position: float  # m
    u_from: float  # V
    u_to: float  # V
    f_from: float  # N, steady force before
    f_to: float  # N, steady force after, extrapolated by the fit
    time_65: float  # s, to 65 % of the change, as the thesis prints it
    tau_65: Estimate  # s, that time / 1.0498
    tau: Estimate  # s, by an exponential through the whole plateau

    @property
    def filling(self) -> bool:
        """The chamber is being pressurised."""
        return abs(self.f_to) > abs(self.f_from)


def _plateaus(command: Array) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(command)) + 1
    bounds = np.concatenate([[0], edges, [len(command)]])
    return [(int(a), int(b)) for a, b in pairwise(bounds)]


def steps(campaign: Campaign, axis: str) -> list[Step]:
    """Every step between plateaus of at least 0.5 s while the axis is clamped, in the order of the
    logs.
    """
    found = []
    for run in campaign:
        plateaus = _plateaus(run.log[f"u_{axis}"])
        clamped = run.setup.clamp_signal(axis, run.log.time)
        if sum(b - a >= SHORTEST for a, b in plateaus) < STEPPED:
            continue
        for (a, b), (c, d) in pairwise(plateaus):
            if b - a >= SHORTEST and d - c >= SHORTEST and clamped[a:d].all():
                step = _step(run, axis, (a, b, d))
                if step is not None:
                    found.append(step)
    return found


def _step(run: LoggedRun, axis: str, rows: tuple[int, int, int]) -> Step | None:
    a, b, d = rows
    log = run.log
    force, command = log[f"f_a{axis}"], log[f"u_{axis}"]
    # the previous plateau may not have come to rest: the force that the step starts from is the one
    # at its instant
    lead = np.arange(-60, 0)
    start = float(np.polyval(np.polyfit(lead, force[b - 60 : b], 1), 0.0))
    fitted = _exponential(force[b:d], start)
    if fitted is None:
        return None
    end, tau = fitted
    if abs(end - start) < LEAST_STEP:
        return None
    position = float(np.mean(log[axis][a:d]))
    time_65, sigma_65 = _crossing(force[b:d], start, end)
    return Step(
        run.log.name,
        axis,
        position,
        float(command[b - 1]),
        float(command[b]),
        start,
        end,
        time_65,
        Estimate(time_65 / FULL, sigma_65 / FULL),
        tau,
    )


def _exponential(force: Array, start: float) -> tuple[float, Estimate] | None:
    """(steady force, tau) of an exponential from `start`, free in all three; the start's value is
    only the first guess.
    """
    t = np.arange(len(force)) * PERIOD
    end = float(force[-len(force) // 5 :].mean())
    guess = np.array([start, end, max(_crossing(force, start, end)[0] / FULL, 2e-3)])

    def residual(p: Array) -> Array:
        return np.asarray(
            (p[1] + (p[0] - p[1]) * np.exp(-t / max(p[2], 1e-4)) - force) / SIGMA["f_ax"]
        )

    found = least_squares(residual, guess, x_scale=np.abs(guess) + 1e-3)
    information = found.jac.T @ found.jac
    if np.linalg.cond(information) > 1e18:
        return None
    freedom = len(force) - 3
    scale = max(1.0, math.sqrt(2 * found.cost / freedom))
    sigma = scale * math.sqrt(float(np.linalg.inv(information)[2, 2]))
    return float(found.x[1]), Estimate(float(found.x[2]), sigma, quantile(freedom))


def _crossing(force: Array, start: float, end: float) -> tuple[float, float]:
    """(time to 65 % of the change, its standard deviation) in s; (NaN, NaN) where it is not
    reached.
    """
    kernel = np.ones(2 * SMOOTH + 1) / (2 * SMOOTH + 1)
    share = (np.convolve(np.pad(force, SMOOTH, mode="edge"), kernel, mode="valid") - start) / (
        end - start
    )
    beyond = np.flatnonzero(share >= PART)
    if len(beyond) == 0:
        return math.nan, math.nan
    k = int(beyond[0])
    part = (PART - share[k - 1]) / (share[k] - share[k - 1]) if k > 0 else 0.0
    time = (k - 1 + part if k > 0 else 0.0) * PERIOD
    slope = (
        abs(end - start) * (1 - PART) * FULL / max(time, PERIOD)
    )  # N/s, of a first-order lag there
    return time, SIGMA["f_ax"] / math.sqrt(2 * SMOOTH + 1) / slope


def steady_line(found: Sequence[Step]) -> Line | None:
    """Steady force over command: slope is direction * K, zero is u_0. None for fewer than three
    levels.
    """
    u, f = np.array([s.u_to for s in found]), np.array([s.f_to for s in found])
    return line(u, f) if len(found) >= 3 and np.ptp(u) > 0 else None


@dataclass(frozen=True)
class Comparison:
    """Whether tau depends on something: what a group of steps has more than the other, and an F
    test of it.
    """

    question: str
    difference: Estimate  # s, or s per m
    share: float  # of the mean tau, between the extremes
    p: float  # chance of so large an F where nothing depends


def comparisons(found: Sequence[Step]) -> list[Comparison]:
    """Does tau (by fit) depend on position, on filling or exhausting? Weighted regression on both
    at once.
    """
    if len(found) < 4:
        return []
    tau = np.array([s.tau.value for s in found])
    sigma = np.array([s.tau.sigma for s in found])
    position = np.array([s.position for s in found])
    filling = np.array([1.0 if s.filling else 0.0 for s in found])
    average = float(np.average(tau, weights=sigma**-2))
    result = []
    for question, column, span in (
        ("position, towards +axis [s/m]", position, float(np.ptp(position))),
        ("filling against exhausting [s]", filling, 1.0),
    ):
        if np.ptp(column) < 1e-3:
            continue
        others = [c for c in (position, filling) if c is not column and np.ptp(c) >= 1e-3]
        design = np.column_stack([column, np.ones(len(tau)), *others]) / sigma[:, None]
        rest = _squares(design, tau / sigma)
        freedom = len(tau) - design.shape[1]
        scale = max(1.0, rest / freedom)
        variance = float(np.linalg.inv(design.T @ design)[0, 0]) * scale
        slope = float(np.linalg.lstsq(design, tau / sigma, rcond=None)[0][0])
        p = float(fdtrc(1, freedom, slope**2 / variance))
        result.append(
            Comparison(
                question,
                Estimate(slope, math.sqrt(variance), quantile(freedom)),
                slope * span / average,
                p,
            )
        )
    return result


def _squares(design: Array, y: Array) -> float:
    found, *_ = np.linalg.lstsq(design, y, rcond=None)
    return float(np.sum((y - design @ found) ** 2))
