"""Size of the code's parts: longest functions, most arguments, longest line, files and lines by
package: `python -m benchmarks.code_size [--json FILE]`.
"""

from __future__ import annotations

import argparse
import ast
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("modelica_fmu", "controllers", "pyfmi_runner", "pneugantry", "benchmarks", "examples")

__all__ = ["Function", "functions", "longest_line", "main"]


@dataclass(frozen=True)
class Function:
    """A function or method; `arguments` without self and cls, *args and **kwargs as one each."""

    file: str
    name: str
    lines: int
    arguments: int


def functions(packages: tuple[str, ...] = PACKAGES) -> Iterator[Function]:
    """Every function of the packages; those inside others as well."""
    for path in _files(packages):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                given = node.args
                named = [*given.posonlyargs, *given.args, *given.kwonlyargs]
                rest = (given.vararg is not None) + (given.kwarg is not None)
                count = sum(a.arg not in ("self", "cls") for a in named) + rest
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                yield Function(path.relative_to(ROOT).as_posix(), node.name, lines, count)


def longest_line(packages: tuple[str, ...] = PACKAGES) -> tuple[int, str]:
    """Characters and place of the longest line that holds a space (data in letters has none)."""
    found = (0, "")
    for path in _files(packages):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            if " " in line.strip() and "# type: ignore" not in line:
                found = max(found, (len(line), f"{path.relative_to(ROOT).as_posix()}:{number}"))
    return found


def _files(packages: tuple[str, ...]) -> list[Path]:
    return [path for package in packages for path in sorted((ROOT / package).rglob("*.py"))]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.code_size", description="Size of the code's parts."
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures as JSON")
    options = parser.parse_args(arguments)
    found = list(functions())
    print("package: files, lines")
    for package in PACKAGES:
        files = _files((package,))
        lines = sum(len(p.read_text(encoding="utf-8").splitlines()) for p in files)
        print(f"  {package}: {len(files)}, {lines}")
    print("longest functions")
    for f in sorted(found, key=lambda f: -f.lines)[:10]:
        print(f"  {f.lines} lines  {f.file} {f.name}")
    many = sorted((f for f in found if f.arguments > 6), key=lambda f: -f.arguments)
    print(f"{len(many)} of {len(found)} functions with more than six arguments")
    for f in many:
        print(f"  {f.arguments}  {f.file} {f.name}")
    print("longest line: {} characters, {}".format(*longest_line()))
    if options.json:
        figures = {"schema": "code_size/1", "functions": [asdict(f) for f in found]}
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
