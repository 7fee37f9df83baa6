"""What every controller takes, gives and holds."""

from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

from numba.extending import register_jitable

U_MIN = 0.0  # V, lower end of the valve command
U_MAX = 5.0  # V, upper end of the valve command

Params = TypeVar("Params")
State = TypeVar("State")
Kernel = Callable[[Any, Any, "Reference", "Sense"], tuple[Any, "Command"]]


class Sense(NamedTuple):
    """What the sensors say at t_k, in the fixed frame."""

    x: float  # m, piston position
    z: float  # m, piston position, grows towards the workpiece
    v_x: float  # m/s
    v_z: float  # m/s
    f_x: float  # N, contact force of the robot on the workpiece
    f_z: float  # N, contact force of the robot on the workpiece, > 0 presses
    f_ax: float  # N, actuator force on x (the valve gives f_ax <= 0)
    f_az: float  # N, actuator force on z (the valve gives f_az >= 0)


class Reference(NamedTuple):
    """What is asked for, in the task frame."""

    f_nd: float  # N, > 0 presses into the workpiece
    v_td: float  # m/s, < 0 tracks towards -x


class Command(NamedTuple):
    """Valve commands that act over [t_k, t_k + 1 ms)."""

    u_x: float  # V, 0..5; more pushes towards -x
    u_z: float  # V, 0..5; more pushes towards +z


class Controller(Generic[Params, State]):
    """Holds params and state around a kernel; has no clock, file, print or random draw.

    ``kernel(params, state, reference, sense) -> (state, command)`` is a plain function made
    compilable by numba's ``register_jitable``: called from Python it runs as Python, called in an
    ``@njit`` loop it compiles, and both give the same bits (arithmetic, ``math.*`` and plain loops
    only). A kernel may write into the arrays of the state it was given and returns them;
    ``initial_state`` allocates them anew.

    For a compiled loop pass ``controller.kernel`` as a constant of the loop, ``controller.params``
    and ``controller.state`` as arguments, and store the last state back.
    """

    def __init__(self, params: Params) -> None:
        self.params = params
        self.reset()

    @staticmethod
    def kernel(params: Any, state: Any, reference: Any, sense: Any) -> tuple[Any, "Command"]:
        """State and command after the sample; a subclass sets ``kernel =
        staticmethod(its_kernel)``.
        """
        raise NotImplementedError

    def initial_state(self) -> State:
        """State at the start of the contact phase."""
        raise NotImplementedError

    def reset(self) -> None:
        self.state = self.initial_state()

    def step(self, reference: Reference, sense: Sense) -> Command:
        """Command from the sample at t_k; the state moves on to t_k + 1 ms."""
        self.state, command = self.kernel(self.params, self.state, reference, sense)
        return command


@register_jitable
def clip_command(u: float) -> float:
    """u [V] limited to what the valve takes."""
    if u < U_MIN:
        return U_MIN
    if u > U_MAX:
        return U_MAX
    return u
