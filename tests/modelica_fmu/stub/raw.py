"""The stub's C functions, called directly: every status is seen, nothing is checked on the way."""

import ctypes
from ctypes import byref, c_bool, c_double, c_int, c_uint, c_void_p
from functools import cache
from typing import Any

from stub_model import stub_fmu

from pyfmi_runner.fmu import FmuFile, _library

OK, WARNING, DISCARD, ERROR, FATAL = range(5)
TIME, MASS, DRAG, MEDIUM, COUNT, WEIGHT, FORCE, ON, H, V, DER_H, DER_V, Y, A, BOUNCES = (
    0,
    1,
    3,
    *range(5, 17),
)


def references(*values: int) -> Any:
    return (c_uint * len(values))(*values)


@cache
def _file(fmi: str) -> FmuFile:
    return FmuFile.read(stub_fmu(fmi))


def _collector(messages: list[tuple[int, str, str]]) -> Any:
    def log(_environment: Any, *rest: Any) -> None:
        status, category, message = rest[-3:]
        messages.append((status, category.decode(), message.decode()))

    return log


class Raw:
    """One instance.

    Phases: I instantiated, M initialization mode, E event, C continuous-time, S step, T terminated,
    X error.
    """

    def __init__(
        self,
        fmi: str,
        kind: str,
        *,
        token: str | None = None,
        name: str = "it",
        logging: bool = True,
    ) -> None:
        self.fmi, self.kind, self.prefix = fmi, kind, f"fmi{fmi[0]}"
        self.file = _file(fmi)
        self.library = _library(self.file.library(kind), fmi, kind)
        other = _library(self.file.library(kind), fmi, "me" if kind == "cs" else "cs")
        self.dll, self.other = (
            self.library.dll,
            other.dll,
        )  # the binding types the functions of one interface only
        self.messages: list[tuple[int, str, str]] = []
        token = self.file.description.token if token is None else token
        self.logger = self.library.logger_type(_collector(self.messages))  # knows no Raw: no cycle
        if fmi == "2.0":
            self.callbacks = self.library.callbacks(self.logger)
            kinds = {"me": 0, "cs": 1}
            arguments = (
                name.encode(),
                kinds[kind],
                token.encode(),
                b"",
                byref(self.callbacks),
                0,
                int(logging),
            )
            self.component = self.dll.fmi2Instantiate(*arguments)
        else:
            common = (name.encode(), token.encode(), None, False, logging)
            if kind == "me":
                self.component = self.dll.fmi3InstantiateModelExchange(*common, None, self.logger)
            else:
                update = self.dll.fmi3InstantiateCoSimulation.argtypes[-1]()
                rest = (False, False, None, 0, None, self.logger, update)
                self.component = self.dll.fmi3InstantiateCoSimulation(*common, *rest)

    def call(self, word: str, *arguments: Any) -> int:
        function = getattr(self.dll, self.prefix + word)
        if function.argtypes is None:
            function = getattr(self.other, self.prefix + word)
        typed = list(arguments)
        for k, (argument, ctype) in enumerate(zip(arguments, function.argtypes[1:], strict=True)):
            if argument is not None and hasattr(
                ctype, "contents"
            ):  # a pointer to something: any pointer will do
                typed[k] = ctypes.cast(argument, ctype)
        return function(self.component, *typed)

    def free(self) -> None:
        getattr(self.dll, self.prefix + "FreeInstance")(self.component)

    def get(
        self, reference: int, word: str | None = None, ctype: Any = c_double
    ) -> tuple[int, Any]:
        value = (ctype * 1)()
        extra = () if self.fmi == "2.0" else (1,)
        word = word or ("GetReal" if self.fmi == "2.0" else "GetFloat64")
        status = self.call(word, references(reference), 1, value, *extra)
        return status, value[0]

    def set(
        self, reference: int, value: Any, word: str | None = None, ctype: Any = c_double
    ) -> int:
        extra = () if self.fmi == "2.0" else (1,)
        word = word or ("SetReal" if self.fmi == "2.0" else "SetFloat64")
        return self.call(word, references(reference), 1, (ctype * 1)(value), *extra)

    def setup(self, start: float = 0.0, stop: float | None = None) -> int:
        if self.fmi == "2.0":
            status = self.call("SetupExperiment", 0, 0.0, start, int(stop is not None), stop or 0.0)
            return max(status, self.call("EnterInitializationMode"))
        return self.call(
            "EnterInitializationMode", False, 0.0, start, stop is not None, stop or 0.0
        )

    def step(self, time: float, step: float) -> int:
        if self.fmi == "2.0":
            return self.call("DoStep", time, step, 1)
        flags = [c_bool() for _ in range(3)]
        self.last = c_double()
        return self.call("DoStep", time, step, True, *(byref(f) for f in flags), byref(self.last))

    def update_discrete(self) -> int:
        if self.fmi == "2.0":
            return self.call("NewDiscreteStates", byref((c_int * 16)()))
        return self.call(
            "UpdateDiscreteStates", *(byref(c_bool()) for _ in range(5)), byref(c_double())
        )

    def go(self, phase: str) -> "Raw":
        """Into a phase, from Instantiated, by legal calls."""
        if phase == "X":
            assert self.get(10**6)[0] == ERROR
            return self
        if phase == "I":
            return self
        assert self.setup() == OK
        if phase == "M":
            return self
        assert self.call("ExitInitializationMode") == OK
        if phase == "C":
            assert self.update_discrete() == OK
            assert self.call("EnterContinuousTimeMode") == OK
        if phase == "T":
            assert self.call("Terminate") == OK
        return self

    def saved(self) -> c_void_p:
        pointer = c_void_p()
        assert (
            self.call("GetFMUstate" if self.fmi == "2.0" else "GetFMUState", byref(pointer)) == OK
        )
        return pointer
