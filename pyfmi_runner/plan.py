"""A scenario laid out sample by sample: what both loops follow, so that they give the same bits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyfmi_runner.log import PHASES
from pyfmi_runner.plant import own_profile, plant_parameters
from pyfmi_runner.scenario import Scenario
from pyfmi_runner.sensors import noise_rows
from pyfmi_runner.timing import action_instants

__all__ = ["APPROACH", "RETREAT", "Plan", "make_plan"]

Array = NDArray[np.float64]
APPROACH, CONTACT, CONTOUR, RETREAT = range(len(PHASES))


@dataclass(frozen=True, eq=False)
class Plan:
    """Row k holds for [t_k, t_k + period). Times are whole microseconds."""

    samples: int
    period: int  # us
    phase: NDArray[np.int64]  # index into PHASES
    f_nd: Array  # N
    v_td: Array  # m/s
    clamps: NDArray[np.int32]  # (samples, 2): x, z clamped
    manual: Array  # (samples, 2): force set by hand, N
    approach: tuple[float, float]  # V, u_x and u_z before the contact phase
    acts: NDArray[np.int64]  # us at which the command of sample k acts
    noise: Array  # (samples, 8), standard normal
    profile: tuple[Array, float, float] | None  # coefficients, x0, dx of the user's own edge
    parameters: dict[str, float]  # of the FMU


def make_plan(scenario: Scenario) -> Plan:
    """Lays a scenario out. Raises InputError where its workpiece cannot be read."""
    n = scenario.samples
    period = round(scenario.timing.period * 1e6)
    time = np.arange(n) * scenario.timing.period
    phase = np.full(n, APPROACH, dtype=np.int64)
    for name, (start, _) in scenario.phases.items():
        phase[time >= start - 0.5 * scenario.timing.period] = PHASES.index(name)
    clamps = np.zeros((n, 2), dtype=np.int32)
    for column, axis in enumerate("xz"):
        for start, end in scenario.windows(axis):
            middle = time + 0.5 * scenario.timing.period
            clamps[(middle >= start) & (middle < end), column] = 1
    manual = np.zeros((n, 2))
    manual[phase == RETREAT, 1] = scenario.retreat_f_az
    profile = own_profile(scenario)
    return Plan(
        samples=n,
        period=period,
        phase=phase,
        f_nd=np.where(phase == APPROACH, 0.0, np.where(phase == RETREAT, 0.0, scenario.f_nd)),
        v_td=np.where(phase == CONTOUR, scenario.v_td, 0.0),
        clamps=clamps,
        manual=manual,
        approach=(scenario.approach_u_x, scenario.approach_u_z),
        acts=action_instants(scenario.timing, n, scenario.seed),
        noise=noise_rows(n, scenario.seed) if scenario.noise else np.zeros((n, 8)),
        profile=None if profile is None else (profile.coefficients, profile.x0, profile.dx),
        parameters=plant_parameters(scenario) | scenario.plant,
    )
