"""What the valve's lag costs the force loop, and what a Smith predictor (§5.3, Fig. 5.8) buys back
when its model's lag is wrong.

Loops are sampled as the controller is (1 ms, zero-order hold), from the linearised FMU and the
controllers' own kernels. A PI loop is tuned for the largest integral gain at which |1/(1 + L)| <=
PEAK at every frequency (at least 6 dB gain and 29 degrees phase margin): the least integrated force
error after a step of the load. Bandwidth: the lowest frequency at which |1/(1 + L)| reaches 1/sqrt
2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import control
import numpy as np

from controllers.smith import ForceLoop as SmithModel
from controllers.smith import Smith
from pneugantry.analysis.controller_model import controller_model
from pneugantry.analysis.force_loop import ForceLoop
from pneugantry.analysis.frequency import (
    Crossing,
    Margins,
    grid,
    margins,
    response,
    stability_limit,
)
from pneugantry.analysis.root_locus import loop_with_pi, pi_block, thesis_gains
from pyfmi_runner.log import PERIOD

__all__ = [
    "PEAK",
    "RATIOS",
    "LagRow",
    "SmithRow",
    "Tuning",
    "achievable",
    "force_gains",
    "lag_row",
    "smith_controller",
    "smith_reach",
    "smith_rows",
]

PEAK = 2.0  # largest sensitivity allowed
RATIOS = (0.5, 0.75, 1.0, 1.25, 1.5)  # lag of the predictor's model / lag of the plant
INTEGRAL_TIMES = np.geomspace(0.003, 1.0, 24)  # s, K_p / K_i that are tried
HALVINGS = 30
FACTORS = np.geomspace(
    1.0, 200.0, 33
)  # on the thesis' gains, that are tried with a Smith predictor
HIGHEST = 10.0  # V/N, largest K_p that is tried


@dataclass(frozen=True)
class Tuning:
    """PI gains and what the loop makes of them."""

    k_p: float  # V/N
    k_i: float  # V/(N s)
    margins: Margins


@dataclass(frozen=True)
class LagRow:
    """A force loop with one lag."""

    lag: float  # s
    limit: Crossing | None  # sampled loop under proportional control
    thesis: Margins  # with the PI gains of Table 4.6
    best: Tuning


@dataclass(frozen=True)
class SmithRow:
    """The force loop with a Smith predictor whose model has `ratio` times the plant's lag."""

    ratio: float
    stable: bool
    margins: Margins


def lag_row(loop: ForceLoop) -> LagRow:
    """Stability limit, margins with the thesis' gains and achievable bandwidth of a loop."""
    seen = loop.sampled(PERIOD)
    limit = stability_limit(response(seen), PERIOD)
    thesis = margins(response(loop_with_pi(loop, PERIOD)), PERIOD)
    return LagRow(loop.lag, limit, thesis, achievable(loop))


def force_gains(axis: str, k_p: float, k_i: float) -> dict[str, float]:
    """Gains of a controller that works on the force of one axis alone, as `controllers.gains` names
    them.
    """
    none = {f"K{kind}_{of}": 0.0 for of in ("vx", "fx", "vz", "fz") for kind in "pi"}
    return none | {f"Kp_f{axis}": k_p, f"Ki_f{axis}": k_i}


def smith_controller(loop: ForceLoop, ratio: float, k_p: float, k_i: float) -> Smith:
    """The project's Smith predictor with a model lag of `ratio` times the loop's, everything else
    as in the FMU.
    """
    if loop.axis != "z" or loop.lag <= 0:
        raise ValueError("the Smith predictor is built for the z force loop with a lag")
    start = {name: v.start for name, v in loop.file.variables.items()} | loop.point.parameters
    names = ("axis_z.m", "axis_z.C", "contact.K_c", "contact.C_c")
    model = SmithModel(
        ratio * loop.lag, loop.valve_gain, *(float(start[name] or 0.0) for name in names)
    )
    return Smith(loop=model, gains=force_gains("z", k_p, k_i))


def smith_rows(
    loop: ForceLoop, k_p: float, k_i: float, ratios: Sequence[float] = RATIOS
) -> list[SmithRow]:
    """The z force loop with a Smith predictor and PI gains [V/N, V/(N s)], for models of `ratios`
    times the plant's lag.
    """
    seen, rows = loop.sampled(PERIOD), []
    for ratio in ratios:
        model = controller_model(smith_controller(loop, ratio, k_p, k_i), "z", PERIOD)
        rows.append(
            SmithRow(
                ratio, _stable(model, seen), margins(response(control.series(model, seen)), PERIOD)
            )
        )
    return rows


def achievable(loop: ForceLoop, peak: float = PEAK) -> Tuning:
    """The PI gains of the largest integral gain with a sensitivity of at most `peak`."""
    seen, w = loop.sampled(PERIOD), grid(PERIOD)
    plant, pole = response(seen)(w), np.exp(1j * w * PERIOD) - 1
    best_p, best_i = 0.0, 0.0
    for time in INTEGRAL_TIMES:
        shape = plant * (1 + PERIOD / time / pole)  # L / K_p
        low, high = 1e-6, HIGHEST
        for _ in range(HALVINGS):
            middle = float(np.sqrt(low * high))
            calm = float(np.min(np.abs(1 + middle * shape))) >= 1 / peak and _stable(
                pi_block(middle, middle / time, PERIOD), seen
            )
            low, high = (middle, high) if calm else (low, middle)
        if low / time > best_i:
            best_p, best_i = low, float(low / time)
    return Tuning(
        best_p,
        best_i,
        margins(response(control.series(pi_block(best_p, best_i, PERIOD), seen)), PERIOD),
    )


def smith_reach(loop: ForceLoop, ratios: Sequence[float] = RATIOS, peak: float = PEAK) -> float:
    """Largest factor on the thesis' gains at which the Smith predictor keeps the sensitivity within
    `peak` for each of `ratios`.
    """
    seen, w = loop.sampled(PERIOD), grid(PERIOD)
    plant, gains, reach = response(seen)(w), thesis_gains("z"), 0.0
    for factor in FACTORS:
        for ratio in ratios:
            model = controller_model(
                smith_controller(loop, ratio, factor * gains[0], factor * gains[1]), "z", PERIOD
            )
            if np.min(np.abs(1 + response(model)(w) * plant)) < 1 / peak or not _stable(
                model, seen
            ):
                return reach
        reach = float(factor)
    return reach


def _stable(controller: control.StateSpace, seen: control.StateSpace) -> bool:
    """Are all poles of the closed sampled loop inside the unit circle?"""
    loop = control.series(controller, seen)
    poles = np.linalg.eigvals(loop.A - loop.B @ loop.C / (1 + loop.D[0, 0]))
    return bool(np.max(np.abs(poles)) < 1)
