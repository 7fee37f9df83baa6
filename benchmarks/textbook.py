"""Textbook models: compiled / right / refused, each held against an independent solution.

    python -m benchmarks.textbook LIBRARY [--within Package.Part ...] [--also LIBRARY] [--json FILE]

Takes a package folder (such as the public source of *Modelica by Example*), compiles each model and
block in the named packages to an FMU and runs it. The independent solution is a second compiler's
own simulation (rumoca: another parser, flattening, sorting and integrator) or, where that one takes
the model not, equations written by hand (textbook_solutions.py).
"""

from __future__ import annotations

import argparse
import importlib
import json
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import fmpy
import numpy as np

from benchmarks.textbook_solutions import HAND_WRITTEN, PARAMETERS, STOP_TIMES
from modelica_fmu.compiler import compile_model
from modelica_fmu.errors import InputError
from modelica_fmu.modelica.library import Library
from modelica_fmu.modelica.scope import Scope, root_scope
from modelica_fmu.package import package_fmu

POINTS = 500
STOP = 5.0  # s, where neither the model nor STOP_TIMES says
TOLERANCE = 2e-3  # of a variable's range
INSTANT = 1e-6  # of the time of a run: as far from a jump both its sides count
ROUNDING = 1e-6  # of the model's largest variable: below that a difference of two is rounding
WITHIN = ("BasicEquations", "ArrayEquations", "DiscreteBehavior", "Functions")


class Outcome(NamedTuple):
    model: str
    state: str  # right, wrong, unchecked, empty, refused, failed
    against: str  # which independent solution
    error: float | None  # largest difference / range, over all variables
    said: str


def models(library: Path, within: Sequence[str]) -> Iterator[str]:
    """Full names of all models and blocks in packages of a library, partial ones too."""
    root = root_scope(Library([library]))
    top = root.top_class(library.resolve().name.split(" ")[0])
    if top is None:
        raise InputError("no package in this folder", file=library, hint="give one with package.mo")
    for part in within or [""]:
        scope: Scope | None = top
        for name in filter(None, part.split(".")):
            scope = scope.own_class(name) if scope is not None else None
        if scope is None:
            raise InputError(f"no package {part}", file=library, hint="name one that it has")
        yield from _below(scope)


def _below(scope: Scope) -> Iterator[str]:
    if scope.cls.kind in ("model", "block", "class"):
        yield scope.path
    elif scope.cls.kind == "package":
        for name in scope.library.children(scope.cls):
            inner = scope.own_class(name)
            if inner is not None:
                yield from _below(inner)


def tried(name: str, libraries: Sequence[Path], reference: Reference, folder: Path) -> Outcome:
    """Compiles, runs and checks one model."""
    try:
        compiled = compile_model(None, name, PARAMETERS.get(name.split(".", 1)[-1]), libraries)
        path = package_fmu(compiled, "2.0", folder / "model.fmu")
    except InputError as error:
        return Outcome(name, "refused", "", None, str(error))
    stop = STOP_TIMES.get(name.split(".", 1)[-1], STOP)
    kinds = ("state", "algebraic", "discrete")
    wanted = [v.name for v in compiled.variables if v.kind in kinds]
    try:
        time, found = simulated(path, stop, wanted)
    except Exception as error:
        return Outcome(name, "failed", "", None, " ".join(str(error).split())[:200])
    return compared(name, time, found, reference.solution(name, stop))


def simulated(
    path: Path, stop: float, wanted: Sequence[str], settings: dict[str, float] | None = None
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times, s, and values by name of a run in co-simulation from 0; `settings`: start values."""
    ran = fmpy.simulate_fmu(
        str(path),
        stop_time=stop,
        output_interval=stop / POINTS,
        start_values=settings or {},
        fmi_type="CoSimulation",
        output=list(wanted),
    )
    return np.asarray(ran["time"]), {v: np.asarray(ran[v], float) for v in wanted}


def without_folder(made: Outcome, folder: Path) -> Outcome:
    """Files of its message by their place in the library."""
    return made._replace(said=made.said.replace(f"{folder}/", ""))


class Independent(NamedTuple):
    """A solution that shares nothing with ours."""

    against: str
    values: dict[str, Any]  # name -> function of time, s
    exact: bool = False  # at every instant; else sampled, and jumps lie between two samples


def compared(
    name: str, t: np.ndarray, found: dict[str, np.ndarray], solution: Independent
) -> Outcome:
    """The largest difference of any variable that both know, in parts of its range."""
    if not found:
        return Outcome(name, "empty", "", None, "no variable to compare")
    known = [v for v in found if v in solution.values]
    if not known:
        return Outcome(name, "unchecked", solution.against, None, "no independent solution")
    wanted = {v: solution.values[v](t) for v in known}
    largest = max(size_of(b) for b in wanted.values())
    errors = {}
    for v, b in wanted.items():
        size = max(size_of(b), ROUNDING * largest)
        if solution.exact:
            errors[v] = difference_beside_instants(t, found[v], solution.values[v], size)
        else:
            errors[v] = difference_between_samples(found[v], b, size)
    worst = max(errors, key=lambda v: errors[v])
    state = "right" if errors[worst] <= TOLERANCE else "wrong"
    return Outcome(name, state, solution.against, errors[worst], "" if state == "right" else worst)


def size_of(b: np.ndarray) -> float:
    """What an error is measured by: the range, or a thousandth of what a constant amounts to."""
    return max(float(np.ptp(b)), 1e-3 * float(np.max(np.abs(b))), 1e-9)


def difference_beside_instants(t: np.ndarray, a: np.ndarray, exact: Any, size: float) -> float:
    """Largest |a - b| / size. Where the solution jumps at an output time its value before counts
    as well as the one after: a communication point ends a step, so it shows the value before.
    """
    beside = INSTANT * t[-1]
    around = [exact(np.clip(t + k * beside, 0, t[-1])) for k in (-1, 0, 1)]
    return float(np.max(np.minimum.reduce([np.abs(a - b) for b in around])) / size)


def difference_between_samples(a: np.ndarray, b: np.ndarray, size: float) -> float:
    """Largest |a - b| / size; beside a jump of b the neighbouring samples count as well."""
    shifted = [np.abs(a - np.roll(b, k)) for k in (-1, 0, 1)]
    steep = np.abs(np.diff(b, prepend=b[0])) > 0.05 * size
    near = steep | np.roll(steep, 1) | np.roll(steep, -1)
    error = np.where(near, np.minimum.reduce(shifted), shifted[1])[1:-1]
    return float(np.max(error) / size) if len(error) else 0.0


class Reference:
    """Independent solutions: by hand first, else the other compiler's simulation."""

    def __init__(self, library: Path, folder: Path) -> None:
        self.copy = folder / library.resolve().name
        shutil.copytree(library, self.copy)
        _complete(self.copy)
        try:
            self.rumoca: Any = importlib.import_module("rumoca")
        except ImportError:
            self.rumoca = None

    def solution(self, name: str, stop: float) -> Independent:
        by_hand = HAND_WRITTEN.get(name.split(".", 1)[-1])
        if by_hand is not None:
            return Independent("by hand", dict(by_hand(stop)), exact=True)
        if self.rumoca is None:
            return Independent("", {})
        try:
            session = self.rumoca.Session([str(self.copy)])
            model = session.loads(f"model Z extends {name}; end Z;", model="Z")
            result = model.simulate((0.0, stop), dt=stop / (4 * POINTS))
        except Exception as error:  # whatever stops the other compiler is no fault of ours
            return Independent(f"rumoca: {' '.join(str(error).split())[:80]}", {})
        time = np.asarray(result.time, float)
        values = {v: _lookup(time, np.asarray(result[v], float)) for v in result.names}
        return Independent("rumoca", values)


def _lookup(time: np.ndarray, values: np.ndarray) -> Any:
    return lambda t: np.interp(t, time, values)


def _complete(folder: Path) -> None:
    """The other compiler insists on a package.mo in every folder."""
    for inner in [p for p in folder.rglob("*") if p.is_dir()]:
        if not inner.exists() or (inner / "package.mo").is_file():
            continue
        if any(inner.rglob("*.mo")):
            path = ".".join(inner.relative_to(folder.parent).parts[:-1])
            text = f"within {path};\npackage {inner.name}\nend {inner.name};\n"
            (inner / "package.mo").write_text(text, encoding="utf-8")
        else:
            shutil.rmtree(inner)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("library", type=Path)
    parser.add_argument("--within", action="append", metavar="PACKAGE")
    parser.add_argument("--also", action="append", type=Path, default=[], metavar="LIBRARY")
    parser.add_argument("--only", metavar="TEXT", default="")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    outcomes: list[Outcome] = []
    with TemporaryDirectory(prefix="textbook-") as temporary:
        reference = Reference(options.library, Path(temporary))
        for name in models(options.library, options.within or WITHIN):
            if options.only not in name:
                continue
            made = tried(name, [options.library, *options.also], reference, Path(temporary))
            made = without_folder(made, options.library.parent)
            outcomes.append(made)
            error = "" if made.error is None else f"{made.error:.1e}"
            print(f"{made.state:9} {error:8} {made.model}  {made.against}  {made.said}", flush=True)
    counts = {s: sum(o.state == s for o in outcomes) for s in sorted({o.state for o in outcomes})}
    print(f"{len(outcomes)} models: " + ", ".join(f"{n} {s}" for s, n in counts.items()))
    if options.json is not None:
        options.json.write_text(json.dumps([o._asdict() for o in outcomes], indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
