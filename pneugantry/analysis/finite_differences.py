"""The oracle of `linearise`: central differences of the co-simulated FMU over one communication
step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import control
import numpy as np
from numpy.typing import NDArray

from pneugantry.analysis.linearise import sampled, signal
from pneugantry.analysis.operating_point import OperatingPoint
from pyfmi_runner.fmu import FmuFile, FmuSession

__all__ = ["agreement", "differenced_model", "stepped_model"]

Array = NDArray[np.float64]

# Perturbations, small enough to stay in the same modes and large enough for rounding not to matter
SIZES = {"m": 5e-5, "m/s": 2e-3, "N": 0.3, "V": 0.04, "1": 0.05}
FINE = {"solver.max_step": 5e-5}  # s: lets the integrator's own error fall below the comparison's
PERIOD = 0.02  # s, long enough for the couplings that grow with its cube to stand clear of rounding


def stepped_model(
    file: FmuFile,
    point: OperatingPoint,
    inputs: Sequence[str],
    outputs: Sequence[str],
    period: float = PERIOD,
) -> control.StateSpace:
    """Sampled state space from co-simulated steps of `period` s, from perturbed states and inputs.

    To be compared where the linear model does not change along the step: at an equilibrium, or
    where the modes are linear.
    """
    states = list(file.description.states)

    def after(session: FmuSession) -> Array:
        before = session.get(list(outputs))
        session.step(period)
        return np.concatenate([session.get(states), before])

    return _differences(file, point, inputs, outputs, after, period)


def differenced_model(
    file: FmuFile, point: OperatingPoint, inputs: Sequence[str], outputs: Sequence[str]
) -> control.StateSpace:
    """Continuous state space from the rates that the co-simulated FMU shows at perturbed states and
    inputs.
    """
    names = [*file.description.derivatives, *outputs]
    return _differences(file, point, inputs, outputs, lambda session: session.get(names), 0.0)


def _differences(
    file: FmuFile,
    point: OperatingPoint,
    inputs: Sequence[str],
    outputs: Sequence[str],
    look: Callable[[FmuSession], Array],
    dt: float,
) -> control.StateSpace:
    """Central differences with steps h and h/2, extrapolated: their error falls with h^4; piecewise
    linear plants give rounding alone.
    """
    fine = replace(point, parameters={**point.parameters, **FINE})
    states = list(file.description.states)
    with FmuSession(file, "cs", fine.start_values(file)) as session:
        now = dict(zip([*states, *inputs], session.get([*states, *inputs]).tolist(), strict=True))

        def outcome(name: str, value: float) -> Array:
            changed = {name: value}
            moved = (
                replace(fine, states=fine.states | changed)
                if name in states
                else replace(fine, inputs=fine.inputs | changed)
            )
            session.reset(moved.start_values(file))
            return look(session)

        columns = []
        for name, value in now.items():
            size = SIZES.get(file.variables[name].unit or "1", 1e-3)
            wide, narrow = (
                (outcome(name, value + h) - outcome(name, value - h)) / (2 * h)
                for h in (size, size / 2)
            )
            columns.append((4 * narrow - wide) / 3)
    both, n = np.array(columns).T, len(states)
    labels = {
        "states": states,
        "inputs": [signal(n) for n in inputs],
        "outputs": [signal(n) for n in outputs],
    }
    return control.StateSpace(
        both[:n, :n],
        both[:n, n:],
        both[n:, :n],
        both[n:, n:],
        dt,
        **labels,
        remove_useless_states=False,
    )


def agreement(linear: control.StateSpace, stepped: control.StateSpace) -> float:
    """Largest difference between a linear model, sampled exactly as the other is, and differences,
    entry by entry, relative to the entry.

    Entries that are zero in the linear model count relative to the largest entry of their row and
    column, whichever is less.
    """
    exact = sampled(linear, stepped.dt) if stepped.dt else linear
    worst = 0.0
    for name in ("A", "B", "C", "D"):
        ours, theirs = getattr(exact, name), getattr(stepped, name)
        if ours.size:
            size = np.where(
                ours != 0,
                np.abs(ours),
                np.minimum(np.abs(ours).max(axis=1, keepdims=True), np.abs(ours).max(axis=0)),
            )
            worst = max(worst, float(np.max(np.abs(ours - theirs) / np.where(size > 0, size, 1.0))))
    return worst
