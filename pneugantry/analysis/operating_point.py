"""Operating points of an FMU: all its states, inputs and parameters, found by settling it, by
solving for equilibrium, or given.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from modelica_fmu.errors import RunError
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.fmu_file import Kind

__all__ = ["OperatingPoint", "open_at", "point_of", "settle", "solve"]

Numbers = Mapping[str, float]
MAX_ROUNDS = 50  # of Newton's method
ACCURACY = 1e-12  # of its last correction, as a share of each unknown's size


@dataclass(frozen=True)
class OperatingPoint:
    """States, inputs and parameters by the FMU's names, in its units (SI); what is not named keeps
    the model's start value.
    """

    states: dict[str, float] = field(default_factory=dict)
    inputs: dict[str, float] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)

    def start_values(self, file: FmuFile) -> dict[str, float]:
        """What an `FmuSession` of this FMU is started with to stand at this point.

        A state that follows from a parameter is set through it: `axis_z.s` through
        `axis_z.s_start`.
        """
        starts = {
            n if file.variables[n].settable_before_start else f"{n}_start": value
            for n, value in self.states.items()
        }
        return {**self.parameters, **self.inputs, **starts}


@contextmanager
def open_at(file: FmuFile, point: OperatingPoint, kind: Kind = "me") -> Iterator[FmuSession]:
    """A session that stands at `point`, its relations and modes settled there. Raises InputError
    for names the FMU lacks.
    """
    with FmuSession(file, kind, point.start_values(file)) as session:
        if kind == "me":
            _settle_modes(session)
        yield session


def _settle_modes(session: FmuSession) -> None:
    while session.update_discrete().again:
        pass


def point_of(session: FmuSession, parameters: Numbers | None = None) -> OperatingPoint:
    """Where a session stands now; `parameters`: those it was started with (the session's own if
    None).
    """
    variables = session.file.variables
    inputs = [name for name, v in variables.items() if v.causality == "input"]
    states = list(session.file.description.states)
    given = session.parameters if parameters is None else parameters
    chosen = {n: float(v) for n, v in given.items() if variables[n].causality == "parameter"}
    at_states = dict(zip(states, session.get(states).tolist(), strict=True))
    return OperatingPoint(
        at_states, dict(zip(inputs, session.get(inputs).tolist(), strict=True)), chosen
    )


def settle(
    file: FmuFile,
    start: OperatingPoint,
    *,
    drifting: Sequence[str] = (),
    step: float = 1e-3,
    limit: float = 30.0,
    tolerance: float = 1e-9,
) -> OperatingPoint:
    """The point at which the FMU comes to rest in co-simulation with the inputs of `start` held.

    drifting: states that may go on moving (the position of an axis that slides); step, limit: s;
    tolerance: largest rate of the other states, in nominal values a second. Raises RunError where
    they have not settled after `limit` s.
    """
    description = file.description
    watched = [
        d
        for s, d in zip(description.states, description.derivatives, strict=True)
        if s not in drifting
    ]
    names = [s for s in description.states if s not in drifting]
    nominal = np.array([file.variables[s].nominal or 1.0 for s in names])
    with open_at(file, start, "cs") as session:
        for k in range(1, round(limit / step) + 1):
            session.step(step, time=(k - 1) * step)
            if k % 50 == 0 and float(np.max(np.abs(session.get(watched)) / nominal)) < tolerance:
                return replace(point_of(session), parameters=dict(start.parameters))
        rates = np.abs(session.get(watched)) / nominal
        worst = int(np.argmax(rates))
        rate = session.get(watched[worst])
    raise RunError(
        f"the FMU has not settled after {limit:g} s: {names[worst]} still changes by "
        f"{rate:.3g} a second"
    )


def solve(
    file: FmuFile, guess: OperatingPoint, unknowns: Sequence[str], equations: Numbers
) -> OperatingPoint:
    """The point near `guess` at which each variable of `equations` has its value, by Newton's
    method.

    unknowns: as many states and inputs, free to move; equations: derivatives (`der(axis_z.v)`),
    outputs or local variables, and their values. The Jacobian is the FMU's own; its modes are
    settled anew in every round. Raises RunError where no point is found, for example because a
    valve would have to pull.
    """
    known = {**guess.states, **guess.inputs}
    values = np.array([known.get(name, 0.0) for name in unknowns])
    size = np.array([file.variables[name].nominal or 1.0 for name in unknowns])
    names, targets = list(equations), np.array(list(equations.values()))
    for _ in range(MAX_ROUNDS):
        point = _moved(file, guess, dict(zip(unknowns, values.tolist(), strict=True)))
        with open_at(file, point) as session:
            residual = session.get(names) - targets
            jacobian = session.jacobian(names, unknowns)
        change = np.linalg.lstsq(jacobian, -residual)[0]
        if not np.all(np.isfinite(change)) or np.linalg.matrix_rank(jacobian * size) < len(names):
            break
        values = values + change
        if np.max(np.abs(change) / np.maximum(np.abs(values), size)) < ACCURACY:
            return _moved(file, guess, dict(zip(unknowns, values.tolist(), strict=True)))
    wanted = ", ".join(f"{name} = {value:g}" for name, value in equations.items())
    raise RunError(
        f"no operating point with {wanted}: the plant cannot hold it with its present "
        f"parameters and valve directions"
    )


def _moved(file: FmuFile, point: OperatingPoint, values: Numbers) -> OperatingPoint:
    states = {n: v for n, v in values.items() if n in file.description.states}
    inputs = {n: v for n, v in values.items() if n not in states}
    return replace(point, states=point.states | states, inputs=point.inputs | inputs)
