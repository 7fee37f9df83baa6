"""A block's FMU driven by recorded inputs, whole or in windows that each start from measured
values; no Python per sample.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from modelica_fmu.errors import RunError
from pyfmi_runner.compiled_loop import FMI_WARNING, native_values
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.log import PERIOD
from pyfmi_runner.native import call_plain, call_setup, call_step

__all__ = ["BlockFmu", "Guide"]

Array = NDArray[np.float64]
_WORDS = (
    "SetReal",
    "SetInteger",
    "SetBoolean",
    "GetReal",
    "DoStep",
    "Reset",
    "SetupExperiment",
    "EnterInitializationMode",
    "ExitInitializationMode",
)


class Native(NamedTuple):
    """An FMU instance as compiled code calls it."""

    component: int
    addresses: tuple[int, ...]  # in the order of _WORDS


class Signals(NamedTuple):
    """Variables of an FMU over the samples."""

    references: NDArray[np.uint32]
    values: NDArray[Any]  # (N, variables)


@dataclass(frozen=True)
class Guide:
    """Positions and speeds (N, n) that the first 2 n outputs, positions then speeds, are led to
    through the first n inputs.
    """

    position: Array
    speed: Array
    per_position: Array  # (N, n), input per unit of position error
    per_speed: Sequence[float]


class BlockFmu:
    """One instance of a block's FMU; used in a `with`."""

    def __init__(self, file: FmuFile) -> None:
        self.session = FmuSession(file)
        self.file = file

    def __enter__(self) -> BlockFmu:
        self.session.__enter__()
        self._component = self.session.raw().component
        self._addresses = tuple(self.session.address(word) for word in _WORDS)
        return self

    def __exit__(self, *error: Any) -> None:
        self.session.close()

    def run(
        self,
        parameters: Mapping[str, float],
        inputs: Sequence[str],
        values: Array,
        outputs: Sequence[str],
        windows: NDArray[np.int64] | None = None,
        starts: Mapping[str, Array] | None = None,
    ) -> Array:
        """Outputs (N, len(outputs)) at each sample for inputs (N, len(inputs)) held over the
        millisecond behind it.

        windows: (W, 2) first row and row after the last of each; the block is started again at
        each, with the start values `starts[name][w]`. None: one window over all rows. Rows outside
        every window are NaN. Raises InputError for a value that the FMU refuses, RunError where it
        fails.
        """
        self.session.reset(dict(parameters))  # checks names and bounds
        windows = (
            np.array([[0, len(values)]], dtype=np.int64)
            if windows is None
            else np.ascontiguousarray(windows, dtype=np.int64)
        )
        starts = starts or {}
        start_values = (
            np.column_stack([starts[name] for name in starts])
            if starts
            else np.empty((len(windows), 0))
        )
        result = np.full((len(values), len(outputs)), np.nan)
        start_refs, input_refs, output_refs = (
            self.session.references(tuple(names)) for names in (starts, inputs, outputs)
        )
        status, row = _run_windows(
            Native(self._component, self._addresses),
            self._settings(parameters),
            Signals(start_refs, np.ascontiguousarray(start_values, dtype=np.float64)),
            windows,
            Signals(input_refs, np.ascontiguousarray(values, dtype=np.float64)),
            Signals(output_refs, result),
        )
        return self._whole(result, status, row)

    def run_clamped(
        self,
        parameters: Mapping[str, float],
        inputs: Sequence[str],
        values: Array,
        flags: Sequence[str],
        flag_values: Array,
        outputs: Sequence[str],
    ) -> Array:
        """As `run` over all rows, with Boolean inputs `flags` (N, len(flags)) besides."""
        self.session.reset(dict(parameters))
        result = np.full((len(values), len(outputs)), np.nan)
        references = self.session.references
        status, row = _run_flagged(
            Native(self._component, self._addresses),
            Signals(references(inputs), np.ascontiguousarray(values, dtype=np.float64)),
            Signals(references(flags), np.ascontiguousarray(flag_values).astype(np.int32)),
            Signals(references(outputs), result),
        )
        return self._whole(result, status, row)

    def run_guided(
        self,
        parameters: Mapping[str, float],
        inputs: Sequence[str],
        values: Array,
        flags: Sequence[str],
        flag_values: Array,
        outputs: Sequence[str],
        guide: Guide,
    ) -> Array:
        """As `run_clamped`, with each input led by what `guide` says of the outputs so far: an
        observer around the FMU.
        """
        self.session.reset(dict(parameters))
        result = np.full((len(values), len(outputs)), np.nan)
        references = self.session.references
        status, row = _run_guided(
            Native(self._component, self._addresses),
            Signals(references(inputs), np.ascontiguousarray(values, dtype=np.float64)),
            Signals(references(flags), np.ascontiguousarray(flag_values).astype(np.int32)),
            Signals(references(outputs), result),
            (
                np.ascontiguousarray(guide.position),
                np.ascontiguousarray(guide.speed),
                np.ascontiguousarray(guide.per_position, dtype=np.float64),
                np.asarray(guide.per_speed, dtype=np.float64),
            ),
        )
        return self._whole(result, status, row)

    def _whole(self, result: Array, status: int, row: int) -> Array:
        """The result of a native run, if it came to its end."""
        message = self.session.stepped_natively(0.0, status)
        if message:
            raise RunError(f"{self.file.path.name} failed at row {row}: {message}")
        return result

    def _settings(self, parameters: Mapping[str, float]) -> tuple[Any, ...]:
        """References and values of the parameters by FMI type: Real, Integer (and enumerations),
        Boolean.
        """
        variables = self.file.variables
        by_type: dict[str, list[str]] = {"Real": [], "Integer": [], "Boolean": []}
        for name in parameters:
            kind = variables[name].type
            by_type["Integer" if kind == "Enumeration" else kind].append(name)
        real, integer, boolean = by_type.values()
        return (
            self.session.references(real),
            np.array([parameters[n] for n in real], dtype=np.float64),
            self.session.references(integer),
            np.array([parameters[n] for n in integer], dtype=np.int32),
            self.session.references(boolean),
            np.array([parameters[n] for n in boolean], dtype=np.int32),
        )


@njit(nogil=True)
def _run_windows(native, settings, starts, windows, inputs, outputs):  # type: ignore[no-untyped-def]
    component, addresses = native
    reals, real_values, integers, integer_values, booleans, boolean_values = settings
    set_real, set_integer, set_boolean, get_real, do_step, reset, setup, enter, leave = addresses
    for w in range(len(windows)):
        first, last = windows[w]
        status = call_plain(reset, component)
        status = max(status, native_values(set_real, component, reals, real_values))
        status = max(status, native_values(set_integer, component, integers, integer_values))
        status = max(status, native_values(set_boolean, component, booleans, boolean_values))
        status = max(
            status, native_values(set_real, component, starts.references, starts.values[w])
        )
        status = max(status, call_setup(setup, component, 0.0))
        status = max(status, call_plain(enter, component))
        # inputs come with the first sample: a delay line starts empty
        status = max(status, call_plain(leave, component))
        if status > FMI_WARNING:
            return status, first
        for k in range(first, last):
            status = native_values(set_real, component, inputs.references, inputs.values[k])
            read = native_values(get_real, component, outputs.references, outputs.values[k])
            status = max(status, read)
            status = max(status, call_step(do_step, component, (k - first) * PERIOD, PERIOD))
            if status > FMI_WARNING:
                return status, k
    return 0, len(inputs.values)


@njit(nogil=True)
def _run_flagged(native, inputs, flags, outputs):  # type: ignore[no-untyped-def]
    component = native.component
    set_real, _, set_boolean, get_real, do_step = native.addresses[:5]
    for k in range(len(inputs.values)):
        status = native_values(set_real, component, inputs.references, inputs.values[k])
        if k == 0 or (flags.values[k] != flags.values[k - 1]).any():
            held = native_values(set_boolean, component, flags.references, flags.values[k])
            status = max(status, held)
        read = native_values(get_real, component, outputs.references, outputs.values[k])
        status = max(status, read)
        status = max(status, call_step(do_step, component, k * PERIOD, PERIOD))
        if status > FMI_WARNING:
            return status, k
    return 0, len(inputs.values)


@njit(nogil=True)
def _run_guided(native, inputs, flags, outputs, guide):  # type: ignore[no-untyped-def]
    component = native.component
    set_real, _, set_boolean, get_real, do_step = native.addresses[:5]
    position, speed, per_position, per_speed = guide
    values, result = inputs.values, outputs.values
    count = len(per_speed)
    now = np.empty(values.shape[1])
    for k in range(len(values)):
        status = 0
        if k == 0:
            status = native_values(set_real, component, inputs.references, values[k])
        read = native_values(get_real, component, outputs.references, result[k])
        status = max(status, read)
        now[:] = values[k]
        for i in range(count):
            now[i] += per_position[k, i] * (position[k, i] - result[k, i]) + per_speed[i] * (
                speed[k, i] - result[k, count + i]
            )
        status = max(status, native_values(set_real, component, inputs.references, now))
        if k == 0 or (flags.values[k] != flags.values[k - 1]).any():
            held = native_values(set_boolean, component, flags.references, flags.values[k])
            status = max(status, held)
        status = max(status, call_step(do_step, component, k * PERIOD, PERIOD))
        if status > FMI_WARNING:
            return status, k
    return 0, len(values)
