"""The loop of one axis broken at its command: every signal that the controller reads goes back
through the controller's own kernel. For controllers that use more than the contact force.

L(z) = -C(z) P(z), P from the FMU: command u [V] to contact force, actuator force and speed of the
axis, sampled with a hold and a dead time; C from central differences of the kernel at rest on an
edge that faces the axis, forces and speed to command. Sliding, friction is constant and drops out;
stuck, the displacement-dependent law is a spring of its presliding stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray

from controllers.interface import Controller, Reference, Sense
from controllers.valve import K_X, K_Z, U_0X, U_0Z
from pneugantry.analysis.controller_model import flat_state, state_like
from pneugantry.analysis.frequency import grid, response
from pneugantry.analysis.gantry_points import axis_contact, free_sliding
from pneugantry.analysis.linearise import active_part, linearise, sampled
from pneugantry.analysis.operating_point import OperatingPoint
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import PERIOD

__all__ = [
    "LoopMargins",
    "LoopPlant",
    "command_loop",
    "controller_block",
    "is_stable",
    "loop_margins",
    "x_plant",
    "z_plant",
]

Array = NDArray[np.float64]
DDFM = 3.0  # Types.FrictionLaw: a spring at rest
LEVEL = 30.0  # N, contact force of the point
DRIVE = 0.06  # m/s, speed asked for towards -x, at which the x command is off its lower limit
STEP = 1e-3  # of the differences
SETTLING, FOLLOWING = 1500, 0.01  # samples, share a sample of the actuator that follows
FACTORS = np.geomspace(1.0, 30.0, 241)  # gains that are tried for the gain margin
DRIFT = 1e-7  # a pole this near 1 is the free offset between spring and position of a stuck axis


@dataclass(frozen=True)
class LoopPlant:
    """One linear plant of an axis: sampled command [V] to (force, actuator force, speed)."""

    name: str
    axis: str
    stuck: bool  # held by presliding friction
    model: control.StateSpace

    @property
    def label(self) -> str:
        return f"{self.name}, {self.axis}{' stuck' if self.stuck else ''}"


@dataclass(frozen=True)
class LoopMargins:
    """Margins of a closed loop; zeros where it is unstable."""

    stable: bool
    gain: float  # factor by which the loop gain may grow
    delay: float  # s that may be added
    modulus: float  # smallest |1 + L|, 1 / peak of the sensitivity


def z_plant(
    file: FmuFile,
    name: str = "nominal",
    *,
    stuck: bool = False,
    parameters: Mapping[str, float] | None = None,
) -> LoopPlant:
    """The z axis in contact on a straight edge, sliding or stuck. parameters: of the FMU, dead time
    `valve_z.delay_time` and second stage `valve_z.tau_2` among them.
    """
    own, stage, late = _split("z", parameters or {})
    point = axis_contact(file, "z", 0.0, LEVEL, own)
    law = {"axis_z.friction.law": DDFM} if stuck else {}
    return _sampled(file, "z", name, point, {**stage, **law}, late)


def x_plant(
    file: FmuFile, name: str = "nominal", *, parameters: Mapping[str, float] | None = None
) -> LoopPlant:
    """The x axis sliding along a straight edge, where the contact does not act on it."""
    own, stage, late = _split("x", parameters or {})
    return _sampled(file, "x", name, free_sliding(file, parameters=own), stage, late)


def _split(
    axis: str, parameters: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, float], float]:
    """Parameters that shape the operating point, the valve's second stage, its dead time [s]."""
    own = {n: v for n, v in parameters.items() if not n.endswith((".delay_time", ".tau_2"))}
    second = f"valve_{axis}.tau_2"
    stage = {second: parameters[second]} if second in parameters else {}
    return own, stage, parameters.get(f"valve_{axis}.delay_time", 0.0)


def _sampled(
    file: FmuFile,
    axis: str,
    name: str,
    point: OperatingPoint,
    changed: Mapping[str, float],
    late: float,
) -> LoopPlant:
    signals, command = _signals(axis), [f"u_{axis}"]
    states = point.states | {f"valve_{axis}.f_stage": point.states[f"valve_{axis}.f_a"]}
    point = replace(point, states=states, parameters={**point.parameters, **changed})
    model = active_part(linearise(file, point, command, signals), command, signals)
    stuck = "axis_z.friction.law" in changed
    return LoopPlant(name, axis, stuck, sampled(model, PERIOD, late))


def _signals(axis: str) -> list[str]:
    """What the loop feeds back: contact force, actuator force, speed."""
    return [f"f_{axis}", f"f_a{axis}", f"v_{axis}"]


def controller_block(
    controller: Controller[Any, Any], axis: str = "z", period: float = PERIOD
) -> control.StateSpace:
    """Contact force, actuator force [N] and speed [m/s] of an axis to its command [V], inside the
    limits, on a straight edge.

    Raises ValueError where the state holds arrays: learning compensators are not linear.
    """
    point = _settled(controller, axis)
    template = controller.state
    n, command = len(flat_state(template)), f"u_{axis}"

    def outcome(change: Array) -> Array:
        start = state_like(template, iter(flat_state(template) + change[:n]))
        given = _point(axis, point + change[n:])
        state, commands = controller.kernel(controller.params, start, *given)
        return np.array([*flat_state(state), getattr(commands, command)])

    columns = [(outcome(d) - outcome(-d)) / (2 * STEP) for d in STEP * np.eye(n + 3)]
    matrix = np.column_stack(columns)
    matrix[np.abs(matrix) < 1e-10] = 0.0
    blocks = matrix[:n, :n], matrix[:n, n:], matrix[n:, :n], matrix[n:, n:]
    states = [f"controller {i}" for i in range(n)]
    labels = {"inputs": _signals(axis), "outputs": [command], "states": states}
    whole = control.StateSpace(*blocks, period, **labels, remove_useless_states=False)
    return active_part(whole, _signals(axis), [command])


def _settled(controller: Controller[Any, Any], axis: str) -> Array:
    """Brings the controller to rest with an actuator that follows its command, so that no command
    is at a limit; returns the signals there, as deviations from `_point`'s.
    """
    gain, offset, way = (K_Z, U_0Z, 1.0) if axis == "z" else (K_X, U_0X, -1.0)
    controller.reset()
    signals = np.zeros(3)
    for _ in range(SETTLING):
        command = getattr(controller.step(*_point(axis, signals)), f"u_{axis}")
        signals[1] += FOLLOWING * (way * gain * (command - offset) - signals[1])
    return signals


def _point(axis: str, change: Array) -> tuple[Reference, Sense]:
    """Contact on a straight edge, at rest on z; on x at a speed error that lifts the command off
    its lower limit. change: of contact force, actuator force and speed of the axis.
    """
    f, f_a, v = (float(c) for c in change)
    if axis == "z":
        return Reference(LEVEL, 0.0), Sense(0.5, 0.05, 0.0, v, 0.0, LEVEL + f, 0.0, f_a)
    return Reference(LEVEL, -DRIVE), Sense(0.5, 0.05, v, 0.0, f, LEVEL, f_a, LEVEL)


def command_loop(block: control.StateSpace, plant: LoopPlant) -> control.StateSpace:
    """L(z), one input, one output; negative feedback."""
    return -1 * control.series(plant.model, block)


def loop_margins(block: control.StateSpace, plant: LoopPlant) -> LoopMargins:
    """Margins of a controller on a plant, from the poles of the closed loop: the smallest gain and
    delay that lose its stability, wherever L crosses.
    """
    loop = command_loop(block, plant)
    if not is_stable(loop, 1.0):
        return LoopMargins(False, 0.0, 0.0, 0.0)
    lost = next((f for f in FACTORS if not is_stable(loop, float(f))), math.inf)
    w = grid(PERIOD)
    at = response(loop)(w)
    return LoopMargins(True, float(lost), _delay_margin(w, at), float(np.abs(1 + at).min()))


def is_stable(loop: control.StateSpace, gain: float = 1.0) -> bool:
    """Does negative feedback of `gain` times L close to a stable loop?"""
    closed = loop.A - gain * loop.B @ loop.C / (1.0 + gain * loop.D[0, 0])
    return bool(np.max(np.abs(np.linalg.eigvals(closed))) < 1.0 + DRIFT)


def _delay_margin(w: Array, at: NDArray[np.complex128]) -> float:
    """Smallest delay that brings L to -1 at a crossover of a stable loop."""
    size = np.abs(at)
    crossings = np.flatnonzero((size[:-1] - 1.0) * (size[1:] - 1.0) < 0)
    late = [float(np.mod(np.angle(-at[i]), 2 * math.pi) / w[i]) for i in crossings]
    return min(late, default=math.inf)
