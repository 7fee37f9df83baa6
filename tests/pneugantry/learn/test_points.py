"""What a missing term may be a function of."""

from __future__ import annotations

from pathlib import Path
from typing import cast

from modelica_fmu.cut import deciders, structure
from pneugantry.engine.plant import Plant
from pneugantry.learn.equations.points import Opened, Point
from pneugantry.learn.equations.sources import equations_of

MODEL = """
model Slider
  input Real u;
  Real v(start = 0, fixed = true);
  Real drag;
  Boolean up;
  Integer gear;
equation
  up = v > 0;
  gear = if v > 1 then 2 else 1;
  drag = (if up then 2 else 1)*v;
  der(v) = u - gear*drag;
end Slider;
"""


def test_a_term_is_a_function_of_numbers_that_a_model_can_add(tmp_path: Path) -> None:
    path = tmp_path / "Slider.mo"
    path.write_text(MODEL, encoding="utf-8")
    points = tuple(Point("", e) for e in equations_of(path))
    opened = Opened(
        cast(Plant, None), points, (), structure(path, "Slider"), deciders(path, "Slider"), tmp_path
    )
    assert {"up", "gear"} <= set(opened.shape.roots)
    assert opened.variables(points[-1]) == ["drag", "u", "v"]


def test_what_decides_a_variable_at_once_ends_at_states(tmp_path: Path) -> None:
    path = tmp_path / "Slider.mo"
    path.write_text(MODEL, encoding="utf-8")
    found = deciders(path, "Slider")
    assert {"up", "v"} <= found["drag"]
    assert not {"u", "gear", "der(v)"} & found["drag"]
    assert {"u", "gear", "drag", "up", "v"} <= found["der(v)"]
    assert "v" not in found
