"""The Modelica Standard Library: compiled / right / refused, package by package.

    python -m benchmarks.standard_library LIBRARIES --references FOLDER [--within PACKAGE ...]

LIBRARIES: the folder that holds `Modelica` and `ModelicaServices`; its version is told. FOLDER: the
Modelica Association's reference results of that version (MAP-LIB_ReferenceResults: another tool's
runs and the signals to compare). A model is right where every such signal stays within TOLERANCE of
its range; what has no reference result is only compiled. At the start a discrete variable may have
the value before the events of that instant or after them. Each model runs in a process of its own,
which is stopped after LIMIT seconds of CPU time. A "~" stands beside what the FMU says of its
start, that it is one of several, and of a loop whose solution ends. With --json FILE and --resume
the models that FILE holds are not run again.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import re
import resource
import sys
from collections import Counter
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import fmpy
import numpy as np
import pandas as pd

from benchmarks.textbook import ROUNDING, TOLERANCE, Outcome, models, size_of, without_folder
from modelica_fmu.compiled import CompiledModel
from modelica_fmu.compiler import compile_model
from modelica_fmu.errors import InputError
from modelica_fmu.package import package_fmu

WITHIN = (
    "Blocks.Examples",
    "Math",
    "Mechanics.Translational.Examples",
    "Mechanics.Rotational.Examples",
    "Electrical.Analog.Examples",
)
POINTS = 500  # outputs of a run
BESIDE = 2e-4  # of a run's time, one interval of the references: the tolerance in time
LIMIT = 60  # s, CPU time of one model
PATIENCE = 1200.0  # s, beside other work on the machine
SOON = 1e-6  # of a run's time: after the events of its start
TIGHT = 1e-6  # the tolerance that the references were made with
STATES = ("compiled", "right", "wrong", "unchecked", "refused", "failed")


class Signals(NamedTuple):
    """A reference result: time, s, with two rows at an event; values of each signal to compare."""

    time: np.ndarray
    values: dict[str, np.ndarray]


def reference(folder: Path, name: str) -> Signals | None:
    """The reference result of a model, where there is one."""
    home = folder.joinpath(*name.split("."))
    table, listed = home / f"{home.name}.csv", home / "comparisonSignals.txt"
    if not (table.is_file() and listed.is_file()):
        return None
    frame = pd.read_csv(table)
    frame.columns = [c.strip().strip('"') for c in frame.columns]
    frame = frame.rename(columns={"Time": "time"})
    wanted = [s.strip() for s in listed.read_text(encoding="utf-8").split("\n") if s.strip()]
    values = {s: frame[s].to_numpy(float) for s in wanted if s in frame and s != "time"}
    return Signals(frame["time"].to_numpy(float), values)


def distance(
    t: np.ndarray, a: np.ndarray, time: np.ndarray, b: np.ndarray, share: float = BESIDE
) -> float:
    """Largest distance of a(t) from what b takes on within a share of the run's time around t."""
    beside = share * (time[-1] - time[0])
    worst = 0.0
    for now, value in zip(t, a, strict=True):
        near = b[np.searchsorted(time, now - beside) : np.searchsorted(time, now + beside, "right")]
        ends = np.interp([now - beside, now, now + beside], time, b)
        low, high = min(*ends, *near), max(*ends, *near)
        outside = max(low - value, value - high, 0.0)
        worst = max(worst, np.inf if np.isnan(value) else outside)
    return float(worst)


def compared(
    name: str,
    t: np.ndarray,
    found: dict[str, np.ndarray],
    wanted: Signals,
    beside: float = BESIDE,
) -> Outcome:
    known = [s for s in wanted.values if s in found]
    missing = [s for s in wanted.values if s not in found]
    if not known:
        return Outcome(name, "unchecked", "reference", None, f"without {', '.join(missing[:3])}")
    largest = max(size_of(wanted.values[s]) for s in known)
    errors = {
        s: distance(t, found[s], wanted.time, wanted.values[s], beside)
        / max(size_of(wanted.values[s]), ROUNDING * largest)
        for s in known
    }
    worst = max(errors, key=lambda s: errors[s])
    state = "right" if errors[worst] <= TOLERANCE else "wrong"
    said = "" if state == "right" else worst
    if missing:
        said += f" ({len(known)} of {len(wanted.values)} signals)"
    return Outcome(name, state, "reference", errors[worst], said)


def outputs(path: Path, stop: float, start: float, kept: Sequence[str], said: list[str]) -> Any:
    """A run's rows; `said` takes what the FMU tells of its solutions, and its errors."""
    longest = min(1.0, max(1e-6, (stop - start) / POINTS))

    def hear(_: Any, name: Any, status: int, category: Any, message: bytes) -> None:
        text = message.decode(errors="replace")
        if status >= fmpy.fmi2.fmi2Error or "is one of several" in text or "is taken" in text:
            said.append(text)

    return fmpy.simulate_fmu(
        str(path),
        start_time=start,
        stop_time=stop,
        output_interval=(stop - start) / POINTS,
        start_values={"solver.tolerance": TIGHT, "solver.max_step": longest},
        fmi_type="CoSimulation",
        output=list(kept),
        logger=hear,
    )


def run(compiled: CompiledModel, wanted: Signals, folder: Path) -> Outcome:
    try:
        path = package_fmu(compiled, "2.0", folder / "model.fmu")
    except InputError as error:  # C that does not compile is the compiler's fault
        return Outcome(compiled.name, "failed", "", None, " ".join(str(error).split())[:200])
    start, stop = float(wanted.time[0]), float(wanted.time[-1])
    kept = [v.name for v in compiled.variables if v.name in wanted.values]
    jumping = [v.name for v in compiled.variables if v.name in kept and v.variability == "discrete"]
    said: list[str] = []
    try:
        ran = outputs(path, stop, start, kept, said)
        soon = outputs(path, start + SOON * (stop - start), start, jumping, []) if jumping else {}
    except Exception as error:
        reason = said[-1] if said else " ".join(str(error).split())
        return Outcome(compiled.name, "failed", "", None, reason[:200])
    found = {v: np.asarray(ran[v], float) for v in kept}
    for name in jumping:  # or after the events of the start
        if wanted.values[name][0] == float(soon[name][-1]):
            found[name][0] = float(soon[name][-1])
    made = compared(compiled.name, np.asarray(ran["time"]), found, wanted)
    return made._replace(said=f"{made.said} ~ {said[0]}") if said else made


def tried(name: str, libraries: Sequence[Path], references: Path | None) -> Outcome:
    """Compiles a model; where there is a reference result, runs and compares it."""
    try:
        compiled = compile_model(None, name, None, libraries)
    except InputError as error:
        return Outcome(name, "refused", "", None, str(error))
    except Exception as error:  # a crash of the compiler is a result, too
        return Outcome(name, "failed", "", None, f"{type(error).__name__}: {error}"[:200])
    wanted = reference(references, name) if references is not None else None
    if wanted is None or not wanted.values:
        return Outcome(name, "compiled", "", None, "")
    with TemporaryDirectory(prefix="standard-library-") as folder:
        return run(compiled, wanted, Path(folder))


def _send(into: Connection, name: str, libraries: Sequence[Path], references: Path | None) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT))
    into.send(tried(name, libraries, references))


def in_time(name: str, libraries: Sequence[Path], references: Path | None) -> Outcome:
    """`tried` in a process of its own, stopped after LIMIT seconds."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    worker = multiprocessing.Process(target=_send, args=(theirs, name, libraries, references))
    worker.start()
    theirs.close()
    try:
        if ours.poll(PATIENCE):
            return ours.recv()  # type: ignore[no-any-return]
    except EOFError:  # it was stopped
        pass
    finally:
        worker.kill()
        worker.join()
    return Outcome(name, "failed", "", None, f"not done after {LIMIT} s of CPU time")


def reason(said: str) -> str:
    """A refusal without place and names: the same for all that are refused for it."""
    words = re.sub(r"^.*?\.mo:\d+: |^[^ ]*\.mo: ", "", said)
    words = re.sub(r"'[^']*'|\([^)]*\)|\S*\.\S+|\S+\[\S*", "…", words)
    return words.split(";")[0][:90]


def printed(outcomes: Sequence[Outcome], within: Sequence[str]) -> None:
    counts = {
        part: Counter(o.state for o in outcomes if f"{o.model}.".startswith(f"Modelica.{part}."))
        for part in within
    }
    print("| package | models | " + " | ".join(STATES) + " |")
    print("|---|" + "---|" * (len(STATES) + 1))
    for part, count in counts.items():
        cells = " | ".join(str(count[s]) for s in STATES)
        print(f"| {part} | {sum(count.values())} | {cells} |")
    reasons = Counter(reason(o.said) for o in outcomes if o.state == "refused")
    for said, number in reasons.most_common(12):
        print(f"{number:4} refused: {said}")


def version_of(library: Path) -> str:
    """Version of a library by its annotation. Raises InputError where it gives none."""
    file = library / "package.mo"
    if not file.is_file():
        raise InputError("not there", file=file, hint="give the folder that holds Modelica")
    found = re.search(r'\bversion\s*=\s*"([^"]+)"', file.read_text(encoding="utf-8"))
    if found is None:
        raise InputError("no version in the annotation", file=file, hint="take a released library")
    return found[1]


def kept(file: Path | None, version: str) -> dict[str, Outcome]:
    """Outcomes of an earlier run with the same library, by model."""
    if file is None or not file.is_file():
        return {}
    found = json.loads(file.read_text(encoding="utf-8"))
    if found["library"] != version:
        raise InputError(f"of library {found['library']}, not {version}", file=file, hint="move it")
    return {o["model"]: Outcome(**o) for o in found["outcomes"]}


def write(file: Path | None, version: str, outcomes: Sequence[Outcome]) -> None:
    if file is not None:
        found = {"library": version, "outcomes": [o._asdict() for o in outcomes]}
        file.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("libraries", type=Path)
    parser.add_argument("--references", type=Path, metavar="FOLDER")
    parser.add_argument("--within", action="append", metavar="PACKAGE")
    parser.add_argument("--only", metavar="TEXT", default="")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--resume", action="store_true")
    options = parser.parse_args(arguments)
    try:
        version = version_of(options.libraries / "Modelica")
        before = kept(options.json, version) if options.resume else {}
    except InputError as refused:
        print(refused, file=sys.stderr)
        return 2
    print(f"Modelica Standard Library {version}")
    within = [p.removeprefix("Modelica.") for p in options.within or WITHIN]
    outcomes: list[Outcome] = []
    for name in models(options.libraries / "Modelica", within):
        if options.only not in name:
            continue
        made = before.get(name) or without_folder(
            in_time(name, [options.libraries], options.references), options.libraries
        )
        outcomes.append(made)
        write(options.json, version, outcomes)
        error = "" if made.error is None else f"{made.error:.1e}"
        print(f"{made.state:9} {error:8} {made.model}  {made.said}", flush=True)
    printed(outcomes, within)
    return 0


if __name__ == "__main__":
    sys.exit(main())
