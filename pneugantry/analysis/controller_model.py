"""A controller's own kernel as a sampled linear model of one force loop; nothing of it is written
down twice.
"""

from __future__ import annotations

from typing import Any

import control
import numpy as np
from numpy.typing import NDArray

from controllers.interface import Controller, Reference, Sense
from pneugantry.analysis.linearise import active_part

__all__ = ["controller_model", "flat_state", "state_like"]

# N, force of the point about which it is linearised: |f| > 2 N, so that the angle estimate is at
# work
LEVEL = 30.0
STEP = 1e-3  # of the differences; a kernel that is linear there gives its matrices to rounding


def controller_model(
    controller: Controller[Any, Any], axis: str = "z", period: float = 1e-3
) -> control.StateSpace:
    """From the force error f_nd - f [N] to the command u [V] of an axis, for an edge that faces it,
    inside the command's limits.

    Central differences of the kernel about rest at LEVEL newtons. Raises ValueError where the state
    holds arrays (learning compensators are not linear).
    """
    controller.reset()
    controller.step(*_point(axis, 0.0))  # a first sample may set the state up
    template = controller.state
    n = len(flat_state(template))

    def outcome(change: NDArray[np.float64]) -> NDArray[np.float64]:
        state, command = controller.kernel(
            controller.params, state_like(template, iter(change[:n])), *_point(axis, change[n])
        )
        return np.array([*flat_state(state), getattr(command, f"u_{axis}")])

    matrix = np.column_stack(
        [(outcome(d) - outcome(-d)) / (2 * STEP) for d in STEP * np.eye(n + 1)]
    )
    matrix[np.abs(matrix) < 1e-10] = 0.0
    labels = [f"controller {i}" for i in range(n)]
    blocks = matrix[:n, :n], matrix[:n, n:], matrix[n:, :n], matrix[n:, n:]
    whole = control.StateSpace(
        *blocks,
        period,
        states=labels,
        inputs=["error"],
        outputs=[f"u_{axis}"],
        remove_useless_states=False,
    )
    return active_part(whole, ["error"], [f"u_{axis}"])


def _point(axis: str, error: float) -> tuple[Reference, Sense]:
    f = LEVEL - error
    f_x, f_z = (0.0, f) if axis == "z" else (-f, 0.0)
    return Reference(LEVEL, 0.0), Sense(0.5, 0.05, 0.0, 0.0, f_x, f_z, 0.0, 0.0)


def flat_state(state: Any) -> NDArray[np.float64]:
    """The numbers of a nested NamedTuple state; flags and places in a table (whole numbers) do not
    move.
    """
    numbers: list[float] = []
    for item in state:
        if isinstance(item, tuple):
            numbers.extend(flat_state(item))
        elif isinstance(item, np.ndarray):
            raise ValueError("a controller whose state holds arrays has no linear model")
        elif not isinstance(item, int):
            numbers.append(float(item))
    return np.array(numbers)


def state_like(template: Any, numbers: Any) -> Any:
    """A state of the template's shape from an iterator of numbers, whole numbers as they are."""
    items = [
        state_like(item, numbers)
        if isinstance(item, tuple)
        else item
        if isinstance(item, int)
        else float(next(numbers))
        for item in template
    ]
    return type(template)(*items)
