"""A controller that is an FMU itself (`pneugantry build --controller NAME`): same place in the
loops, same bits as its native form.
"""

from __future__ import annotations

import math
from types import TracebackType
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from controllers.interface import Command, Controller, Reference, Sense
from modelica_fmu.errors import InputError
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.fmu_values import Value
from pyfmi_runner.native import call_step, call_values

__all__ = ["FmuController"]

INPUTS = (*Sense._fields, *Reference._fields)
OUTPUTS = Command._fields
PERIOD = 1e-3  # s
FAILED = math.nan  # V, a command that the plant refuses: the controller's FMU has failed


class FmuWiring(NamedTuple):
    """Addresses and value references of the controller's instance, and the arrays of its values."""

    component: int
    set_real: int
    get_real: int
    do_step: int
    inputs: NDArray[np.uint32]
    outputs: NDArray[np.uint32]
    given: NDArray[np.float64]
    got: NDArray[np.float64]


class FmuTicks(NamedTuple):
    """The state that counts is inside the FMU."""

    done: int = 0  # ticks


@register_jitable
def fmu_kernel(
    params: FmuWiring, state: FmuTicks, reference: Reference, sense: Sense
) -> tuple[FmuTicks, Command]:
    """Inputs, one step of the controller's FMU, outputs; by address, hence in compiled loops
    alone.
    """
    given, got = params.given, params.got
    for k in range(8):
        given[k] = sense[k]
    given[8], given[9] = reference.f_nd, reference.v_td
    status = call_values(
        params.set_real, params.component, params.inputs.ctypes.data, given.size, given.ctypes.data
    )
    status = max(status, call_step(params.do_step, params.component, state.done * PERIOD, PERIOD))
    status = max(
        status,
        call_values(
            params.get_real, params.component, params.outputs.ctypes.data, got.size, got.ctypes.data
        ),
    )
    if status > 1:
        got[0] = got[1] = FAILED
    return FmuTicks(state.done + 1), Command(got[0], got[1])


class FmuController(Controller[FmuWiring, FmuTicks]):
    """`with FmuController(file, parameters={"gains.f_z.k_p": 0.03}) as controller:
    run_scenario(..., controller=controller)`.

    Raises InputError for an FMU without a controller's inputs and outputs, and for parameters that
    it does not take.
    """

    kernel = staticmethod(fmu_kernel)

    def __init__(self, file: FmuFile, parameters: dict[str, Value] | None = None) -> None:
        missing = [name for name in (*INPUTS, *OUTPUTS) if name not in file.variables]
        if missing:
            hint = "give one that `pneugantry build --controller NAME` made"
            raise InputError(
                "is no controller: it has no such variable",
                file=file.path,
                field=missing[0],
                hint=hint,
            )
        self.session = FmuSession(file, parameters=parameters)

    def __enter__(self) -> FmuController:
        self.session.__enter__()
        raw, references = self.session.raw(), self.session.references
        arrays = (
            references(INPUTS),
            references(OUTPUTS),
            np.zeros(len(INPUTS)),
            np.zeros(len(OUTPUTS)),
        )
        super().__init__(FmuWiring(raw.component, raw.set_real, raw.get_real, raw.do_step, *arrays))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.session.__exit__(kind, error, trace)

    def initial_state(self) -> FmuTicks:
        return FmuTicks()

    def reset(self) -> None:
        self.session.reset()
        super().reset()

    def step(self, reference: Reference, sense: Sense) -> Command:
        """As the kernel does, with errors that say what the FMU says. RunError if it fails."""
        self.session.set(INPUTS, (*sense, *reference))
        self.session.step(PERIOD, time=self.state.done * PERIOD)
        self.state = FmuTicks(self.state.done + 1)
        return Command(*(float(u) for u in self.session.get(OUTPUTS)))
