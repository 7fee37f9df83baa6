"""What FMI's cross-check asks of a tool that exports FMUs, written and checked:

    python -m benchmarks.cross_check OUT [--model FILE --class NAME ...]

For each model and each of co-simulation (cs) and model exchange (me), the folder
OUT/fmus/2.0/TYPE/PLATFORM/PneuGantry/VERSION/MODEL holds

    MODEL.fmu  MODEL_ref.csv  MODEL_ref.opt  MODEL_in.csv (a model with inputs)  README.md

by the rules of FMI Cross-Check 4.1 (section 9.1, appendix B). The reference solution is ours, with
the internal solver's steps a hundredth of what the FMU comes with. Then fmpy takes each folder: its
check of a vendor's files, a run of the FMU at its defaults with the options and inputs of these
files (cs: the FMU's solver, me: CVode), and the cross-check's comparison of both. Printed beside:
the largest distance as a share of the signal's range. Without a model: the gantry, the measured
axis and a drive with an elastic joint. Exit code 1 where anything is found.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import fmpy
import numpy as np
from fmpy.cross_check import validate_result
from fmpy.cross_check.validate_vendor_repo import validate_test_fmu
from numpy.typing import NDArray

from modelica_fmu import ClassSource, Target
from modelica_fmu.errors import InputError
from pyfmi_runner.build import build_source, default_model
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.plant import DEFAULT_CLASS

ROOT = Path(__file__).resolve().parents[1]
TOOL = "PneuGantry"
TYPES: tuple[Literal["cs", "me"], ...] = ("cs", "me")
ROWS = 500  # of the reference; a file may have 1 MB
COLUMNS = 10  # variables of the reference, "recommended at most"
KNOTS = 13  # of each input, which is a line between them
TIGHTER = 100  # times, of the steps
TOLERANCE = 1e-6  # of our solver, and what another one is asked for: RelTol
BESIDE = 2  # steps by which a jump may be told earlier or later

Columns = NDArray[np.void]  # a structured array whose first column is "time"


@dataclass(frozen=True)
class Case:
    """A model with what is done to it. stop, step: s, the run and its communication steps; reach:
    largest input, in its unit.
    """

    source: ClassSource
    name: str  # of files and folder
    stop: float = 5.0
    step: float = 1e-3
    reach: float = 1.0


CASES = (
    Case(ClassSource(DEFAULT_CLASS, default_model()), "Gantry"),
    Case(ClassSource("EMPS.Axis", ROOT / "models" / "EMPS.mo"), "Axis", reach=0.1),
    Case(ClassSource("Drive.Plant", ROOT / "examples" / "drive" / "Drive.mo"), "Drive"),
)


def inputs_of(file: FmuFile, case: Case) -> Columns | None:
    """All Real inputs, lines between drawn values from 0 on. None: no inputs.

    Others keep their start value: importers set all inputs of such a file in continuous time too,
    where a discrete one may not be set.
    """
    known = file.description.variables.values()
    inputs = [v for v in known if v.causality == "input" and v.type == "Real"]
    if not inputs:
        return None
    drawn = np.random.default_rng(1)
    columns = {"time": np.linspace(0, case.stop, KNOTS)}
    for variable in inputs:
        low = -case.reach if variable.min is None else max(variable.min, -case.reach)
        high = case.reach if variable.max is None else min(variable.max, case.reach)
        columns[variable.name] = np.append(0.0, drawn.uniform(low, high, KNOTS - 1))
    return table(columns)


def table(columns: dict[str, Any]) -> Columns:
    made = np.zeros(len(columns["time"]), [(name, float) for name in columns])
    for name, values in columns.items():
        made[name] = values
    return made


def reference(file: FmuFile, case: Case, inputs: Columns | None) -> Columns:
    """Our own solution with a tight internal solver."""
    names = (file.description.outputs or file.description.states)[:COLUMNS]
    settings = {"solver.max_step": case.step / TIGHTER, "solver.tolerance": TOLERANCE}
    steps = round(case.stop / case.step)
    every = max(1, steps // ROWS)
    rows = []
    with FmuSession(file, parameters=settings) as fmu:
        for k in range(steps + 1):
            if k % every == 0 or k == steps:
                rows.append([k * case.step, *fmu.get(names)])
            if inputs is not None:
                for name in (inputs.dtype.names or ())[1:]:
                    fmu.set(name, float(np.interp(k * case.step, inputs["time"], inputs[name])))
            if k < steps:
                fmu.step(case.step, time=k * case.step)
    return table(dict(zip(["time", *names], np.transpose(rows), strict=True)))


def write_csv(path: Path, rows: Columns) -> None:
    """By appendix B: quoted names, plain numbers, commas between them."""
    names = rows.dtype.names or ()
    lines = [",".join(f'"{name}"' for name in names)]
    lines += [",".join(f"{float(value):.9g}" for value in row) for row in rows]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def options_of(case: Case, kind: str) -> str:
    """StepSize 0 stands for a solver with steps of its own."""
    lines = {
        "StartTime": 0.0,
        "StopTime": case.stop,
        "StepSize": case.step if kind == "cs" else 0.0,
        "RelTol": TOLERANCE,
        "OutputIntervalLength": case.step * max(1, round(case.stop / case.step) // ROWS),
    }
    return "".join(f"{name}, {value:g}\n" for name, value in lines.items())


def readme_of(case: Case, kind: str, platform: str) -> str:
    solver = (
        "The FMU's own solver: communication steps of StepSize."
        if kind == "cs"
        else "Any solver with located events; StepSize 0 stands for steps of its own."
    )
    return (
        f"# {case.name}\n\nThe Modelica class `{case.source.name}`, exported by {TOOL} "
        f"{version('pneugantry')} for {platform}, without license checks. The sources are inside: "
        f"other platforms can build them.\n\n{solver}\n\nReference: the same FMU with "
        f"`solver.max_step` = {case.step / TIGHTER:g} s and `solver.tolerance` = "
        f"{TOLERANCE:g}. Inputs are lines between their values; one that is "
        "not in the file keeps its start value.\n"
    )


def platform_of(fmu: Path) -> str:
    """The folder of the binary in the archive: linux64, ..."""
    with zipfile.ZipFile(fmu) as archive:
        found = {n.split("/")[1] for n in archive.namelist() if n.startswith("binaries/")}
    return min(found)


def written(case: Case, out: Path) -> list[Path]:
    """The folders of a model, with all that the rules ask for."""
    built = build_source(case.source, Target("2.0")).path
    file, platform = FmuFile.read(built), platform_of(built)
    inputs = inputs_of(file, case)
    solution = reference(file, case, inputs)
    folders = []
    for kind in TYPES:
        folder = out / "fmus" / "2.0" / kind / platform / TOOL / version("pneugantry") / case.name
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(built, folder / f"{case.name}.fmu")
        write_csv(folder / f"{case.name}_ref.csv", solution)
        if inputs is not None:
            write_csv(folder / f"{case.name}_in.csv", inputs)
        (folder / f"{case.name}_ref.opt").write_text(options_of(case, kind), encoding="ascii")
        (folder / "README.md").write_text(readme_of(case, kind, platform), encoding="utf-8")
        folders.append(folder)
    return folders


def read_csv(path: Path) -> Columns | None:
    if not path.is_file():
        return None
    return np.genfromtxt(path, delimiter=",", names=True, deletechars="")  # type: ignore[no-any-return]


def simulated(folder: Path, wanted: Columns, step: float) -> Columns:
    """The FMU of a folder at its defaults, as an importer runs it."""
    kind, name = folder.parents[3].name, folder.name
    said = [line.split(",") for line in (folder / f"{name}_ref.opt").read_text().splitlines()]
    given = {key: float(value) for key, value in said}
    return fmpy.simulate_fmu(  # type: ignore[no-any-return]
        str(folder / f"{name}.fmu"),
        start_time=given["StartTime"],
        stop_time=given["StopTime"],
        output_interval=step,  # fmpy steps by it, too
        relative_tolerance=given["RelTol"],
        fmi_type="CoSimulation" if kind == "cs" else "ModelExchange",
        input=read_csv(folder / f"{name}_in.csv"),
        output=list(wanted.dtype.names or ())[1:],
    )


def distance(found: Columns, wanted: Columns, step: float) -> float:
    """Largest distance of the reference from what a signal takes on within BESIDE steps, as a share
    of its range.
    """
    worst, time = 0.0, wanted["time"]
    for name in (wanted.dtype.names or ())[1:]:
        size = float(np.ptp(wanted[name])) or max(1e-9, float(np.abs(wanted[name]).max()))
        shifts = step * np.arange(-BESIDE, BESIDE + 1)
        near = [np.interp(time + shift, found["time"], found[name]) for shift in shifts]
        low, high = np.min(near, axis=0), np.max(near, axis=0)
        off = np.maximum(np.maximum(low - wanted[name], wanted[name] - high), 0)
        worst = max(worst, float(off.max()) / size)
    return worst


def checked(folder: Path, step: float) -> tuple[list[str], float]:
    """(what the cross-check's own programs find, distance from the reference)."""
    problems = [str(p) for p in validate_test_fmu(str(folder))]
    wanted = read_csv(folder / f"{folder.name}_ref.csv")
    if wanted is None:
        return [*problems, "no reference"], np.nan
    found = simulated(folder, wanted, step)
    said = validate_result(found, wanted, float(wanted["time"][0]), float(wanted["time"][-1]))
    return problems + ([said] if said else []), distance(found, wanted, step)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--model", type=Path, metavar="FILE.mo")
    parser.add_argument("--class", dest="class_name", metavar="NAME")
    parser.add_argument("--library", action="append", default=[], type=Path, metavar="DIR")
    parser.add_argument("--stop", type=float, default=5.0, metavar="S")
    parser.add_argument("--step", type=float, default=1e-3, metavar="S")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    cases: Sequence[Case] = CASES
    if options.class_name is not None:
        source = ClassSource(options.class_name, options.model, {}, tuple(options.library))
        short = options.class_name.rpartition(".")[2]
        cases = (Case(source, short, options.stop, options.step),)
    rows: list[dict[str, Any]] = []
    print(f"{'model':12} {'type':4} {'distance':>9}  found")
    try:
        for case in cases:
            for folder in written(case, options.out):
                problems, off = checked(folder, case.step)
                kind = folder.parents[3].name
                print(f"{case.name:12} {kind:4} {off:9.1e}  {'; '.join(problems) or 'nothing'}")
                row = {"model": case.name, "type": kind, "distance": off, "found": problems}
                rows.append(row)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return 1 if any(row["found"] for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
