"""The force loop closed around the FMU itself in co-simulation, sampled as the controller is: does
it decay or grow?
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controllers.interface import clip_command
from pneugantry.analysis.force_loop import ForceLoop
from pneugantry.analysis.operating_point import open_at
from pyfmi_runner.timing import MICROSECOND, LoopTiming

__all__ = [
    "CONTINUOUS",
    "Growth",
    "cosimulated_growth",
    "cosimulated_limit",
    "proportional_run",
]

# N, first error of the reference: small, so that contact and valve limits stay out of reach
KICK = 0.02
# s, a period so short that the loop is as good as continuous (0.15 % of the limit gain at most)
CONTINUOUS = 5e-5
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Growth:
    """The slowest oscillation of a closed loop."""

    rate: float  # 1/s, > 0: it grows, the loop is unstable
    frequency: float  # rad/s


def proportional_run(
    loop: ForceLoop, gain: float, *, period: float = 1e-3, duration: float = 2.0, kick: float = KICK
) -> Array:
    """Deviation of the force [N] from the operating point at each sample of the FMU under u = u_0 +
    gain (r - f).

    The reference r stands `kick` N above the operating point's force for the first 10 ms. The
    command from the sample at t_k acts from t_k + delay on (the loop's own delay). gain: V/N;
    period, duration: s.
    """
    timing = LoopTiming(period, loop.delay)
    every, late = round(timing.period / MICROSECOND), round(timing.delay / MICROSECOND)
    u_0, output = loop.point.inputs[loop.command], f"f_{loop.axis}"
    samples = round(duration / period)
    force, waiting = np.empty(samples), deque[tuple[int, float]]()
    with open_at(loop.file, loop.point, "cs") as fmu:
        level = loop.sign * fmu.get(output)
        for k in range(samples):
            now, end = k * every, (k + 1) * every
            force[k] = loop.sign * fmu.get(output) - level
            reference = kick if k * period < 0.01 else 0.0
            waiting.append((now + late, clip_command(u_0 + gain * (reference - force[k]))))
            while waiting and waiting[0][0] < end:
                acts, u = waiting.popleft()
                if acts > now:
                    fmu.step((acts - now) * MICROSECOND, time=now * MICROSECOND)
                    now = acts
                fmu.set(loop.command, u)
            fmu.step((end - now) * MICROSECOND, time=now * MICROSECOND)
    return force


def cosimulated_growth(
    loop: ForceLoop, gain: float, *, period: float = 1e-3, duration: float = 2.0
) -> Growth:
    """Growth of the FMU's closed loop, fitted to the second half of a run."""
    return fitted_growth(
        proportional_run(loop, gain, period=period, duration=duration), period, loop
    )


def fitted_growth(force: Array, period: float, loop: ForceLoop) -> Growth:
    """Rate and frequency of one oscillation with an offset: y[k+m] = a y[k] + b y[k-m] + c, m
    samples about an eighth of its period.
    """
    fastest = float(np.max(np.abs(loop.plant.poles().imag)))
    m = max(1, round(2 * math.pi / fastest / 8 / period))
    y = force[len(force) // 2 :]
    columns = np.column_stack([y[m:-m], y[: -2 * m], np.ones(len(y) - 2 * m)])
    (a, b, _), *_ = np.linalg.lstsq(columns / np.abs(y).max(), y[2 * m :] / np.abs(y).max())
    root = np.log(complex(max(np.roots([1.0, -a, -b]), key=abs))) / (m * period)
    return Growth(float(root.real), abs(float(root.imag)))


def cosimulated_limit(
    loop: ForceLoop, predicted: float, *, period: float = 1e-3, margin: float = 0.02
) -> tuple[Growth, Growth, float]:
    """The FMU's closed loop at (1 - margin) and (1 + margin) times a predicted limit gain, and its
    own limit gain between [V/N].

    The prediction holds where the first decays and the second grows.
    """
    below, above = (
        cosimulated_growth(loop, f * predicted, period=period) for f in (1 - margin, 1 + margin)
    )
    own = predicted * (1 + margin * (-below.rate - above.rate) / (above.rate - below.rate))
    return below, above, own
