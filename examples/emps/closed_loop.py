"""Rungs of the axis simulated in its loop, fitted by least squares on the voltage; and the
published model, simulated
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from examples.emps.idim import Axis
from pneugantry.engine.plant import Plant, Record
from pneugantry.engine.task import Task
from pneugantry.engine.views.view import View
from pyfmi_runner.build import build_fmu
from pyfmi_runner.driven import DrivenFmu
from pyfmi_runner.fmu import FmuFile

__all__ = ["EFFECTS", "LoopRung", "ladder", "relative", "simulation_errors"]

Array = NDArray[np.float64]
EFFECTS = {
    "viscous": "viscous_friction",
    "coulomb": "coulomb_friction",
    "offset": "offset",
    "asymmetric": "friction_direction",
}
MASS = "M"
STEP = 1e-3  # of a difference quotient, in usual sizes


@dataclass(frozen=True)
class LoopRung:
    """A rung's values, and its force errors (below the view's band) by log."""

    values: dict[str, float]
    errors: dict[str, float]


def ladder(task: Task) -> dict[str, LoopRung]:
    """Nested rungs: each adds one effect to the one before, fitted on the logs that are not held
    out.
    """
    (view,) = task.views
    held = task.data.held_out
    records = [*task.data.fitted, *([] if held is None else [held])]
    scales = {MASS: 0.05 * view.defaults[MASS]}
    values = {MASS: view.defaults[MASS]}
    rungs = {}
    for name, key in {"inertia": "", **EFFECTS}.items():
        for p in task.catalogue[key].forms[0].parameters if key else ():
            scales[p.name], values[p.name] = p.scale, p.neutral
        values = _least_squares(view, task.data.fitted, values, scales)
        errors = {r.name: relative(view, r, values) for r in records}
        rungs[name] = LoopRung(dict(values), errors)
    return rungs


def _least_squares(
    view: View,
    records: Sequence[Record],
    start: Mapping[str, float],
    scales: Mapping[str, float],
) -> dict[str, float]:
    names = list(start)
    unit = np.array([scales[n] for n in names])
    first = np.array([start[n] for n in names])

    def left(thetas: Array) -> Array:
        """Residuals (points, rows) of points (points, names), in usual sizes from the start."""
        given = [dict(zip(names, (first + unit * t).tolist(), strict=True)) for t in thetas]
        made = iter(view.residuals([(r, values) for r in records for values in given]))
        parts = [np.stack([_judged(view, r, next(made)) for _ in given]) for r in records]
        return np.concatenate(parts, axis=1)

    def columns(theta: Array) -> Array:
        found = left(np.vstack([theta, theta + STEP * np.eye(len(names))]))
        return (found[1:] - found[0]).T / STEP

    found = least_squares(lambda t: left(t[None])[0], np.zeros(len(names)), columns, xtol=1e-6)
    return dict(zip(names, (first + unit * found.x).tolist(), strict=True))


def _judged(view: View, record: Record, rows: Array) -> Array:
    """Rows (rows,) that count, of the only signal."""
    skipped = round(record.skip / (record.period * view.decimation))
    return rows[skipped:, 0]


def relative(view: View, record: Record, values: Mapping[str, float]) -> float:
    """|measured - simulated| / |measured| of the view's rows."""
    error = _judged(view, record, view.residuals([(record, values)])[0])
    signal = record.signals[view.signals[0]]
    rows = len(signal) // view.decimation
    means = signal[: rows * view.decimation].reshape(rows, view.decimation).mean(axis=1)
    return float(np.linalg.norm(error) / np.linalg.norm(means[-len(error) :]))


def simulation_errors(
    plant: Plant, record: Record, axis: Axis, values: Mapping[str, float]
) -> dict[str, float]:
    """|measured - simulated| / |measured| of position, velocity, acceleration and force at every
    sample.
    """
    given = {**plant.parameters, **record.parameters, **values}
    fmu = DrivenFmu(FmuFile.read(build_fmu(plant.class_name, plant.model).path))
    inputs = {n: np.asarray(record.inputs[n], dtype=float) for n in plant.inputs}
    table = np.array([list(given.values())])
    q, v, a, u = fmu.run(list(given), table, inputs, ["q", "v", "a", "u"], record.period)[0].T
    fmu.close()
    first = record.first
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
