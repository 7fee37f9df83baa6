"""The table of the standard library: of which version, resumed, and what a jump of the reference
allows.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import standard_library
from benchmarks.standard_library import distance, main


@pytest.fixture
def library(tmp_path: Path) -> Path:
    """A library of two models, named as the standard one is."""
    package = tmp_path / "lib" / "Modelica" / "Math"
    package.mkdir(parents=True)
    (package.parent / "package.mo").write_text(
        'package Modelica\n  annotation(version="9.1", uses(X(version="2")));\nend Modelica;\n'
    )
    (package / "package.mo").write_text("within Modelica;\npackage Math\nend Math;\n")
    for name, rate in (("A", "-x"), ("B", "-y")):
        (package / f"{name}.mo").write_text(
            f"within Modelica.Math;\nmodel {name}\n  Real x(start = 1);\nequation\n"
            f"  der(x) = {rate};\nend {name};\n"
        )
    (package / "package.order").write_text("A\nB\n")
    return tmp_path / "lib"


def test_the_version_is_told_and_a_run_goes_on_where_it_stopped(library, tmp_path, capsys) -> None:
    out = tmp_path / "found.json"
    words = [str(library), "--within", "Math", "--json", str(out)]
    assert main([*words, "--only", ".A"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("Modelica Standard Library 9.1\n")
    assert "compiled           Modelica.Math.A" in said
    out.write_text(out.read_text().replace('"compiled"', '"right"'))
    assert main([*words, "--resume"]) == 0
    said = capsys.readouterr().out
    assert "right              Modelica.Math.A" in said  # not run again
    assert "refused            Modelica.Math.B" in said
    assert "| Math | 2 | 0 | 1 | 0 | 0 | 1 | 0 |" in said


def test_results_of_another_version_are_not_gone_on_with(library, tmp_path, capsys) -> None:
    out = tmp_path / "found.json"
    standard_library.write(out, "9.0", [])
    words = [str(library), "--within", "Math", "--json", str(out), "--resume"]
    assert main(words) == 2
    assert "of library 9.0, not 9.1; move it" in capsys.readouterr().err
    assert main([str(tmp_path), "--within", "Math"]) == 2
    assert "give the folder that holds Modelica" in capsys.readouterr().err


def test_a_jump_may_come_an_interval_of_the_reference_late_and_no_more() -> None:
    t = np.linspace(0.0, 1.0, 5001)
    step = (t > 0.5).astype(float)
    assert distance(t, (t > 0.5001).astype(float), t, step) == 0.0
    assert distance(t, (t > 0.502).astype(float), t, step) == 1.0
