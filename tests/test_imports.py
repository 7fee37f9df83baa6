"""Who may import whom: data flows one way, and a library that is wrapped is imported in one place."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ORDER = ("controllers", "pyfmi_runner", "analysis", "diagnosis", "studies", "pneugantry")
TRUTH_PACKAGE = "studies/truth"  # the independent truth plant: shares no line with the product, and only the two right of it see it
ALLOWED = {package: set(ORDER[: place + 1]) for place, package in enumerate(ORDER)}  # itself and what stands to its left
ALLOWED["studies"] |= {TRUTH_PACKAGE}
ALLOWED["pneugantry"] |= {TRUTH_PACKAGE}
FILES_OF = {package: sorted((ROOT / package).rglob("*.py")) for package in ORDER}
TRUTH = sorted((ROOT / "studies" / "truth").rglob("*.py"))
TRUTH_LIBRARIES = {"numpy", "scipy", "numba", "pandas"}
CONTROLLER_LIBRARIES = {"numpy", "numba"}
WRAPPED = {  # library: the files that may import it
    "fmpy": {  # solver_check: fmpy's CVode as an independent master; paths: its loops, timed; importers: beside the others
        "pyfmi_runner/fmu.py",
        "studies/solver_check.py",
        "studies/bench/paths.py",
        "studies/importers.py",
    },
    "matplotlib": {path.relative_to(ROOT).as_posix() for path in (ROOT / "analysis").glob("plots*.py")},
    "rumoca": {"pyfmi_runner/build/parser.py"},
    "llvmlite": {"pyfmi_runner/native.py"},
    "gymnasium": {"pyfmi_runner/gym_env.py"},  # an extra: nothing else needs it
    "distributed": {"studies/jobs/cluster.py"},  # loaded only where a scheduler is given
}


def imports(path: Path) -> Iterator[str]:
    """Modules that a file imports anywhere in it, in full; relative imports are refused."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import in line {node.lineno}"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def package_of(module: str) -> str:
    """Our package that a module belongs to, or the library's name."""
    return TRUTH_PACKAGE if module.startswith("studies.truth") else module.split(".")[0]


def ours(path: Path) -> set[str]:
    return {package for module in imports(path) if (package := package_of(module)) in (*ORDER, TRUTH_PACKAGE)}


def libraries(path: Path) -> set[str]:
    return {package for module in imports(path) if (package := package_of(module)) not in (*ORDER, TRUTH_PACKAGE, *sys.stdlib_module_names)}


@pytest.mark.parametrize("package", ORDER)
def test_a_package_imports_only_from_its_left(package: str) -> None:
    assert FILES_OF[package]
    for path in FILES_OF[package]:
        assert ours(path) <= ALLOWED[package], path


def test_the_truth_plant_shares_nothing_with_the_product() -> None:
    assert TRUTH
    for path in TRUTH:
        assert ours(path) <= {TRUTH_PACKAGE}, path
        assert libraries(path) <= TRUTH_LIBRARIES, path


def test_controllers_need_numpy_and_numba_alone() -> None:
    for path in FILES_OF["controllers"]:
        assert libraries(path) <= CONTROLLER_LIBRARIES, path


@pytest.mark.parametrize("library", WRAPPED)
def test_a_wrapped_library_is_imported_in_its_own_files_only(library: str) -> None:
    found = {path.relative_to(ROOT).as_posix() for files in FILES_OF.values() for path in files if library in libraries(path)}
    assert found
    assert found <= WRAPPED[library]


def test_every_import_is_a_declared_dependency() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [line for extra in ("zig", "cluster", "gym") for line in project["optional-dependencies"][extra]]
    declared = {re.split(r"[^a-z0-9_]", line)[0] for line in [*project["dependencies"], *extras]}
    for files in FILES_OF.values():
        for path in files:
            assert libraries(path) <= declared | {"llvmlite"}, path  # llvmlite comes with numba
