"""Runs with the compensator that is told the plant's own friction (§5.2, Fig. 5.5): the one loop
that looks inside the plant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.interface import Command, Reference
from controllers.perfect_friction import PerfectFriction, SenseWithFriction
from pneugantry.thesis.conclusions import Conclusion, improvement
from pneugantry.thesis.conditions import NO_LAG, TIME_SHIFT, Run, scenario_of
from pneugantry.thesis.runner import Results
from pneugantry.thesis.scores import Scores
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.loop import set_inputs
from pyfmi_runner.plan import APPROACH, make_plan
from pyfmi_runner.plant import COMMANDS, OUTPUTS
from pyfmi_runner.sensors import initial_state, sense

__all__ = ["PerfectRun", "perfect_conclusion", "perfect_run"]

FRICTION = ("axis_x.friction.F", "axis_z.friction.F")
STRAIGHT = Run("straight")
MOST = 0.5  # share of the error that "most of it" is more than


@dataclass(frozen=True)
class PerfectRun:
    """Scores and f_n of a run on the straight edge."""

    scores: Scores
    time: np.ndarray  # s, the thesis'
    f_n: np.ndarray


def perfect_run(run: Run, fmu: FmuFile) -> PerfectRun:
    """Straight edge, scored on the measured f_z and v_x (theta within 3 degrees: the cosine is
    above 0.998).
    """
    scenario = scenario_of(run)
    plan = make_plan(scenario)
    controller, sensors, seen = PerfectFriction(), scenario.sensors, np.empty((plan.samples, 2))
    sensor_state, started = initial_state(), False
    with FmuSession(fmu, parameters=plan.parameters) as session:
        for k in range(plan.samples):
            set_inputs(session, plan, k)
            values = session.get(OUTPUTS + FRICTION).tolist()
            sensor_state, measured = sense(sensors, sensor_state, tuple(values[:8]), plan.noise[k])  # type: ignore[arg-type]
            command = Command(*plan.approach)
            if plan.phase[k] != APPROACH:
                if not started:
                    controller.reset()
                    started = True
                sample = SenseWithFriction(*measured, *values[8:])
                command = controller.step(
                    Reference(float(plan.f_nd[k]), float(plan.v_td[k])),
                    sample,  # type: ignore[arg-type]
                )
            seen[k] = measured[5], measured[2]
            session.set(COMMANDS, command)
            session.step(1e-6 * plan.period, time=k * plan.period * 1e-6)
    return _scored(run, seen, scenario.phases["contour"][0])


def _scored(run: Run, seen: np.ndarray, start: float) -> PerfectRun:
    time = np.arange(len(seen)) * 1e-3
    e_f, e_v = 30.0 - seen[:, 0], run.v_td - seen[:, 1]
    window = time >= start - run.choice.quiet - 1e-9
    e_f, e_v = e_f[window], e_v[window]
    scores = Scores(
        float(np.abs(e_f).max()),
        float(np.abs(e_v).max()),
        float(np.sqrt(np.mean(e_f**2))),
        float(np.sqrt(np.mean(e_v**2))),
    )
    return PerfectRun(scores, time + TIME_SHIFT, seen[:, 0])


def perfect_conclusion(
    results: Results, with_lag: PerfectRun, without_lag: PerfectRun
) -> Conclusion:
    """Conclusion 11 under one setting; the DDFM compensator stands beside the perfect one."""
    alone, alone_without = (
        results[STRAIGHT].rmse_fn,
        results[STRAIGHT.changed(plant=NO_LAG)].rmse_fn,
    )
    numbers = {
        "PI FV": alone,
        "perfect, with lag": with_lag.scores.rmse_fn,
        "DDFM compensator, with lag": results[STRAIGHT.changed(controller="pi_fv_ddfm")].rmse_fn,
        "PI FV, no lag": alone_without,
        "perfect, no lag": without_lag.scores.rmse_fn,
        "cut with lag": improvement(alone, with_lag.scores.rmse_fn),
        "cut without lag": improvement(alone, without_lag.scores.rmse_fn),
    }
    holds = numbers["cut with lag"] < 0.30 and numbers["cut without lag"] > MOST
    text = (
        "with lag even a perfect friction compensator brings none; without lag it removes "
        "most of the error"
    )
    return Conclusion(11, text, holds, numbers)
