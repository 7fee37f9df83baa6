"""Command replay: the whole plant driven by a log's recorded commands alone, compared with what the
sensors said.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modelica_fmu.errors import RunError
from pyfmi_runner.campaign import LoggedRun, LogSetup
from pyfmi_runner.compiled_loop import FMI_WARNING, native_values
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.log import MEASURED, PERIOD, SIGMA
from pyfmi_runner.machine_code import kept
from pyfmi_runner.native import call_step
from pyfmi_runner.plant import (
    CLAMPS,
    COMMANDS,
    OUTPUTS,
    PROFILE,
    check_gantry,
    own_profile,
    plant_parameters,
)
from pyfmi_runner.workpiece import local_profile

__all__ = ["SIGMAS", "Gaps", "Replayer", "channel_gaps"]

Array = NDArray[np.float64]
SIGMAS = np.array([SIGMA[name] for name in MEASURED])


@dataclass(frozen=True)
class Gaps:
    """RMS of (measured - simulated)/sigma; 1 is the noise floor."""

    gap: float
    channels: dict[str, float]


def channel_gaps(measured: Array, simulated: Array) -> Gaps:
    """Gap of a log from (N, 8) arrays in the order of the logs' channels."""
    squares = (((measured - simulated) / SIGMAS) ** 2).mean(axis=0)
    return Gaps(
        float(np.sqrt(squares.mean())),
        {name: float(np.sqrt(s)) for name, s in zip(MEASURED, squares, strict=True)},
    )


class Replayer:
    """Replays logs on one instance of the gantry FMU, reset between logs; used in a `with`."""

    def __init__(self, fmu: FmuFile) -> None:
        check_gantry(fmu)
        self.session = FmuSession(fmu)
        self._wiring: tuple[Any, ...] | None = None

    def __enter__(self) -> Replayer:
        self.session.__enter__()
        raw, references = self.session.raw(), self.session.references
        self._wiring = (
            (raw.component, raw.set_real, raw.set_boolean, raw.get_real, raw.do_step),
            (references(COMMANDS), references(CLAMPS), references(PROFILE), references(OUTPUTS)),
        )
        return self

    def __exit__(self, *error: Any) -> None:
        self.session.close()

    def simulate(self, run: LoggedRun, parameters: Mapping[str, float] | None = None) -> Array:
        """Plant outputs (N, 8) in the order of the logs' channels, at the log's instants, for its
        recorded commands.

        `parameters` go before those of the set-up. Raises InputError for a parameter that the FMU
        refuses, RunError where it fails.
        """
        log = run.log
        return self.drive(
            run.setup, np.column_stack([log["u_x"], log["u_z"]]), log.time, parameters
        )

    def drive(
        self,
        setup: LogSetup,
        commands: Array,
        time: Array,
        parameters: Mapping[str, float] | None = None,
    ) -> Array:
        """As `simulate`, for commands (N, 2) [V] acting from time (N,) [s] on."""
        assert self._wiring is not None, "a Replayer works inside its with statement"
        self.session.reset(
            plant_parameters(setup) | dict(parameters or {}), start_time=float(time[0])
        )
        profile = own_profile(setup)
        coefficients, x0, dx = (
            (profile.coefficients, profile.x0, profile.dx)
            if profile
            else (np.zeros((1, 6)), 0.0, 1.0)
        )
        clamps = np.column_stack([setup.clamp_signal(axis, time) for axis in "xz"]).astype(np.int32)
        outputs = np.empty((len(time), len(OUTPUTS)))
        edge = (profile is not None, coefficients, x0, dx)
        status, done = _replay(
            self._wiring,
            np.ascontiguousarray(commands, float),
            clamps,
            edge,
            (float(time[0]), PERIOD),
            outputs,
        )
        message = self.session.stepped_natively(float(time[0]) + done * PERIOD, status)
        if message:
            raise RunError(f"replay stopped after {done} of {len(time)} samples: {message}")
        return outputs


@kept
def _replay(wiring, commands, clamps, edge, clock, outputs):  # type: ignore[no-untyped-def]
    (
        (component, set_real, set_boolean, get_real, do_step),
        (command_refs, clamp_refs, profile_refs, output_refs),
    ) = wiring
    own, coefficients, x0, dx = edge
    start, period = clock
    four, flags = np.empty(4), np.empty(2, np.int32)
    status = 0
    for k in range(len(commands)):
        if k == 0 or clamps[k, 0] != clamps[k - 1, 0] or clamps[k, 1] != clamps[k - 1, 1]:
            flags[:] = clamps[k]
            status = max(status, native_values(set_boolean, component, clamp_refs, flags))
        if own:
            status = max(status, native_values(get_real, component, output_refs[:1], outputs[k]))
            four[0] = outputs[k, 0]
            four[1], four[2], four[3] = local_profile(coefficients, x0, dx, four[0])
            status = max(status, native_values(set_real, component, profile_refs, four))
        status = max(status, native_values(set_real, component, command_refs, commands[k]))
        status = max(status, native_values(get_real, component, output_refs, outputs[k]))
        status = max(status, call_step(do_step, component, start + k * period, period))
        if status > FMI_WARNING:
            return status, k
    return status, len(commands)
