"""A tiny model, compiled with the simulation core to a shared library and driven through core.h."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from modelica_fmu.compiler import compile_model
from modelica_fmu.package import CSRC

LOG = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)
P, D, U = ctypes.c_void_p, ctypes.c_double, ctypes.c_uint


class Tiny:
    """One instance of a compiled model, driven through core.h."""

    def __init__(self, library: ctypes.CDLL, references: dict[str, int]) -> None:
        self.library, self.references, self.messages = library, references, []
        self._log = LOG(
            lambda _, status, category, text: self.messages.append((status, text.decode()))
        )
        self.core = P(library.core_new(self._log, None))
        self.time = 0.0

    def twin(self) -> Tiny:
        return Tiny(self.library, self.references)

    def set(self, **values: float) -> Tiny:
        for name, value in values.items():
            assert self.library.core_set(self.core, self.references[name], value) == 0, (
                self.messages
            )
        return self

    def get(self, name: str) -> float:
        value = D()
        assert self.library.core_get(self.core, self.references[name], ctypes.byref(value)) == 0
        return value.value

    def start(self, time: float = 0.0) -> Tiny:
        self.time = time
        assert self.library.core_initialise(self.core, time) == 0, self.messages
        return self

    def step(self, length: float) -> int:
        status = self.library.core_step(self.core, self.time, length)
        self.time += length
        return status

    def run(self, until: float, *names: str, step: float = 1e-2) -> np.ndarray:
        """Rows: time, then the named variables."""
        rows = []
        for _ in range(round((until - self.time) / step)):
            assert self.step(step) <= 1, self.messages
            rows.append([self.time, *map(self.get, names)])
        return np.array(rows).T


def library_of(
    text: str | None, folder: Path, name: str = "M", libraries: Sequence[Path] = ()
) -> Tiny:
    """`text`: the Modelica file; None: the class is one of the libraries'."""
    file = None if text is None else folder / "m.mo"
    if file is not None and text is not None:
        file.write_text(text)
    compiled = compile_model(file, name, libraries=libraries)
    for source, content in compiled.sources.items():
        (folder / source).write_text(content)
    flags = [
        "-std=c11",
        "-O0",
        "-Wall",
        "-Werror",
        "-Wno-unused",
        "-ffp-contract=off",
        "-shared",
        "-fPIC",
        "-I.",
        f"-I{CSRC}",
    ]
    done = subprocess.run(
        ["cc", *flags, "-o", "m.so", "model.c", str(CSRC / "core.c"), "-lm"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    library = ctypes.CDLL(str(folder / "m.so"))
    library.core_new.restype = P
    library.core_new.argtypes = [LOG, P]
    library.core_set.argtypes = [P, U, D]
    library.core_get.argtypes = [P, U, ctypes.POINTER(D)]
    library.core_initialise.argtypes = [P, D]
    library.core_step.argtypes = [P, D, D]
    return Tiny(library, {v.name: i for i, v in enumerate(compiled.variables)})
