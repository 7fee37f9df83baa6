"""A Modelica text as the compiler has it: its C with the simulation core, driven through core.h."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path

import numpy as np

from modelica_fmu.compiler import compile_model
from modelica_fmu.package import CSRC
from modelica_fmu.toolchain import find_compiler, host_platform

TIGHT = {"solver.tolerance": 1e-9, "solver.max_step": 2e-4}  # jumps without events are not located
LOG = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)


class Stopped(Exception):
    """The core ended the run and said why."""


def run(text: str, names: list[str], times: np.ndarray, folder: Path) -> dict[str, np.ndarray]:
    """Values by name at times, s. InputError where the compiler refuses, Stopped where the run
    does, KeyError for a name that the model has not.
    """
    file = folder / "m.mo"
    file.write_text(text, encoding="utf-8")
    compiled = compile_model(file, "M")
    places = {v.name: i for i, v in enumerate(compiled.variables)}
    library, said = _library(compiled.sources, folder), []

    def log(_: object, status: int, category: bytes, message: bytes) -> None:
        said.append(message.decode())

    kept = LOG(log)
    core = ctypes.c_void_p(library.core_new(kept, None))
    try:
        for name, value in TIGHT.items():
            library.core_set(core, places[name], ctypes.c_double(value))
        if library.core_initialise(core, ctypes.c_double(0.0)) > 1:
            raise Stopped(said[-1])
        rows, now = [], 0.0
        for time in times:
            if library.core_step(core, ctypes.c_double(now), ctypes.c_double(time - now)) > 1:
                raise Stopped(said[-1])
            now = time
            rows.append([_value(library, core, places[name]) for name in names])
    finally:
        library.core_free(core)
    return dict(zip(names, np.array(rows, float).T, strict=True))


def _value(library: ctypes.CDLL, core: ctypes.c_void_p, place: int) -> float:
    value = ctypes.c_double()
    if library.core_get(core, place, ctypes.byref(value)) > 1:
        return float("nan")
    return value.value


def _library(sources: dict[str, str], folder: Path) -> ctypes.CDLL:
    for name, text in sources.items():
        (folder / name).write_text(text, encoding="utf-8")
    built = folder / "model.so"
    command = [
        *find_compiler(host_platform()).command,
        *("-std=c11", "-O0", "-ffp-contract=off", "-shared", "-fPIC", f"-I{CSRC}", f"-I{folder}"),
        *(str(folder / "model.c"), str(CSRC / "core.c"), "-lm", "-o", str(built)),
    ]
    subprocess.run(command, check=True, capture_output=True, text=True)
    library = ctypes.CDLL(str(built))
    library.core_new.restype = ctypes.c_void_p
    return library
