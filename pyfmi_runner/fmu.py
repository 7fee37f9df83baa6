"""Running an FMU: `with FmuSession(FmuFile.read(path), parameters={...}) as fmu: fmu.set(...);
fmu.step(1e-3)`.

The legal call order is the table LEGAL; a call out of order is a RunError and does not reach the
FMU. This is the one file that imports fmpy, which loads the shared library and types its functions.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from ctypes import c_double
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, overload

import fmpy
import fmpy.fmi2
import fmpy.fmi3
import numpy as np
from numpy.typing import NDArray

from modelica_fmu.errors import InputError, RunError
from pyfmi_runner.fmu_calls import EventInfo, Fmi2, Fmi3, FmuCallError, Library, Message
from pyfmi_runner.fmu_file import FmuFile, FmuVariable, Kind
from pyfmi_runner.fmu_values import Value, Values

__all__ = [
    "EventInfo",
    "FmuFile",
    "FmuSession",
    "FmuVariable",
    "Layout",
    "Message",
    "RawInstance",
    "SavedState",
]

_FAILED = frozenset({"get", "reset", "load_state", "deserialise"})
_RUNNING = _FAILED | {"set", "save_state", "directional"}
_EXCHANGE = _RUNNING | {"states", "derivatives", "indicators", "nominals"}
LEGAL: dict[str, frozenset[str]] = {  # phase -> methods
    "closed": frozenset(),
    "ready": _RUNNING | {"step", "raw"},  # co-simulation, at a communication point
    "event": _EXCHANGE | {"update_discrete", "enter_continuous"},  # model exchange
    "continuous": _EXCHANGE | {"set_time", "set_states", "completed_step", "enter_event"},
    "failed": _FAILED,  # after an error of the FMU
}
_PHASES = tuple(LEGAL)
_HEADER = struct.Struct("<4sBd")  # of serialised states: magic, phase, time
_MAGIC = b"PGs1"


class RawInstance(NamedTuple):
    """Addresses for compiled loops (FMI 2.0): the component, fmi2SetReal, fmi2SetBoolean,
    fmi2DoStep, fmi2GetReal.
    """

    component: int
    set_real: int
    set_boolean: int
    do_step: int
    get_real: int


class Layout(NamedTuple):
    """Variables of one type out of a list of names."""

    word: str  # behind "Set" and "Get" in the functions' names
    references: NDArray[np.uint32]
    dtype: np.dtype[Any]
    positions: tuple[int, ...]  # in the list


class SavedState:
    """A saved FMU state; belongs to its session and ends with it."""

    def __init__(self, pointer: Any, phase: str, time: float) -> None:
        self.pointer, self.phase, self.time = pointer, phase, time


class FmuSession:
    """One instance of an FMU, initialised and ready between `with` and its end.

    kind: "cs" co-simulation or "me" model exchange; parameters: parameters, inputs and start values
    by name, set before the initialisation; start_time, stop_time: s. In the `with` statement:
    InputError for a file or parameter that cannot be used. Any call: RunError with the FMU's
    message when the FMU fails; then the phase is "failed".
    """

    def __init__(
        self,
        file: FmuFile | str | Path,
        kind: Kind = "cs",
        parameters: Mapping[str, Value] | None = None,
        start_time: float = 0.0,
        *,
        stop_time: float | None = None,
        log_events: bool = False,
    ) -> None:
        self.file = file if isinstance(file, FmuFile) else FmuFile.read(file)
        self.kind: Kind = kind
        self.parameters = dict(parameters or {})
        self.start_time, self.stop_time = float(start_time), stop_time
        self.time = self.start_time
        self._log_events = log_events
        self._phase = "closed"
        self._saved: dict[int, SavedState] = {}
        self._fmu: Fmi2 | Fmi3
        self._values: Values

    def __enter__(self) -> FmuSession:
        if self._phase != "closed":
            raise RunError("this FMU session is already open")
        library = _library(self.file.library(self.kind), self.file.description.fmi, self.kind)
        version = Fmi2 if self.file.description.fmi == "2.0" else Fmi3
        try:
            self._fmu = version(library, self.file, self.kind, self._log_events)
        except FmuCallError as failure:
            raise InputError(
                f"cannot be instantiated: {failure.text}",
                file=self.file.path,
                hint="build it again",
            ) from None
        self._values = Values(self.file, self._fmu)
        try:
            self._initialise(self.parameters)
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self,
        _: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Frees the instance and its saved states; again is no error."""
        if not hasattr(self, "_fmu") or self._fmu.component is None:
            return
        try:
            for state in self._saved.values():
                self._fmu.release(state.pointer)
            if self._phase in ("ready", "event", "continuous"):
                self._fmu.call("Terminate")
        except FmuCallError:
            pass  # it is being freed
        self._saved.clear()
        self._phase = "closed"
        self._fmu.free()

    def messages(self) -> list[Message]:
        """What the FMU logged since the last call (warnings; events if `log_events`)."""
        return self._fmu.drain()

    # ---- variables ----

    @overload
    def set(self, names: str, values: Value) -> None: ...
    @overload
    def set(self, names: Sequence[str], values: Sequence[Value] | NDArray[np.float64]) -> None: ...
    @overload
    def set(self, names: Mapping[str, Value]) -> None: ...
    def set(self, names: Any, values: Any = None) -> None:
        """One variable, several, or a mapping; InputError for a name, type or value that the FMU
        does not take.
        """
        self._require("set")
        if isinstance(names, Mapping):
            names, values = tuple(names), tuple(names.values())
        elif isinstance(names, str):
            names, values = (names,), (values,)
        else:
            names = tuple(names)
        self._values.check_running(names)
        self._write(names, values)

    @overload
    def get(self, names: str) -> float: ...
    @overload
    def get(self, names: tuple[str, ...] | list[str]) -> NDArray[np.float64]: ...
    def get(self, names: Any) -> Any:
        """The value of one variable (float, or int or bool as its type is), or an array of floats
        for several.
        """
        self._require("get")
        if isinstance(names, str):
            return self._guard(self._values.read_one, names)
        return self._guard(self._values.read, tuple(names))

    # ---- co-simulation ----

    def step(self, step: float, *, time: float | None = None) -> None:
        """Advances by `step` s from `time` (s; where it is if None; a loop gives k * dt to keep
        rounding out).
        """
        self._require("step")
        self.time = self._guard(self._fmu.do_step, self.time if time is None else time, step)

    def reset(
        self, parameters: Mapping[str, Value] | None = None, start_time: float | None = None
    ) -> None:
        """The state after `with` again, with the same parameters if None; the library stays
        loaded.
        """
        self._require("reset")
        chosen = self.parameters if parameters is None else dict(parameters)
        self._values.check_start(chosen)
        self.start_time = self.start_time if start_time is None else float(start_time)
        self._guard(self._fmu.call, "Reset")
        self._initialise(chosen)
        self.parameters = chosen

    def raw(self) -> RawInstance:
        """Addresses for compiled loops; such a loop ends with `stepped_natively`. FMI 2.0
        co-simulation only.
        """
        self._require("raw")
        if not isinstance(self._fmu, Fmi2):
            hint = "build it with `pneugantry build --fmi 2.0`"
            raise InputError("compiled loops need FMI 2.0", file=self.file.path, hint=hint)
        words = ("SetReal", "SetBoolean", "DoStep", "GetReal")
        return RawInstance(
            int(self._fmu.component or 0), *(self._fmu.address(word) for word in words)
        )

    @property
    def component(self) -> int:
        """Address of the instance, for compiled loops of either FMI version."""
        self._require("raw")
        return int(self._fmu.component or 0)

    def layout(self, names: Sequence[str]) -> list[Layout]:
        """Variables by type, as compiled loops pass them. Raises InputError for an unknown name and
        for a type that is no number.
        """
        return [
            Layout(
                group.word,
                np.array(group.references, dtype=np.uint32),
                np.dtype(group.values._type_),
                tuple(group.positions),
            )
            for group in self._values.grouped(tuple(names))
        ]

    def address(self, word: str) -> int:
        """Address of an FMI function by the word behind its prefix, "Reset" for fmi2Reset."""
        self._require("raw")
        return self._fmu.address(word)

    def references(self, names: Sequence[str]) -> NDArray[np.uint32]:
        """Value references for compiled loops; InputError for an unknown name."""
        return np.array([self._values.variable(name).reference for name in names], dtype=np.uint32)

    def stepped_natively(self, time: float, status: int = 0) -> str:
        """Takes over from a compiled loop that came to `time` s; for a failed `status` returns what
        the FMU said.
        """
        self.time = time
        if status <= 1:
            return ""
        self._phase = "failed"
        return FmuCallError("fmi2DoStep", status, self._fmu.drain()).text

    # ---- FMU states ----

    def save_state(self, into: SavedState | None = None) -> SavedState:
        """The complete state; `into` reuses an earlier one's memory."""
        self._require("save_state")
        if into is not None and id(into) not in self._saved:
            raise RunError("this saved state is not of this FMU session")
        pointer = self._guard(self._fmu.save, into.pointer if into else None)
        state = into or SavedState(pointer, self._phase, self.time)
        state.phase, state.time = self._phase, self.time
        self._saved[id(state)] = state
        return state

    def load_state(self, state: SavedState) -> None:
        self._require("load_state")
        if id(state) not in self._saved:
            raise RunError("this saved state is not of this FMU session")
        self._guard(self._fmu.load, state.pointer)
        self._phase, self.time = state.phase, state.time

    def free_state(self, state: SavedState) -> None:
        """Gives a saved state's memory back before the session ends."""
        if self._saved.pop(id(state), None) is not None:
            self._guard(self._fmu.release, state.pointer)

    def serialise(self) -> bytes:
        """The complete state as bytes, for the same build of the FMU."""
        state = self.save_state()
        try:
            content: bytes = self._guard(self._fmu.serialise, state.pointer)
            return _HEADER.pack(_MAGIC, _PHASES.index(state.phase), state.time) + content
        finally:
            self.free_state(state)

    def deserialise(self, data: bytes) -> SavedState:
        """A saved state from `serialise`, for `load_state`; InputError if damaged or not of this
        build of the FMU.
        """
        self._require("deserialise")
        hint = "save the state again with this build of the FMU"
        if len(data) <= _HEADER.size or data[:4] != _MAGIC or data[4] not in range(1, len(_PHASES)):
            raise InputError("these bytes are no serialised FMU state", hint=hint)
        _, phase, time = _HEADER.unpack_from(data)
        try:
            pointer = self._fmu.deserialise(data[_HEADER.size :])
        except FmuCallError as failure:
            self._phase = "failed"
            raise InputError(failure.text, file=self.file.path, hint=hint) from None
        state = SavedState(pointer, _PHASES[phase], time)
        self._saved[id(state)] = state
        return state

    # ---- derivatives ----

    def directional(
        self, unknowns: Sequence[str], knowns: Sequence[str], seed: Sequence[float]
    ) -> NDArray[np.float64]:
        """sum_j d unknown_i / d known_j * seed_j; unknowns: derivatives, outputs; knowns: states,
        inputs.
        """
        self._require("directional")
        references = [self._values.variable(name).reference for name in (*unknowns, *knowns)]
        n = len(unknowns)
        return np.array(
            self._guard(self._fmu.directional, references[:n], references[n:], list(seed))
        )

    def jacobian(self, unknowns: Sequence[str], knowns: Sequence[str]) -> NDArray[np.float64]:
        """d unknowns / d knowns, one directional derivative a column."""
        columns = [self.directional(unknowns, [known], [1.0]) for known in knowns]
        return np.array(columns).T.reshape(len(unknowns), len(knowns))

    # ---- model exchange ----

    def states(self) -> NDArray[np.float64]:
        return self._vector("states", "GetContinuousStates", len(self.file.description.states))

    def derivatives(self) -> NDArray[np.float64]:
        word = (
            "GetDerivatives"
            if self.file.description.fmi == "2.0"
            else "GetContinuousStateDerivatives"
        )
        return self._vector("derivatives", word, len(self.file.description.states))

    def nominals(self) -> NDArray[np.float64]:
        return self._vector(
            "nominals", "GetNominalsOfContinuousStates", len(self.file.description.states)
        )

    def indicators(self) -> NDArray[np.float64]:
        return self._vector("indicators", "GetEventIndicators", self.file.description.n_indicators)

    def set_time(self, time: float) -> None:
        self._require("set_time")
        self._guard(self._fmu.call, "SetTime", time)
        self.time = time

    def set_states(self, values: Sequence[float] | NDArray[np.float64]) -> None:
        self._require("set_states")
        self._guard(self._fmu.set_states, (c_double * len(values))(*values), len(values))

    def completed_step(self) -> tuple[bool, bool]:
        """(enter event mode, terminate)."""
        self._require("completed_step")
        result: tuple[bool, bool] = self._guard(self._fmu.completed_step)
        return result

    def enter_event(self) -> None:
        self._require("enter_event")
        self._guard(self._fmu.call, "EnterEventMode")
        self._phase = "event"

    def update_discrete(self) -> EventInfo:
        self._require("update_discrete")
        info: EventInfo = self._guard(self._fmu.update_discrete)
        return info

    def enter_continuous(self) -> None:
        self._require("enter_continuous")
        self._guard(self._fmu.call, "EnterContinuousTimeMode")
        self._phase = "continuous"

    # ---- within ----

    def _require(self, method: str) -> None:
        if method not in LEGAL[self._phase]:
            legal = ", ".join(sorted(LEGAL[self._phase])) or "nothing but `with`"
            raise RunError(
                f"{method} is not possible while the FMU session is {self._phase}; "
                f"possible: {legal}"
            )

    def _guard(self, function: Any, *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except FmuCallError as failure:
            if failure.status > 2:  # after a discard the FMU is as before
                self._phase = "failed"
            raise RunError(
                f"{self.file.path.name} at t = {self.time:.9g} s: {failure.text}"
            ) from None

    def _write(self, names: tuple[str, ...], values: Sequence[Value]) -> None:
        try:
            self._guard(self._values.write, names, values)
        except InputError as error:
            if isinstance(error.__cause__, FmuCallError) and error.__cause__.status > 2:
                self._phase = "failed"
            raise

    def _initialise(self, parameters: Mapping[str, Value]) -> None:
        """Parameters, then Initialization Mode; then the session is ready (co-simulation) or in
        event mode.
        """
        self._phase, self.time = "failed", self.start_time
        self._values.check_start(parameters)
        self._write(tuple(parameters), tuple(parameters.values()))
        self._guard(self._fmu.initialise, self.start_time, self.stop_time)
        self._guard(self._fmu.call, "ExitInitializationMode")
        self._phase = "ready" if self.kind == "cs" else "event"

    def _vector(self, method: str, word: str, n: int) -> NDArray[np.float64]:
        self._require(method)
        return np.array(self._guard(self._fmu.vector, word, n))


@lru_cache(maxsize=64)
def _library(path: Path, fmi: str, kind: Kind) -> Library:
    """Loaded once a process and kept: instances share the code, never data."""
    classes = {
        ("2.0", "cs"): fmpy.fmi2.FMU2Slave,
        ("2.0", "me"): fmpy.fmi2.FMU2Model,
        ("3.0", "cs"): fmpy.fmi3.FMU3Slave,
        ("3.0", "me"): fmpy.fmi3.FMU3Model,
    }
    folder = path.parents[2]
    arguments = {
        "guid": "",
        "modelIdentifier": path.stem,
        "unzipDirectory": str(folder),
        "instanceName": "",
    }
    try:
        loaded = classes[fmi, kind](libraryPath=str(path), **arguments)
    except (
        Exception
    ) as error:  # fmpy raises bare Exception; a library without the functions is an AttributeError
        raise InputError(
            f"the shared library cannot be loaded: {error}", file=path, hint="build the FMU again"
        ) from None
    resources = folder / "resources"
    if fmi == "2.0":
        return Library(loaded.dll, resources.as_uri(), fmpy.fmi2.fmi2CallbackLoggerTYPE, _callbacks)
    return Library(
        loaded.dll, f"{resources}/", fmpy.fmi3.fmi3LogMessageCallback, lambda logger: None
    )


def _callbacks(logger: Any) -> Any:
    callbacks = fmpy.fmi2.fmi2CallbackFunctions()
    callbacks.logger = logger
    callbacks.allocateMemory = fmpy.fmi2.defaultCallbacks.allocateMemory
    callbacks.freeMemory = fmpy.fmi2.defaultCallbacks.freeMemory
    return callbacks
