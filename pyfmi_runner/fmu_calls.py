"""The functions of FMI 2.0 and FMI 3.0 behind one interface. No call order here: `pyfmi_runner.fmu`
keeps that.

An instance owns the FMU's component, its callbacks and the log messages since the last call of
`drain`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from ctypes import byref, c_bool, c_double, c_int, c_size_t, c_uint, c_void_p
from types import MappingProxyType
from typing import Any, NamedTuple

from pyfmi_runner.fmu_file import FmuFile, Kind

_STATUS = ("OK", "warning", "discard", "error", "fatal", "pending")
_MAX_MESSAGES = 1000


class Library(NamedTuple):
    """A loaded shared library with typed functions, and the binding's types of the callbacks."""

    dll: Any
    resources: str  # what the FMI version wants: a URI or a path with a trailing separator
    logger_type: Any
    callbacks: Callable[[Any], Any]  # logger -> structure of callbacks (FMI 2.0)


class Message(NamedTuple):
    status: int
    category: str
    text: str


class EventInfo(NamedTuple):
    again: bool
    terminate: bool
    nominals_changed: bool
    states_changed: bool
    next_time: float | None


class FmuCallError(Exception):
    """A call that returned a discard or worse; `text` is what the FMU logged."""

    def __init__(self, function: str, status: int, messages: Sequence[Message]) -> None:
        self.function, self.status = function, status
        text = "; ".join(message.text for message in messages if message.status > 0)
        name = _STATUS[status] if 0 <= status < len(_STATUS) else f"status {status}"
        self.text = text or f"{function} returned {name} without a message"
        super().__init__(self.text)


class Instance:
    """What both versions share; Fmi2 and Fmi3 fill in the rest."""

    prefix = ""
    state_word = ""
    getters: Mapping[str, tuple[str, Any]] = MappingProxyType(
        {}
    )  # variable type -> (word in the function name, C type)

    def __init__(self, library: Library, file: FmuFile, kind: Kind, log_events: bool) -> None:
        self.dll, self.kind, self.component = library.dll, kind, None
        self._messages: list[Message] = []
        self._logger = library.logger_type(
            _collector(self._messages, with_name=self.prefix == "fmi2")
        )
        self.component = self._instantiate(
            library, file, file.identifier(kind).encode(), log_events
        )
        if not self.component:
            raise FmuCallError(f"{self.prefix}Instantiate", 3, self.drain())
        self._choose_log(file, log_events)

    def _instantiate(self, library: Library, file: FmuFile, name: bytes, log_events: bool) -> Any:
        raise NotImplementedError

    def _choose_log(self, file: FmuFile, log_events: bool) -> None:
        declared = set(file.description.log_categories)
        wanted = [f"logStatus{word}" for word in ("Warning", "Discard", "Error", "Fatal")]
        names = [
            c.encode() for c in [*wanted, *(["logEvents"] if log_events else [])] if c in declared
        ]
        if names:
            self.call("SetDebugLogging", False, 0, None)
            self.call("SetDebugLogging", True, len(names), (ctypes.c_char_p * len(names))(*names))

    def drain(self) -> list[Message]:
        messages = self._messages[:]
        self._messages.clear()
        return messages

    def call(self, word: str, *arguments: Any) -> None:
        function = self.prefix + word
        status = getattr(self.dll, function)(self.component, *arguments)
        if status > 1:
            raise FmuCallError(function, status, self.drain())

    def free(self) -> None:
        if self.component:
            getattr(self.dll, self.prefix + "FreeInstance")(self.component)
            self.component = None

    def address(self, word: str) -> int:
        return ctypes.cast(getattr(self.dll, self.prefix + word), c_void_p).value or 0

    # FMU states

    def save(self, pointer: Any = None) -> Any:
        pointer = c_void_p() if pointer is None else pointer
        self.call(f"Get{self.state_word}", byref(pointer))
        return pointer

    def load(self, pointer: Any) -> None:
        self.call(f"Set{self.state_word}", pointer)

    def release(self, pointer: Any) -> None:
        self.call(f"Free{self.state_word}", byref(pointer))

    def serialise(self, pointer: Any) -> bytes:
        size = c_size_t()
        self.call(f"Serialized{self.state_word}Size", pointer, byref(size))
        buffer = self._bytes(size.value)
        self.call(f"Serialize{self.state_word}", pointer, buffer, size)
        return bytes(buffer.raw if hasattr(buffer, "raw") else buffer)

    def deserialise(self, data: bytes) -> Any:
        pointer, buffer = c_void_p(), self._bytes(len(data))
        ctypes.memmove(buffer, data, len(data))
        word = "DeSerialize" if self.prefix == "fmi2" else "Deserialize"
        self.call(word + self.state_word, buffer, len(data), byref(pointer))
        return pointer

    def _bytes(self, size: int) -> Any:
        raise NotImplementedError

    # model exchange: functions with the same form in both versions

    def vector(self, word: str, n: int) -> Any:
        values = (c_double * n)()
        self.call(word, values, n)
        return values

    def set_states(self, values: Any, n: int) -> None:
        self.call("SetContinuousStates", values, n)

    def completed_step(self) -> tuple[bool, bool]:
        boolean = c_int if self.prefix == "fmi2" else c_bool
        event, terminate = boolean(), boolean()
        self.call("CompletedIntegratorStep", False, byref(event), byref(terminate))
        return bool(event.value), bool(terminate.value)


def _collector(messages: list[Message], with_name: bool) -> Callable[..., None]:
    """A logger that knows the list only, so that no cycle keeps an instance alive."""

    def add(status: int, category: bytes | None, message: bytes | None) -> None:
        text = (message or b"").decode("utf-8", "replace").replace("%%", "%").replace("##", "#")
        if len(messages) < _MAX_MESSAGES:
            messages.append(Message(status, (category or b"").decode("utf-8", "replace"), text))

    if with_name:
        return lambda _environment, _name, status, category, message: add(status, category, message)
    return lambda _environment, status, category, message: add(status, category, message)


class Fmi2(Instance):
    prefix = "fmi2"
    state_word = "FMUstate"
    getters = MappingProxyType(
        {
            "Real": ("Real", c_double),
            "Integer": ("Integer", c_int),
            "Enumeration": ("Integer", c_int),
            "Boolean": ("Boolean", c_int),
        }
    )

    def _instantiate(self, library: Library, file: FmuFile, name: bytes, log_events: bool) -> Any:
        self._callbacks = library.callbacks(self._logger)
        return library.dll.fmi2Instantiate(
            name,
            1 if self.kind == "cs" else 0,
            file.description.token.encode(),
            library.resources.encode(),
            byref(self._callbacks),
            0,
            int(log_events),
        )

    def initialise(self, start: float, stop: float | None) -> None:
        self.call("SetupExperiment", 0, 0.0, start, int(stop is not None), stop or 0.0)
        self.call("EnterInitializationMode")

    def set_values(self, word: str, references: Any, n: int, values: Any) -> None:
        self.call("Set" + word, references, n, values)

    def get_values(self, word: str, references: Any, n: int, values: Any) -> None:
        self.call("Get" + word, references, n, values)

    def do_step(self, time: float, step: float) -> float:
        status = self.dll.fmi2DoStep(self.component, time, step, 0)
        if status > 1:
            raise FmuCallError("fmi2DoStep", status, self.drain())
        return time + step

    def directional(
        self, unknowns: Sequence[int], knowns: Sequence[int], seed: Sequence[float]
    ) -> Any:
        m, n = len(unknowns), len(knowns)
        out = (c_double * m)()
        references = (c_uint * m)(*unknowns), m, (c_uint * n)(*knowns), n
        self.call("GetDirectionalDerivative", *references, (c_double * n)(*seed), out)
        return out

    def update_discrete(self) -> EventInfo:
        info = _EventInfo2()
        pointer = self.dll.fmi2NewDiscreteStates.argtypes[1]
        self.call("NewDiscreteStates", ctypes.cast(byref(info), pointer))
        next_time = info.next_time if info.next_time_defined else None
        return EventInfo(
            bool(info.again),
            bool(info.terminate),
            bool(info.nominals),
            bool(info.states),
            next_time,
        )

    def _bytes(self, size: int) -> Any:
        return ctypes.create_string_buffer(size)


class _EventInfo2(ctypes.Structure):
    _fields_ = [
        ("again", c_int),
        ("terminate", c_int),
        ("nominals", c_int),
        ("states", c_int),
        ("next_time_defined", c_int),
        ("next_time", c_double),
    ]


class Fmi3(Instance):
    prefix = "fmi3"
    state_word = "FMUState"
    getters = MappingProxyType(
        {
            "Float64": ("Float64", c_double),
            "Float32": ("Float32", ctypes.c_float),
            **{
                f"Int{bits}": (f"Int{bits}", getattr(ctypes, f"c_int{bits}"))
                for bits in (8, 16, 32, 64)
            },
            **{
                f"UInt{bits}": (f"UInt{bits}", getattr(ctypes, f"c_uint{bits}"))
                for bits in (8, 16, 32, 64)
            },
            "Enumeration": ("Int64", ctypes.c_int64),
            "Boolean": ("Boolean", c_bool),
        }
    )

    def _instantiate(self, library: Library, file: FmuFile, name: bytes, log_events: bool) -> Any:
        del (
            log_events
        )  # with logging off FMI 3.0 is silent on errors too; categories are chosen afterwards
        common = name, file.description.token.encode(), library.resources.encode(), False, True
        if self.kind == "me":
            return library.dll.fmi3InstantiateModelExchange(*common, None, self._logger)
        no_update = library.dll.fmi3InstantiateCoSimulation.argtypes[-1]()
        return library.dll.fmi3InstantiateCoSimulation(
            *common, False, False, None, 0, None, self._logger, no_update
        )

    def initialise(self, start: float, stop: float | None) -> None:
        self.call("EnterInitializationMode", False, 0.0, start, stop is not None, stop or 0.0)

    def set_values(self, word: str, references: Any, n: int, values: Any) -> None:
        self.call("Set" + word, references, n, values, n)

    def get_values(self, word: str, references: Any, n: int, values: Any) -> None:
        self.call("Get" + word, references, n, values, n)

    def do_step(self, time: float, step: float) -> float:
        event, terminate, early, last = c_bool(), c_bool(), c_bool(), c_double()
        flags = byref(event), byref(terminate), byref(early)
        status = self.dll.fmi3DoStep(self.component, time, step, False, *flags, byref(last))
        if status > 1:
            raise FmuCallError("fmi3DoStep", status, self.drain())
        return last.value

    def directional(
        self, unknowns: Sequence[int], knowns: Sequence[int], seed: Sequence[float]
    ) -> Any:
        m, n = len(unknowns), len(knowns)
        out = (c_double * m)()
        references = (c_uint * m)(*unknowns), m, (c_uint * n)(*knowns), n
        self.call("GetDirectionalDerivative", *references, (c_double * n)(*seed), n, out, m)
        return out

    def update_discrete(self) -> EventInfo:
        flags, next_time = [c_bool() for _ in range(5)], c_double()
        self.call("UpdateDiscreteStates", *(byref(flag) for flag in flags), byref(next_time))
        again, terminate, nominals, states, defined = (flag.value for flag in flags)
        return EventInfo(again, terminate, nominals, states, next_time.value if defined else None)

    def _bytes(self, size: int) -> Any:
        return (ctypes.c_uint8 * size)()
