"""Who may import whom: data flows one way, and a library that is wrapped is imported in
one place.
"""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# package: our packages that it may import besides itself; the longest name that fits counts
ALLOWED = {
    "modelica_fmu": set(),
    "controllers": set(),
    "pyfmi_runner": {"modelica_fmu", "controllers"},
    "pneugantry.truth": set(),  # the independent truth plant shares no line with the product
    "pneugantry.analysis": {"modelica_fmu", "controllers", "pyfmi_runner"},
    "pneugantry.engine": {"modelica_fmu", "pyfmi_runner"},
    "pneugantry.learn": {"modelica_fmu", "pneugantry.engine"},
    "pneugantry.report": {"modelica_fmu", "pyfmi_runner", "pneugantry.engine"},
    "pneugantry.plants": {
        "modelica_fmu",
        "pyfmi_runner",
        "pneugantry.engine",
        "pneugantry.learn",
        "pneugantry.report",
        "pneugantry.jobs",
    },
    "pneugantry.jobs": {"modelica_fmu"},
    "pneugantry.progress": {"modelica_fmu", "pyfmi_runner"},
    "pneugantry.listening": set(),
    "pneugantry.building": {"pneugantry.listening"},
}
LEFT = {*ALLOWED, "pneugantry.jobs"}
ALLOWED |= {
    "pneugantry.sweep": LEFT,
    "pneugantry.speed": LEFT,
    "pneugantry.blind": LEFT,
    "pneugantry.thesis": LEFT,
}
# Within a package: each room imports from those before it alone.
FLOORS = {
    "pneugantry.engine": (
        *("plant", "rules", "chances", "threads", "recent"),
        *("signals", "hypotheses", "views", "fitting", "selection", "planning", "task", "answer"),
        *("calibration", "describe", "run", "parts", "change"),
    ),
    "pneugantry.learn": (
        *("curves", "equations", "screening", "terms", "experiments", "learned", "fitting"),
        *("answer", "wanted", "learn"),
    ),
}
ALLOWED["pneugantry.api"] = LEFT - {"pneugantry.truth"} | {
    "pneugantry.thesis"
}  # the commands as functions
ALLOWED["pneugantry"] = set(ALLOWED)  # the command line
ALLOWED["benchmarks"] = set(ALLOWED)
ALLOWED["examples"] = set(ALLOWED)
TOP = ("modelica_fmu", "controllers", "pyfmi_runner", "pneugantry", "benchmarks", "examples")
FILES_OF = {package: [] for package in ALLOWED}
for _top in TOP:
    for _path in sorted((ROOT / _top).rglob("*.py")):
        _name = ".".join(_path.relative_to(ROOT).with_suffix("").parts)
        _owner = max((p for p in ALLOWED if f"{_name}.".startswith(f"{p}.")), key=len)
        FILES_OF[_owner].append(_path)
TRUTH_LIBRARIES = {"numpy", "scipy", "numba", "pandas"}
CONTROLLER_LIBRARIES = {"numpy", "numba"}
WRAPPED = {  # library: the files that may import it
    # solver_check: fmpy's CVode as an independent master; paths: its loops, timed;
    # importers: beside the others
    "fmpy": {
        "benchmarks/cross_check.py",
        "pyfmi_runner/fmu.py",
        "benchmarks/solver_check.py",
        "pneugantry/speed/paths.py",
        "benchmarks/importers.py",
        "benchmarks/textbook.py",
        "benchmarks/standard_library.py",
    },
    "matplotlib": {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "pneugantry" / "analysis").glob("plots*.py")
    },
    "llvmlite": {"pyfmi_runner/native.py"},
    "gymnasium": {"pyfmi_runner/gym_env.py"},  # an extra: nothing else needs it
    "distributed": {"pneugantry/jobs/cluster.py"},  # loaded only where a scheduler is given
}


@cache
def imports(path: Path) -> tuple[str, ...]:
    """Modules that a file imports anywhere in it, in full; relative imports are refused."""
    return tuple(_imports(path))


def _imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import in line {node.lineno}"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def package_of(module: str) -> str:
    """Our package that a module belongs to, or the library's name."""
    fits = [package for package in ALLOWED if f"{module}.".startswith(f"{package}.")]
    return max(fits, key=len) if fits else module.split(".")[0]


def ours(path: Path) -> set[str]:
    return {package for module in imports(path) if (package := package_of(module)) in ALLOWED}


def libraries(path: Path) -> set[str]:
    found = {package_of(module) for module in imports(path)}
    return found - set(ALLOWED) - set(sys.stdlib_module_names)


@pytest.mark.parametrize("package", ALLOWED)
def test_a_package_imports_only_from_its_left(package: str) -> None:
    assert FILES_OF[package]
    for path in FILES_OF[package]:
        assert ours(path) <= ALLOWED[package] | {package}, path


@pytest.mark.parametrize("package", FLOORS)
def test_a_room_imports_only_from_those_before_it(package: str) -> None:
    floors, seen = FLOORS[package], set()
    for path in FILES_OF[package]:
        at = path.relative_to(ROOT / package.replace(".", "/")).with_suffix("").parts[0]
        if at == "__init__":
            continue
        seen.add(at)
        own = [m.split(".")[2] for m in imports(path) if m.startswith(f"{package}.")]
        assert all(floors.index(m) <= floors.index(at) for m in own), path
    assert seen == set(floors)


def test_the_truth_plant_shares_nothing_with_the_product() -> None:
    for path in FILES_OF["pneugantry.truth"]:
        assert libraries(path) <= TRUTH_LIBRARIES, path


def test_controllers_need_numpy_and_numba_alone() -> None:
    for path in FILES_OF["controllers"]:
        assert libraries(path) <= CONTROLLER_LIBRARIES, path


@pytest.mark.parametrize("library", WRAPPED)
def test_a_wrapped_library_is_imported_in_its_own_files_only(library: str) -> None:
    found = {
        path.relative_to(ROOT).as_posix()
        for files in FILES_OF.values()
        for path in files
        if library in libraries(path)
    }
    assert found
    assert found <= WRAPPED[library]


def test_every_import_is_a_declared_dependency() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [
        line
        for extra in ("zig", "cluster", "gym")
        for line in project["optional-dependencies"][extra]
    ]
    declared = {re.split(r"[^a-z0-9_]", line)[0] for line in [*project["dependencies"], *extras]}
    for files in FILES_OF.values():
        for path in files:
            assert libraries(path) <= declared | {"llvmlite"}, path  # llvmlite comes with numba
