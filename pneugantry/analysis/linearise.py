"""The FMU as a linear state space at an operating point, from its own directional derivatives; no
transfer function is retyped.

continuous: dx/dt = A x + B u, y = C x + D u, of deviations from the operating point; sampled: the
same at t_k = k * period for inputs held over [t_k + delay, t_{k+1} + delay). Units are those of the
FMU's variables (SI).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import control
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from pneugantry.analysis.operating_point import OperatingPoint, open_at
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.fmu_file import Kind
from pyfmi_runner.plant import COMMANDS, OUTPUTS, TASK

__all__ = [
    "active_part",
    "linearise",
    "linearise_here",
    "sampled",
    "signal",
    "transition",
    "without_lag",
]

Array = NDArray[np.float64]


def linearise(
    file: FmuFile,
    point: OperatingPoint,
    inputs: Sequence[str] = COMMANDS,
    outputs: Sequence[str] = (*OUTPUTS, *TASK),
    kind: Kind = "me",
) -> control.StateSpace:
    """State space at `point` through the model-exchange ("me") or the co-simulation interface
    ("cs").

    inputs: inputs of the FMU, or states: a state named here becomes an input and its own equation
    is left out, so that `valve_z.f_a` is the plant without its valve (`signal` gives its label).
    outputs: outputs or local variables, not states. Modes (stick, slide, contact, valve open) are
    those that hold at the point. Raises InputError for names the FMU lacks.
    """
    with open_at(file, point, kind) as session:
        return linearise_here(session, inputs, outputs)


def linearise_here(
    session: FmuSession,
    inputs: Sequence[str] = COMMANDS,
    outputs: Sequence[str] = (*OUTPUTS, *TASK),
) -> control.StateSpace:
    """State space where a session stands; it goes on from there as if nothing had happened (its FMU
    state is saved and restored).
    """
    description = session.file.description
    kept = [
        (s, d)
        for s, d in zip(description.states, description.derivatives, strict=True)
        if s not in inputs
    ]
    states, rates = [s for s, _ in kept], [d for _, d in kept]
    saved = session.save_state()
    try:
        jacobian = session.jacobian([*rates, *outputs], [*states, *inputs])
    finally:
        session.load_state(saved)
        session.free_state(saved)
    n = len(states)
    blocks = jacobian[:n, :n], jacobian[:n, n:], jacobian[n:, :n], jacobian[n:, n:]
    return _named(blocks, Names(states, inputs, outputs))


class Names(NamedTuple):
    """Names of a linear model's states, inputs and outputs."""

    states: Sequence[str]
    inputs: Sequence[str]
    outputs: Sequence[str]


def _named(
    matrices: tuple[Array, Array, Array, Array], names: Names, dt: float = 0.0
) -> control.StateSpace:
    """A, B, C, D with their names; dt: s between samples, 0 for a continuous model."""
    labels = {
        "states": list(names.states),
        "inputs": [signal(n) for n in names.inputs],
        "outputs": [signal(n) for n in names.outputs],
    }
    return control.StateSpace(*matrices, dt, **labels, remove_useless_states=False)


def signal(name: str) -> str:
    """A variable's name as an input or output of a state space: python-control keeps the dot for
    systems, `valve_z/f_a`.
    """
    return name.replace(".", "/")


def active_part(
    model: control.StateSpace, inputs: Sequence[str], outputs: Sequence[str]
) -> control.StateSpace:
    """The states on a way from `inputs` to `outputs`, by the pattern of the matrices: exact, no
    tolerance.
    """
    columns = [model.input_labels.index(signal(name)) for name in inputs]
    rows = [model.output_labels.index(signal(name)) for name in outputs]
    reached = _spread(model.A != 0, np.any(model.B[:, columns] != 0, axis=1))
    seen = _spread((model.A != 0).T, np.any(model.C[rows] != 0, axis=0))
    keep = np.flatnonzero(reached & seen)
    states = [model.state_labels[i] for i in keep]
    blocks = (
        model.A[np.ix_(keep, keep)],
        model.B[np.ix_(keep, columns)],
        model.C[np.ix_(rows, keep)],
        model.D[np.ix_(rows, columns)],
    )
    return _named(blocks, Names(states, inputs, outputs), model.dt)


def _spread(pattern: NDArray[np.bool_], start: NDArray[np.bool_]) -> NDArray[np.bool_]:
    marked = start
    for _ in range(len(start)):
        marked = marked | (pattern @ marked)
    return marked


def without_lag(model: control.StateSpace, state: str) -> control.StateSpace:
    """The model with `state` always at its steady value: the limit of a time constant that goes to
    zero.

    0 = A_ss x_s + A_sr x_r + B_s u is solved for x_s; for a valve x_s = K u, whatever its tau was.
    """
    s = model.state_labels.index(state)
    rest = [i for i in range(model.nstates) if i != s]
    pivot = model.A[s, s]
    row, into = model.A[s, rest] / -pivot, model.B[s] / -pivot
    blocks = (
        model.A[np.ix_(rest, rest)] + np.outer(model.A[rest, s], row),
        model.B[rest] + np.outer(model.A[rest, s], into),
        model.C[:, rest] + np.outer(model.C[:, s], row),
        model.D + np.outer(model.C[:, s], into),
    )
    kept = [model.state_labels[i] for i in rest]
    return _named(blocks, Names(kept, model.input_labels, model.output_labels))


def transition(a: Array, b: Array, time: float) -> tuple[Array, Array]:
    """exp(A t) and the integral of exp(A s) B over 0..t: how a state goes on for `time` s with its
    input held.
    """
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a, b
    both = expm(block * time)
    return both[:n, :n], both[:n, n:]


def sampled(
    model: control.StateSpace, period: float = 1e-3, delay: float = 0.0
) -> control.StateSpace:
    """Exact sampled model: zero-order hold of `period` s, inputs that act `delay` s late (any
    fraction of a period).

    Commands on their way are states, the latest first: "u_z 1 samples ago". As the sampled loop of
    `pyfmi_runner` with `LoopTiming(period, delay)`. Raises ValueError for period <= 0 or delay < 0.
    """
    if not period > 0 or not delay >= 0:
        raise ValueError(f"period must be > 0 s and delay >= 0 s, got {period} and {delay}")
    if delay > 0 and np.any(model.D):
        raise ValueError("a model whose outputs jump with its inputs cannot be delayed here")
    whole = math.floor(delay / period + 1e-9)
    taps = [np.zeros_like(model.B)] * whole + _shares(model, period, delay - whole * period)
    n, m, held = (
        model.nstates,
        model.ninputs,
        len(taps) - 1,
    )  # held: commands on their way at a sample
    a, b = np.zeros((n + held * m, n + held * m)), np.zeros((n + held * m, m))
    a[:n, :n], b[:n] = transition(model.A, model.B, period)[0], taps[0]
    a[:n, n:] = np.hstack(taps[1:]) if held else a[:n, n:]
    if held:
        b[n : n + m] = np.eye(m)
        a[n + m :, n : n + (held - 1) * m] = np.eye((held - 1) * m)
    c = np.hstack([model.C, np.zeros((model.noutputs, held * m))])
    labels = [
        *model.state_labels,
        *(f"{name} {j + 1} samples ago" for j in range(held) for name in model.input_labels),
    ]
    names = Names(labels, model.input_labels, model.output_labels)
    return _named((a, b, c, model.D), names, period)


def _shares(model: control.StateSpace, period: float, part: float) -> list[Array]:
    """What the commands of this sample and the one before add to the state over a period, the
    change coming `part` s into it.
    """
    if part < 1e-12:
        return [transition(model.A, model.B, period)[1]]
    rest, late = transition(model.A, model.B, period - part)
    return [late, rest @ transition(model.A, model.B, part)[1]]
