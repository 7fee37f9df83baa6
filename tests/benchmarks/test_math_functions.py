"""The table of `Modelica.Math`: its measure, and what it calls right, wrong and refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import math_functions
from benchmarks.math_functions import main

LIBRARY = """package Modelica
  package Math
    function exp input Real u; output Real y; algorithm y := 2^(u/0.6931471805599453); end exp;
    function cos input Real u; output Real y; algorithm y := 1 - u^2/2 + u^4/24; end cos;
    function sin input Real u; output Real y; external "C" y = sin(u); end sin;
    package BooleanVectors
      function anyTrue
        input Boolean b[:]; output Boolean y = false;
      algorithm
        for i in 1:size(b, 1) loop y := y or b[i]; end for;
      end anyTrue;
    end BooleanVectors;
    package Vectors
      function reverse
        input Real v[:]; output Real r[size(v, 1)] = v[end:-1:1];
      algorithm
      end reverse;
    end Vectors;
  end Math;
end Modelica;
"""


def test_functions_are_told_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "Modelica.mo").write_text(LIBRARY)
    monkeypatch.setattr(math_functions, "SCALAR", {k: math_functions.SCALAR[k] for k in SOME[:3]})
    monkeypatch.setattr(math_functions, "FIRST", {k: math_functions.FIRST[k] for k in SOME[3:4]})
    monkeypatch.setattr(math_functions, "COUNTED", {k: math_functions.COUNTED[k] for k in SOME[4:]})
    monkeypatch.setenv("MODELICAPATH", "")
    assert main([str(tmp_path), "--json", str(tmp_path / "found.json")]) == 1
    found = {o["function"]: o for o in json.loads((tmp_path / "found.json").read_text())}
    assert [found[name]["state"] for name in SOME] == [
        "right",
        "wrong",
        "refused",
        "right",
        "right",
    ]
    assert found["cos"]["error"] == pytest.approx(5.5e-4, rel=0.1)  # u^6/720 at 0.93, beside 1.6
    assert str(tmp_path) not in found["sin"]["said"]


SOME = ["exp", "cos", "sin", "Vectors.reverse", "BooleanVectors.anyTrue"]
