"""Every notebook runs from top to bottom, and is kept without outputs."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest
from matplotlib.figure import Figure

NOTEBOOKS = [
    Path(__file__).parents[2] / "notebooks" / f"{name}.ipynb"
    for name in (
        "root_locus",
        "lag",
        "identification",
        "tracking",
        "own_controller_and_effect",
        "diagnosis",
    )
]


def cells(path: Path) -> list[dict]:
    return [
        cell
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]
        if cell["cell_type"] == "code"
    ]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_and_its_pictures_name_their_units(path: Path, tmp_path: Path) -> None:
    names: dict[str, object] = {}
    figures = 0
    for i, cell in enumerate(cells(path)):
        lines = "".join(cell["source"])
        *body, last = [*_statements(lines)]
        exec(compile("\n".join(body), f"{path.name} cell {i}", "exec"), names)
        if not _is_expression(last):
            exec(compile(last, f"{path.name} cell {i}", "exec"), names)
            continue
        shown = eval(compile(last, f"{path.name} cell {i}", "eval"), names)
        if isinstance(shown, Figure):
            figures += 1
            shown.savefig(tmp_path / f"{i}.png")
            for axes in shown.axes:
                assert axes.get_xlabel()
                assert axes.get_ylabel()
    assert figures >= 2


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_holds_no_outputs(path: Path) -> None:
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in cells(path))


def _statements(source: str) -> list[str]:
    return [ast.get_source_segment(source, node) or "" for node in ast.parse(source).body]


def _is_expression(statement: str) -> bool:
    try:
        compile(statement, "cell", "eval")
    except SyntaxError:
        return False
    return True
