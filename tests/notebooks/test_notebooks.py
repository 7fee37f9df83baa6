"""Every notebook runs in a kernel of its own and shows its pictures; kept without outputs."""

from __future__ import annotations

import base64
import io
import os
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from matplotlib.image import imread
from nbclient import NotebookClient

ROOT = Path(__file__).parents[2]
PICTURES = {  # notebook: pictures that a reader sees
    "root_locus": 3,
    "lag": 2,
    "identification": 3,
    "tracking": 2,
    "own_controller_and_effect": 2,
    "diagnosis": 2,
}


def read(name: str) -> Any:
    return nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4)


def pictures(notebook: Any) -> list[Any]:
    """Pictures in the outputs, as arrays (rows, columns, colours)."""
    shown = [
        output["data"]["image/png"]
        for cell in notebook.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        if "image/png" in output.get("data", {})
    ]
    return [imread(io.BytesIO(base64.b64decode(text))) for text in shown]


LONG = ("diagnosis",)  # a whole diagnosis: 80 s; the command's own tests run one each time


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] if n in LONG else []) for n in PICTURES]
)
def test_a_notebook_runs_and_shows_its_pictures(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    notebook = read(name)
    client = NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    if keep := os.environ.get("NOTEBOOKS_OUT"):
        nbformat.write(notebook, Path(keep) / f"{name}.ipynb")
    seen = pictures(notebook)
    assert len(seen) == PICTURES[name]
    for picture in seen:
        assert min(picture.shape[:2]) > 200  # pixels
        assert float(np.mean(picture[:, :, :3].min(axis=2) < 0.7)) > 0.005  # ink


@pytest.mark.parametrize("name", PICTURES)
def test_a_notebook_holds_no_outputs_and_says_what_it_shows(name: str) -> None:
    notebook = read(name)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in code)
    words = sum(len(c.source.split()) for c in notebook.cells if c.cell_type == "markdown")
    assert words > 60
