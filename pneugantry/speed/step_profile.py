"""Where a step's time goes: the FMU rebuilt from its own sources with counters (`profile.c`), and
each function timed by itself.
"""

from __future__ import annotations

import ctypes
import tempfile
import zipfile
from ctypes import c_double, c_int, c_int64, c_size_t, c_void_p
from pathlib import Path
from typing import Any

import numpy as np

from modelica_fmu.errors import InputError
from modelica_fmu.toolchain import compile_library, find_compiler, host_platform
from pneugantry.speed.paths import Experiment
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.plant import COMMANDS, OUTPUTS
from pyfmi_runner.scenario import Scenario

__all__ = ["profile_step"]

COUNTED = (
    "model_rates",
    "model_outputs",
    "model_conditions",
    "model_updates",
    "model_delays",
    "model_check",
)
GET, SET = len(COUNTED), len(COUNTED) + 1
REPEATS = 200_000


def profile_step(file: FmuFile) -> list[dict[str, Any]]:
    """Rows of calls a step, ns a call, ns a step and share: the model's functions, get and set, and
    the solver's own work (the rest).

    The steps are those of the closed loop along the straight edge, its commands recorded and given
    again.
    """
    if file.description.fmi != "2.0":
        raise InputError(
            "the profile needs FMI 2.0",
            file=file.path,
            hint="build it with `pneugantry build --fmi 2.0`",
        )
    experiment = Experiment.of(file, Scenario(workpiece="straight", clamped=()))
    commands, plan = np.ascontiguousarray(experiment.recorded()), experiment.plan
    with tempfile.TemporaryDirectory(prefix="profile-") as folder:
        counted = FmuFile.read(_counted_fmu(file, Path(folder)))
        with FmuSession(counted, parameters=plan.parameters) as fmu:
            library = _library(counted)
            component, counts = fmu.raw().component, (c_int64 * len(COUNTED))()
            inputs, outputs = fmu.references(COMMANDS), fmu.references((*OUTPUTS, "theta"))
            library.profile_counts(counts)
            arrays = (inputs.ctypes.data, commands.ctypes.data, outputs.ctypes.data, outputs.size)
            total = 1e9 * library.profile_steps(component, plan.samples, *arrays) / plan.samples
            library.profile_counts(counts)
            per_step = [n / plan.samples for n in counts] + [1.0, 1.0]
            values = np.zeros(outputs.size)
            each = []
            for what in range(len(COUNTED) + 2):
                references = inputs if what == SET else outputs
                values[:2] = commands[-1] if what == SET else values[:2]
                seconds = library.profile_seconds(
                    component,
                    what,
                    REPEATS,
                    references.ctypes.data,
                    references.size,
                    values.ctypes.data,
                )
                each.append(1e9 * seconds / REPEATS)
    names = (*COUNTED, f"fmi2GetReal of {outputs.size}", "fmi2SetReal of 2")
    rows = [
        _row(name, n, ns, n * ns, total) for name, n, ns in zip(names, per_step, each, strict=True)
    ]
    rest = total - sum(row["ns_per_step"] for row in rows)
    return [
        *rows,
        _row("solver: stages, events, delays", 1.0, rest, rest, total),
        _row("all of it", 1.0, total, total, total),
    ]


def _row(name: str, calls: float, ns: float, ns_per_step: float, total: float) -> dict[str, Any]:
    return {
        "function": name,
        "calls_per_step": calls,
        "ns_per_call": ns,
        "ns_per_step": ns_per_step,
        "share": ns_per_step / total,
    }


def _counted_fmu(file: FmuFile, folder: Path) -> Path:
    """The FMU with this machine's binary replaced by the one with counters."""
    target = host_platform()
    sources = folder / "sources"
    sources.mkdir()
    with zipfile.ZipFile(file.path) as archive:
        for name in archive.namelist():
            if name.startswith("sources/"):
                (sources / Path(name).name).write_bytes(archive.read(name))
        (sources / "profile.c").write_bytes((Path(__file__).parent / "profile.c").read_bytes())
        files = sorted({p.name for p in sources.glob("*.c")} - {"core.c"})
        library = compile_library(
            find_compiler(target), target, sources, files, f"counted{target.extension}"
        )
        out = folder / file.path.name
        with zipfile.ZipFile(out, "w") as copy:
            for name in archive.namelist():
                copy.writestr(
                    name,
                    library.read_bytes()
                    if name.startswith(f"binaries/{target.fmi2}/")
                    else archive.read(name),
                )
    return out


def _library(counted: FmuFile) -> Any:
    library = ctypes.CDLL(str(counted.library("cs")))
    library.profile_counts.argtypes, library.profile_counts.restype = [c_void_p], None
    library.profile_seconds.argtypes = [c_void_p, c_int, c_int64, c_void_p, c_size_t, c_void_p]
    library.profile_steps.argtypes = [c_void_p, c_int64, c_void_p, c_void_p, c_void_p, c_size_t]
    library.profile_seconds.restype = library.profile_steps.restype = c_double
    return library
