"""Equations as text: found with their sides, and a term added to just one of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from modelica_fmu.cut import structure
from pneugantry.learn.equations.sources import Addition, components_of, equations_of, with_additions

MODEL = """
package P
  block Guide "with an equation = in its words"
    parameter Real c = 2;
    input Real v;
    output Real F;
    Real w(start = 0, fixed = true);
  initial equation
    assert(c > 0, "c; must be positive");
  equation
    F = if v > 0 then c*v else -c "against; v";
    if c > 1 then
      der(w) = if v > 1 then v else 1;
    else
      der(w) = 0;
    end if;
    when v > 3 then
      reinit(w, 0);
    end when;
  end Guide;
  model Base
    Real x(start = 0, fixed = true);
    input Real u;
  equation
    der(x) = u - x; // der(x) = 0;
  end Base;
  model Cart
    extends Base;
    Guide left, right(c = 3);
    Guide several[2];
  equation
    left.v = x;
    right.v = 2*x;
    for i in 1:2 loop
      several[i].v = x;
    end for;
  end Cart;
end P;
"""


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "P.mo"
    path.write_text(MODEL, encoding="utf-8")
    return path


def test_plain_equations_are_found_with_both_sides(model: Path) -> None:
    found = [(e.of_class[-1], e.number, e.left, e.right) for e in equations_of(model)]
    assert found == [
        ("Guide", 1, "F", "if v > 0 then c*v else -c"),
        ("Base", 1, "der(x)", "u - x"),
        ("Cart", 1, "left.v", "x"),
        ("Cart", 2, "right.v", "2*x"),
    ]


def test_components_name_the_classes_whose_equations_they_have(model: Path) -> None:
    found = components_of(model, "P.Cart")
    assert found == {
        "": [("P", "Cart"), ("P", "Base")],
        "left": [("P", "Guide")],
        "right": [("P", "Guide")],
    }


def test_a_term_goes_into_one_equation_and_the_file_stays_modelica(model: Path) -> None:
    first = next(e for e in equations_of(model) if e.of_class[-1] == "Guide")
    added = Addition("Real extra;", "extra", "extra = 5;")
    text = with_additions(MODEL, {first: added})
    assert 'F = (if v > 0 then c*v else -c) + extra "against; v";\nextra = 5;' in text
    assert (
        text.replace("public\nReal extra;\n  ", "")
        .replace("\nextra = 5;", "")
        .replace("(if v > 0 then c*v else -c) + extra", "if v > 0 then c*v else -c")
        == MODEL
    )
    model.write_text(text, encoding="utf-8")
    assert {"left.extra", "right.extra"} <= set(structure(model, "P.Cart").roots)
