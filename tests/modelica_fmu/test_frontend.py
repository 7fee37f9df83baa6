"""The front end alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from modelica_fmu.compiler import compile_model
from modelica_fmu.errors import InputError

DECAY = "model M\n  Real x(start = 1, fixed = true);\nequation\n  der(x) = -x;\nend M;\n"


def refusal(folder: Path, text: str) -> str:
    (folder / "m.mo").write_text(text)
    with pytest.raises(InputError) as refused:
        compile_model(folder / "m.mo", "M")
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith(str(folder / "m.mo"))
    assert refused.value.hint
    return str(refused.value)


def test_files_beside_the_model_are_no_part_of_it(tmp_path: Path) -> None:
    (tmp_path / "old.mo").write_text(DECAY.replace("-x", "-2*x"))
    (tmp_path / "m.mo").write_text(DECAY)
    assert compile_model(tmp_path / "m.mo", "M").states


def test_a_loop_that_runs_away_is_stopped(tmp_path: Path) -> None:
    loop = (
        "function f\n  input Real u;\n  output Real y;\nalgorithm\n  y := u;\n  for i in "
        "1:1000000000 loop y := y + 1; end for;\nend f;\n"
    )
    said = refusal(tmp_path, loop + DECAY.replace("-x", "-f(x)"))
    assert "a function loops more than 10000 times" in said


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("-x", " + ".join(["x"] * 2000), "nested too deeply, or has too many terms"),
        ("-x", "-x\0", "unexpected"),
        (
            "x(start = 1, fixed = true)",
            "x[20000](each start = 1, each fixed = true)",
            "20000 scalar variables, at most 10000",
        ),
        (
            "equation",
            "  Real y[2100];\nequation\n  for i in 1:2100 loop\n    y[i] = x;\n  end for;",
            "2101 unknowns, at most 2000",
        ),
        (
            "equation",
            "  parameter Real p = time;\nequation",
            ":3: the parameter p depends on a variable",
        ),
        ("start = 1", "start = size(0, 1)", ":2: size() of what has no such dimension"),
        ("start = 1", "start = log(0)", ":2: the value of x is -inf; give a finite number"),
    ],
)
def test_what_is_too_large_or_too_odd_is_said(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    assert said in refusal(tmp_path, DECAY.replace(old, new, 1))


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("for i in 1:20000 loop y := y + 1; end for;", "a function loops more than 10000 times"),
        ("w := {u, u}; w[3] := u;", "subscript 3 does not fit the array w"),
        (
            "w := {u, u}; for i in 0:1 loop w[i] := u; end for;",
            "subscript 0 does not fit the array w",
        ),
    ],
)
def test_a_function_that_runs_away_or_out_of_its_array_is_refused(
    tmp_path: Path, body: str, said: str
) -> None:
    function = (
        f"function f\n  input Real u;\n  output Real y;\nprotected\n  Real "
        f"w[2];\nalgorithm\n  y := u;\n  {body}\nend f;\n"
    )
    assert said in refusal(tmp_path, function + DECAY.replace("-x", "-f(x)"))


def test_a_table_of_a_thousand_numbers_is_translated_once(tmp_path: Path) -> None:
    numbers = ", ".join(str(k) for k in range(1, 1001))
    (tmp_path / "m.mo").write_text(
        DECAY.replace("equation", f"  parameter Real p[1000] = {{{numbers}}};\nequation").replace(
            "-x", "-p[1000]*x"
        )
    )
    starts = {v.name: v.start for v in compile_model(tmp_path / "m.mo", "M").variables}
    assert (starts["p[1]"], starts["p[1000]"]) == (1.0, 1000.0)


NESTED = """package P
  package Other
    model M
      parameter Real a = 1; parameter Real b = 2;
    end M;
  end Other;
  model F "é"
    parameter Real a = 1; parameter Real b = 2; Real y;
  equation
    y = a + b;
  end F;
  model C
    F f(a = 3); parameter Real c = 5;
  end C;
  model Base
    C k(c = 7, f(b = 4));
  end Base;
  model M
    extends Base(k(EXTENSION));
  end M;
  model Further
    extends M(k(c = 9));
  end Further;
end P;
"""


@pytest.mark.parametrize("extension", ["c = 8", "f(b = 10)", "f(a = 11, b = 4)"])
def test_modifiers_of_a_base_class_stay_where_others_are_modified(
    tmp_path: Path, extension: str
) -> None:
    (tmp_path / "m.mo").write_text(NESTED.replace("EXTENSION", extension))
    given = {"k.c": 7.0, "k.f.a": 3.0, "k.f.b": 4.0} | {
        "c = 8": {"k.c": 8.0},
        "f(b = 10)": {"k.f.b": 10.0},
    }.get(extension, {"k.f.a": 11.0})
    for name, values in (("P.M", given), ("P.Further", given | {"k.c": 9.0})):
        starts = {
            v.name: v.start
            for v in compile_model(tmp_path / "m.mo", name).variables
            if v.name.startswith("k.")
        }
        assert {path: starts[path] for path in values} == values


@pytest.mark.parametrize("name", ["P.M", "P.Further"])
def test_modifiers_at_three_levels_add_up(tmp_path: Path, name: str) -> None:
    (tmp_path / "m.mo").write_text(NESTED.replace("EXTENSION", "f(a = 11)"))
    starts = {v.name: v.start for v in compile_model(tmp_path / "m.mo", name).variables}
    assert (starts["k.f.a"], starts["k.f.b"]) == (11.0, 4.0)


def test_start_values_stand_in_for_the_models_own(tmp_path: Path) -> None:
    (tmp_path / "m.mo").write_text(NESTED.replace("EXTENSION", "c = 8"))
    starts = {
        v.name: v.start for v in compile_model(tmp_path / "m.mo", "P.M", {"k.f.a": 12.0}).variables
    }
    assert (starts["k.f.a"], starts["k.f.b"], starts["k.c"]) == (12.0, 4.0, 8.0)
    with pytest.raises(InputError, match=r"P\.M has no free parameter k\.f\.y"):
        compile_model(tmp_path / "m.mo", "P.M", {"k.f.y": 1.0})
