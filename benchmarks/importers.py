"""One FMU in every tool that is installed, the same commands, the trajectories beside ours: `python
-m benchmarks.importers [--fmu FILE]`.

Without --fmu the gantry's FMU is built for four platforms where zig is installed, else for this
machine. Errors are in sensor sigma.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import importlib
import importlib.util
import json
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import casadi
import fmpy
import numpy as np
from numpy.typing import NDArray

from pneugantry.speed.paths import fmpy_slave, quiet
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.log import SIGMA
from pyfmi_runner.plant import COMMANDS, OUTPUTS

ROOT = Path(__file__).resolve().parents[1]

__all__ = ["IMPORTERS", "Importer", "binaries", "commands", "compared", "ours"]

Array = NDArray[np.float64]
FOUR = ("x86_64-linux", "x86_64-windows", "x86_64-darwin", "aarch64-darwin")
STEP, HOLD = 1e-3, 100  # s; samples for which a command is held
SCALE = np.array([SIGMA[name] for name in OUTPUTS])


@dataclass(frozen=True)
class Importer:
    """A tool that takes the FMU. run: from file and commands to the outputs after each step, as
    many rows as it can give.
    """

    name: str
    package: str
    did: str
    run: Callable[[FmuFile, Array], Array]


def commands(samples: int = 3000, seed: int = 1) -> Array:
    """u_x, u_z [V], drawn every 0.1 s: both axes break away, turn and stop."""
    drawn = np.random.default_rng(seed).uniform((0.5, 0.6), (1.1, 1.4), (-(-samples // HOLD), 2))
    return np.repeat(drawn, HOLD, axis=0)[:samples]


def ours(file: FmuFile, u: Array) -> Array:
    rows = np.empty((len(u), len(OUTPUTS)))
    with FmuSession(file, parameters={}) as fmu:
        for k in range(len(u)):
            fmu.set(COMMANDS, u[k])
            fmu.step(STEP, time=k * STEP)
            rows[k] = fmu.get(OUTPUTS)
    return rows


def _references(file: FmuFile, names: tuple[str, ...]) -> list[int]:
    return [file.variables[name].reference for name in names]


def fmpy_steps(file: FmuFile, u: Array) -> Array:
    fmu = fmpy_slave(file)
    rows, write, read = (
        np.empty((len(u), len(OUTPUTS))),
        _references(file, COMMANDS),
        _references(file, OUTPUTS),
    )
    for k in range(len(u)):
        fmu.setReal(write, list(u[k]))
        fmu.doStep(currentCommunicationPoint=k * STEP, communicationStepSize=STEP)
        rows[k] = fmu.getReal(read)
    fmu.terminate()
    fmu.freeInstance()
    return rows


def fmpy_cvode(file: FmuFile, u: Array) -> Array:
    starts = range(0, len(u), HOLD)
    signal = np.array(
        [(t * STEP, *u[k]) for k in starts for t in (k, min(k + HOLD, len(u)))],
        dtype=[("time", float), *((n, float) for n in COMMANDS)],
    )
    result = fmpy.simulate_fmu(
        str(file.path),
        fmi_type="ModelExchange",
        solver="CVode",
        stop_time=len(u) * STEP,
        output_interval=STEP,
        input=signal,
        output=list(OUTPUTS),
        relative_tolerance=1e-8,
        record_events=False,
    )
    rows = np.column_stack([result[name] for name in OUTPUTS])
    return rows[1 : len(u) + 1]


def libcosim(file: FmuFile, u: Array) -> Array:
    execution_, manipulator, observer_, slave = (
        importlib.import_module(f"libcosimpy.Cosim{n}")
        for n in ("Execution", "Manipulator", "Observer", "Slave")
    )
    execution = execution_.CosimExecution.from_step_size(round(STEP * 1e9))
    index = execution.add_local_slave(slave.CosimLocalSlave(str(file.path), "gantry"))
    override, observer = (
        manipulator.CosimManipulator.create_override(),
        observer_.CosimObserver.create_last_value(),
    )
    execution.add_manipulator(override)
    execution.add_observer(observer)
    rows = np.empty((len(u), len(OUTPUTS)))
    for k in range(len(u)):
        override.slave_real_values(index, _references(file, COMMANDS), list(u[k]))
        execution.step(1)
        rows[k] = observer.last_real_values(index, _references(file, OUTPUTS))
    return rows


def ecos(file: FmuFile, u: Array) -> Array:
    tbb = Path(sys.prefix) / "lib" / "libtbb.so.12"
    if tbb.is_file():  # where the wheel of tbb puts it, which the loader does not search
        ctypes.CDLL(str(tbb), ctypes.RTLD_GLOBAL)
    ecospy = importlib.import_module("ecospy")
    structure = ecospy.EcosSimulationStructure()
    structure.add_model("gantry", str(file.path))
    rows = np.empty((len(u), len(OUTPUTS)))
    with ecospy.EcosSimulation(structure=structure, step_size=STEP) as simulation:
        simulation.init()
        for k in range(len(u)):
            for name, value in zip(COMMANDS, u[k], strict=True):
                simulation.set_real(f"gantry::{name}", float(value))
            simulation.step(1)
            rows[k] = [simulation.get_real(f"gantry::{name}") for name in OUTPUTS]
        simulation.terminate()
    return rows


def casadi_rk4(file: FmuFile, u: Array) -> Array:
    """Classical Runge-Kutta steps of 0.1 ms up to the first event: CasADi drives none."""
    builder = casadi.DaeBuilder("gantry", str(file.path))
    with FmuSession(file, parameters={}) as fmu:
        x = np.array(
            fmu.get(builder.x())
        )  # CasADi takes start attributes; some states start at a parameter
    inputs = builder.u()
    rates, outputs = (
        builder.create("f", ["x", "u"], ["ode"]),
        builder.create("y", ["x", "u"], ["y"]),
    )
    at, h = [inputs.index(name) for name in COMMANDS], 0.1 * STEP
    place = [builder.y().index(name) for name in OUTPUTS]
    held, rows = np.array(builder.start(inputs)), []
    for k in range(_first_event(file, u)):
        held[at] = u[k]
        for _ in range(10):
            k1 = rates(x, held)
            k2 = rates(x + h / 2 * k1, held)
            k3 = rates(x + h / 2 * k2, held)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(x + h * k3, held))
        rows.append(np.array(outputs(x, held)).ravel()[place])
    return np.array(rows)


def _first_event(file: FmuFile, u: Array) -> int:
    """Steps before an axis breaks away."""
    moving = np.abs(ours(file, u)[:, [OUTPUTS.index("v_x"), OUTPUTS.index("v_z")]]).max(axis=1) > 0
    return int(np.argmax(moving)) if moving.any() else len(u)


def toolbox(file: FmuFile, u: Array) -> Array:
    operations = importlib.import_module("fmu_manipulation_toolbox.operations")
    with tempfile.TemporaryDirectory() as folder:
        packed = Path(folder) / file.path.name
        with operations.FMU(str(file.path)) as fmu:
            fmu.apply_operation(operations.OperationRemoveSources())
            fmu.repack(str(packed))
        return ours(FmuFile.read(packed), u)


IMPORTERS = (
    Importer("fmpy", "fmpy", "co-simulation, doStep every millisecond", fmpy_steps),
    Importer("fmpy, CVode", "fmpy", "model exchange, events driven by the tool", fmpy_cvode),
    Importer("libcosim", "libcosimpy", "co-simulation, override and observer", libcosim),
    Importer("ecos", "ecospy", "co-simulation, set_real and step", ecos),
    Importer(
        "CasADi", "casadi", "model exchange, its own Runge-Kutta to the first event", casadi_rk4
    ),
    Importer(
        "fmu-manipulation-toolbox",
        "fmu-manipulation-toolbox",
        "opened, sources removed, packed again, stepped by us",
        toolbox,
    ),
)


def compared(
    file: FmuFile, u: Array, importers: tuple[Importer, ...] = IMPORTERS
) -> Iterator[dict[str, Any]]:
    """A row per importer: rows compared, largest error over the eight outputs in sensor sigma; None
    where it is not installed.
    """
    expected = ours(file, u)
    for importer in importers:
        row: dict[str, Any] = {
            "importer": importer.name,
            "did": importer.did,
            "version": None,
            "steps": 0,
            "error": None,
        }
        with contextlib.suppress(PackageNotFoundError, ImportError):
            row["version"] = version(importer.package)
            with quiet():
                found = importer.run(file, u)
            row |= {
                "steps": len(found),
                "error": float((np.abs(found - expected[: len(found)]) / SCALE).max()),
            }
        yield row


def binaries(path: Path) -> dict[str, str]:
    """What `file` says of each binary in an FMU; its size where there is no `file`."""
    said = {}
    with zipfile.ZipFile(path) as archive, tempfile.TemporaryDirectory() as folder:
        for name in sorted(archive.namelist()):
            if name.startswith("binaries/") and not name.endswith("/"):
                binary = Path(folder) / "binary"
                binary.write_bytes(archive.read(name))
                if shutil.which("file"):
                    said[name] = (
                        subprocess.run(
                            ["file", "-b", binary], capture_output=True, text=True, check=True
                        )
                        .stdout.strip()
                        .partition(", flags")[0]
                    )
                else:
                    said[name] = f"{binary.stat().st_size} bytes"
    return said


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.importers", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "--fmu",
        type=Path,
        metavar="FILE",
        help="an FMU 2.0 of the gantry (default: built for four platforms)",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write both tables as JSON")
    options = parser.parse_args(arguments)
    four = importlib.util.find_spec("ziglang") is not None
    path = (
        options.fmu
        or (build_fmu(platforms=FOUR, out=ROOT / "out" / "four") if four else build_fmu()).path
    )
    rows = list(compared(FmuFile.read(path), commands()))
    print(
        "| importer | version | what it did | steps | largest error, sensor sigma "
        "|\n|---|---|---|---|---|"
    )
    for row in rows:
        error = "not installed" if row["error"] is None else f"{row['error']:.1g}"
        print(
            f"| {row['importer']} | {row['version'] or ''} | {row['did']} | "
            f"{row['steps'] or ''} | {error} |"
        )
    print("\n| binary | `file` |\n|---|---|")
    for name, said in binaries(path).items():
        print(f"| `{name}` | {said} |")
    if options.json:
        options.json.write_text(
            json.dumps(
                {"schema": "importers/1", "importers": rows, "binaries": binaries(path)}, indent=2
            )
            + "\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
