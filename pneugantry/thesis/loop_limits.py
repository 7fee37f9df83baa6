"""Gain and delay margins of a controller's z loop: from python-control on the linear FMU, and found
again in co-simulation, by raising the valve's gain or its dead time until the loop oscillates.

Co-simulation: straight edge without finish, friction or noise, so that nothing but the loop itself
can keep f_n moving.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from controllers.catalogue import make_controller
from modelica_fmu.errors import RunError
from pneugantry.analysis.command_loop import LoopMargins, controller_block, loop_margins, z_plant
from pneugantry.thesis.conditions import CHOICE, NO_FRICTION, Run
from pneugantry.thesis.entrants import Entrant
from pneugantry.thesis.runner import run_one
from pyfmi_runner.fmu import FmuFile

__all__ = ["FoundMargins", "cosimulated_margins", "linear_margins"]

# Standard deviation over the last second beyond which the loop oscillates: of f_n [N], and of u_z
# [V] about its line, for an oscillation too fast to reach the contact (a calm loop: 1e-12 V)
MOVING, RESTLESS = 0.5, 5e-3
LAST = 1.0  # s
HIGHEST_GAIN, LONGEST = 30.0, 0.19  # searched up to, the former as `loop_margins` does; s
HALVINGS = 7


@dataclass(frozen=True)
class FoundMargins:
    """Infinite where the search's end was reached; zero where the loop oscillates by itself."""

    gain: float
    delay: float  # s


def linear_margins(entrant: Entrant, fmu: FmuFile) -> LoopMargins | None:
    """From python-control, z sliding in contact on the thesis' plant; None for a learning
    controller, which has no linear model.
    """
    contact = {name: CHOICE.plant()[name] for name in ("contact.K_c", "contact.C_c")}
    try:
        block = controller_block(make_controller(entrant.controller, **dict(entrant.options)))
    except ValueError:
        return None
    return loop_margins(block, z_plant(fmu, parameters=contact))


def cosimulated_margins(entrant: Entrant, fmu: FmuFile) -> FoundMargins:
    """The same margins from runs."""
    nominal = float(fmu.variables["valve_z.K"].start or 0.0)

    def calm(*changed: tuple[str, float]) -> bool:
        return _calm(entrant, fmu, changed)

    if not calm():
        return FoundMargins(0.0, 0.0)
    gain = _last_calm(lambda g: calm(("valve_z.K", nominal * g)), 1.0, HIGHEST_GAIN, ratio=True)
    delay = _last_calm(lambda d: calm(("valve_z.delay_time", d)), 0.0, LONGEST)
    return FoundMargins(gain, delay)


def _calm(entrant: Entrant, fmu: FmuFile, changed: tuple[tuple[str, float], ...]) -> bool:
    run = Run(
        "straight",
        entrant.controller,
        finish="none",
        noise=False,
        plant=(*NO_FRICTION, *changed),
        options=entrant.options,
    )
    try:
        trace = run_one(run, fmu, trace=True).trace
    except RunError:  # torn off, the model leaves its range
        return False
    assert trace is not None
    late = trace.time > trace.time[-1] - LAST
    u_z = trace.u_z[late]
    line = np.polynomial.Polynomial.fit(trace.time[late], u_z, 1)(trace.time[late])
    return bool(np.std(trace.f_n[late]) < MOVING and np.std(u_z - line) < RESTLESS)


def _last_calm(
    calm: Callable[[float], bool], low: float, high: float, *, ratio: bool = False
) -> float:
    """Largest value that is still calm, to a hundredth of the span; infinite where `high` is."""
    if calm(high):
        return math.inf
    for _ in range(HALVINGS):
        middle = math.sqrt(low * high) if ratio else 0.5 * (low + high)
        low, high = (middle, high) if calm(middle) else (low, middle)
    return low
