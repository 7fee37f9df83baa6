"""Rungs of the axis simulated in its loop, fitted by least squares on the voltage; and the
published model, simulated
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from examples.emps.idim import Axis
from pneugantry.diagnosis.own_bench import Hypothesis, OwnBench, Trial
from pneugantry.diagnosis.own_plant import OwnLog, OwnPlant
from pneugantry.engine.catalogue import Effect
from pyfmi_runner.block_fmu import BlockFmu

__all__ = ["EFFECTS", "LoopRung", "ladder", "simulation_errors"]

EFFECTS = {
    "viscous": "viscous_friction",
    "coulomb": "coulomb_friction",
    "offset": "offset",
    "asymmetric": "friction_direction",
}


@dataclass(frozen=True)
class LoopRung:
    """A rung's values, and its force errors (below 20 Hz) by log."""

    values: dict[str, float]
    errors: dict[str, float]


def ladder(plant: OwnPlant, catalogue: Mapping[str, Effect]) -> dict[str, LoopRung]:
    """Nested rungs: each adds one effect to the one before, fitted on the logs that are not held
    out.
    """
    with OwnBench(plant) as bench:
        trial = _least_squares(bench, bench.fit(Hypothesis()))
        rungs = {"inertia": _rung(bench, trial)}
        for name, key in EFFECTS.items():
            effect = catalogue[key]
            trial = _least_squares(bench, trial, trial.hypothesis.plus(effect, effect.forms[0]))
            rungs[name] = _rung(bench, trial)
    return rungs


def _least_squares(bench: OwnBench, base: Trial, hypothesis: Hypothesis | None = None) -> Trial:
    """Without colour; twice, so that the prior is weighed against the residual's own size."""
    trial = bench.fit(hypothesis or base.hypothesis, base, whiteners=bench.plain(base.values))
    return bench.fit(trial.hypothesis, trial, whiteners=bench.plain(trial.values))


def _rung(bench: OwnBench, trial: Trial) -> LoopRung:
    return LoopRung(
        trial.fit.values,
        {log.name: bench.relative(log, trial.values)["u"] for log in bench.plant.logs},
    )


def simulation_errors(
    plant: OwnPlant, log: OwnLog, axis: Axis, values: Mapping[str, float]
) -> dict[str, float]:
    """|measured - simulated| / |measured| of position, velocity, acceleration and force at every
    sample.
    """
    with BlockFmu(plant.fmu) as fmu:
        q, v, a, u = fmu.run(
            {**plant.parameters, **log.parameters, **values},
            plant.inputs,
            log.inputs,
            ["q", "v", "a", "u"],
        ).T
    first = round(plant.skip / plant.period)
    pairs = {
        "position": (axis.position, q),
        "velocity": (axis.velocity, v),
        "acceleration": (axis.acceleration, a),
        "force": (axis.force, plant.parameters["gtau"] * u),
    }
    return {
        name: float(np.linalg.norm((m - s)[first:]) / np.linalg.norm(m[first:]))
        for name, (m, s) in pairs.items()
    }
