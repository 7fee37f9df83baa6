"""What the standard library needs of the language, on small models of our own with closed forms."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tiny import library_of

from modelica_fmu.compiler import compile_model
from modelica_fmu.errors import InputError

TYPES = """within Modelica.Blocks;
package Types
  type Smoothness = enumeration(LinearSegments, ContinuousDerivative, ConstantSegments);
  type Extrapolation = enumeration(HoldLastPoint, LastTwoPoints, Periodic, NoExtrapolation);
  type TimeEvents = enumeration(Always, AtDiscontinuities, NoTimeEvents);
end Types;
"""
TABLES = "within Modelica.Blocks; package Tables package Internal end Internal; end Tables;"


@pytest.fixture
def blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A model that sees a standard library with nothing in it but what the compiler replaces."""
    folder = tmp_path / "Modelica" / "Blocks"
    folder.mkdir(parents=True)
    (folder.parent / "package.mo").write_text("package Modelica end Modelica;")
    (folder / "package.mo").write_text("within Modelica; package Blocks end Blocks;")
    (folder / "Types.mo").write_text(TYPES)
    (folder / "Tables.mo").write_text(TABLES)
    (folder.parent / "Math.mo").write_text(
        "within Modelica; package Math package Matrices end Matrices; end Math;"
    )
    monkeypatch.setenv("MODELICAPATH", str(tmp_path))
    return lambda text: library_of(text, tmp_path)


def refused(text: str, folder: Path) -> str:
    file = folder / "m.mo"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        compile_model(file, "M")
    return str(error.value)


def test_array_functions_decide_sizes(tiny) -> None:
    m = tiny("""model M
  parameter Integer n[:] = cat(1, {1}, vector([2, 3]));
  parameter Real table[:, :] = transpose([n, n]);
  output Real x[size(table, 2) + n[3]] = linspace(0, 1, size(table, 2) + sum(n) - 3);
end M;
""").start()
    assert [m.get(f"x[{i}]") for i in range(1, 7)] == pytest.approx([0, 0.2, 0.4, 0.6, 0.8, 1])


def test_an_initial_equation_gives_what_pre_starts_with(tiny) -> None:
    """`pre(u) = value` for a u that an equation determines was "too many initial equations"."""
    m = tiny("""model M
  parameter Boolean first = true;
  Boolean u, y, other;
initial equation
  pre(u) = first;
  pre(other) = false;
equation
  y = pre(u);
  u = not (time > 0.5) and y;
  other = u or pre(other);
end M;
""").start()
    t, y, other = m.run(1.0, "y", "other", step=0.04)
    assert (y == (t < 0.5)).all()
    assert (other == 1).all()


def test_initial_equations_give_parameters_one_after_the_other(tiny) -> None:
    """With their start values of 0 Newton's method met 0/sqrt(0), and took it for a solution."""
    m = tiny("""model M
  function root "two results"
    input Real c; input Integer n;
    output Real a[n]; output Real b[size(a, 1)];
  protected
    Real half[size(b, 1)] "its size stands on an output";
  algorithm
    half := fill(c/2, n);
    a := half .^ 2;
    b := {a[i]/sqrt(a[i]) for i in 1:n};
  end root;
  parameter Integer n = 2;
  parameter Real c = 6;
  parameter Real a[n](each fixed = false), b[n](each fixed = false), k(fixed = false);
  Real x;
initial equation
  (a, b) = root(c, n);
  k = a[1]/sqrt(b[2]);
  der(x) = 0;
equation
  der(x) = -k*(x - b[1]);
end M;
""").start()
    assert [m.get(n) for n in ("a[2]", "b[1]", "x")] == pytest.approx([9, 3, 3])
    assert m.get("k") == pytest.approx(9 / math.sqrt(3))


def test_initial_equations_that_give_no_number_stop_the_start(tiny) -> None:
    """Of the residuals (NaN, 0) with a singular matrix only the last one was looked at."""
    m = tiny("""model M
  Real x(start = 0), y(start = 0);
initial equation
  y = x/sqrt(x);
  x^2 = 0;
equation
  der(x) = 0;
  der(y) = 0;
end M;
""")
    assert m.library.core_initialise(m.core, 0.0) == 3
    assert any("no solution" in said for _, said in m.messages)


def test_a_function_takes_functions_and_calls_itself(tiny) -> None:
    m = tiny("""model M
  partial function scalar
    input Real u; output Real y;
  end scalar;
  function wave
    extends scalar;
    input Real a; input Real w;
  algorithm
    y := a*sin(w*u);
  end wave;
  function integral "Simpson's rule, halved until it changes by less than 1e-9"
    input scalar f; input Real a; input Real b;
    output Real s;
  protected
    Real m = (a + b)/2, whole, halves;
  algorithm
    whole := (b - a)/6*(f(a) + 4*f(m) + f(b));
    halves := (b - a)/12*(f(a) + 4*f((a + m)/2) + 2*f(m) + 4*f((m + b)/2) + f(b));
    if abs(whole - halves) < 1e-9 then
      s := halves;
    else
      s := integral(f, a, m) + integral(f, m, b);
    end if;
  end integral;
  parameter Real a = 2, w = 3, k = 5;
  output Real s = k*integral(function wave(a = a, w = w), 0, 1);
end M;
""").start()
    assert m.get("s") == pytest.approx(5 * 2 / 3 * (1 - math.cos(3)), abs=1e-7)
    assert "k" in m.references
    assert "w" not in m.references  # how often it calls itself hangs on it: a constant


def test_rounds_that_hang_on_a_parameter_make_it_a_constant(tiny) -> None:
    m = tiny("""model M
  function root "Heron's method"
    input Real a; output Real x;
  algorithm
    x := a;
    while abs(x^2 - a) > 1e-12*a loop
      x := (x + a/x)/2;
    end while;
  end root;
  parameter Real a = 1e4;
  output Real y = root(a);
end M;
""").start()
    assert m.get("y") == pytest.approx(100, rel=1e-12)


def test_rounds_that_hang_on_a_variable_are_refused(tmp_path: Path) -> None:
    said = refused(
        """model M
  function root
    input Real a; output Real x;
  algorithm
    x := a;
    while abs(x^2 - a) > 1e-12*a loop
      x := (x + a/x)/2;
    end while;
  end root;
  output Real y = root(2 + time);
end M;
""",
        tmp_path,
    )
    assert "m.mo:6: " in said
    assert "while" in said


CHECKED = """model M
  function check
    input Real table[:, :];
  algorithm
    assert(table[1, 1] >= 0, "the first row is negative");
  end check;
  constant Real table[:, :] = [%s, 1; 2, 3];
  output Real y = table[2, 2];
equation
  check(table);
end M;
"""


def test_a_function_that_only_checks(tiny, tmp_path: Path) -> None:
    assert tiny(CHECKED % "0").start().get("y") == 3
    assert "m.mo:5: an assertion fails: the first row is negative" in refused(
        CHECKED % "-1", tmp_path
    )


def test_branches_of_arrays_and_of_their_elements(tiny) -> None:
    """Which branch holds is a variable here: the branches' scalars are counted."""
    m = tiny("""model M
  Boolean plain;
  output Real x[2];
equation
  plain = time < 0.5;
  if plain then
    x = {1, 2};
  else
    for i in 1:2 loop
      x[i] = 10*i;
    end for;
  end if;
end M;
""").start()
    t, x = m.run(1.0, "x[2]", step=0.04)
    assert (x == np.where(t < 0.5, 2, 20)).all()


def test_a_message_of_several_lines(tiny) -> None:
    """It was printed into the C as it stands, which no compiler took."""
    m = tiny("""model M
  Real x(start = 0, fixed = true);
equation
  der(x) = 1;
  assert(x < 0.5, "x is
too large");
end M;
""").start()
    assert m.step(0.6) == 3
    assert any("x is too large" in said for _, said in m.messages)


def test_shared_terms_of_parameters_are_printed_once(tiny) -> None:
    """Each round uses the one before twice: printing took 2^60 steps."""
    m = tiny("""model M
  function logistic
    input Real r; output Real y;
  algorithm
    y := 0.4;
    for i in 1:60 loop
      y := r*y*(1 - y);
    end for;
  end logistic;
  parameter Real r = 2.8;
  output Real y = logistic(r)*time;
end M;
""").start()
    assert m.run(1.0, "y")[1][-1] == pytest.approx(1 - 1 / 2.8, rel=1e-6)


TIME_TABLE = """model M
  import Modelica.Blocks.Types.*;
  import Modelica.Blocks.Tables.Internal.*;
  parameter Real rows[:, :] = [0, 1; 0.3, 4; 0.3, 0; 0.7, 2];
  parameter ExternalCombiTimeTable id = ExternalCombiTimeTable("NoName", "NoName", rows, %s, {2},
    Smoothness.%s, Extrapolation.%s, %s, TimeEvents.%s);
  discrete Real next(start = 0, fixed = true);
  output Real y;
equation
  when {time >= pre(next), initial()} then
    next = getNextTimeEvent(id, time);
  end when;
  y = getTimeTableValueNoDer2(id, 1, time, next, pre(next));
end M;
"""


def held(t: np.ndarray) -> np.ndarray:
    return np.interp(t, [0, 0.3 - 1e-12, 0.3 + 1e-12, 0.7], [1, 4, 0, 2])


def stairs(t: np.ndarray) -> np.ndarray:
    return np.select([t < 0.3, t < 0.7], [1.0, 0.0], 2.0)


@pytest.mark.parametrize(
    ("settings", "meant"),
    [
        ((0, "LinearSegments", "HoldLastPoint", 0, "Always"), held),
        ((0, "LinearSegments", "HoldLastPoint", 0, "AtDiscontinuities"), held),
        ((0, "LinearSegments", "HoldLastPoint", 0, "NoTimeEvents"), held),
        (
            (0.1, "LinearSegments", "HoldLastPoint", 0.1, "Always"),
            lambda t: held(t - 0.1) * (t > 0.1),
        ),
        ((0, "LinearSegments", "Periodic", 0, "Always"), lambda t: held(t % 0.7)),
        ((0, "LinearSegments", "Periodic", 0, "AtDiscontinuities"), lambda t: held(t % 0.7)),
        (
            (0, "LinearSegments", "LastTwoPoints", 0, "Always"),
            lambda t: np.where(t < 0.7, held(t), 5 * t - 1.5),
        ),
        ((0, "ConstantSegments", "HoldLastPoint", 0, "Always"), stairs),
    ],
)
def test_a_table_over_time(blocks, settings, meant) -> None:
    m = blocks(TIME_TABLE % settings).start()
    t, y = m.run(2.0, "y", step=0.0193)
    assert y == pytest.approx(meant(t), abs=1e-9)


def test_a_table_over_time_stops_where_it_has_no_values(blocks) -> None:
    m = blocks(TIME_TABLE % (0, "LinearSegments", "NoExtrapolation", 0, "Always")).start()
    assert m.run(0.69, "y", step=0.03)[1][-1] == pytest.approx(1.95, abs=1e-9)
    m.step(0.05)
    assert math.isnan(m.get("y"))


def test_a_table_of_two_dimensions(blocks) -> None:
    """u1·u2 is bilinear: its table is exact, beyond the ends too."""
    m = blocks("""model M
  import Modelica.Blocks.Types.*;
  parameter ExternalCombiTable2D id = ExternalCombiTable2D("NoName", "NoName",
    [0, 1, 2, 4; -1, -1, -2, -4; 1, 1, 2, 4; 3, 3, 6, 12], Smoothness.LinearSegments,
    Extrapolation.LastTwoPoints);
  output Real y = Modelica.Blocks.Tables.Internal.getTable2DValue(id, 4*time - 2, 5*time);
end M;
""").start()
    t, y = m.run(1.5, "y", step=0.05)
    assert y == pytest.approx((4 * t - 2) * 5 * t, abs=1e-9)


def test_a_spline_through_a_table_is_refused(blocks, tmp_path: Path) -> None:
    said = refused(TIME_TABLE % (0, "ContinuousDerivative", "HoldLastPoint", 0, "Always"), tmp_path)
    assert "unsupportedSmoothness" in said


def test_linear_equations_of_matrices_that_move(blocks) -> None:
    """Rows are exchanged while running: the largest pivot is another one at each time."""
    m = blocks("""model M
  import Modelica.Math.Matrices.*;
  Real A[4, 4] = {{cos(i*j*time + i) for j in 1:4} for i in 1:4} - 3*time*identity(4);
  output Real x[4] = solve(A, {1, 2, 3, time});
  output Real d = det(A), one = sum(A[2, k]*inverse[k, 2] for k in 1:4);
  Real inverse[4, 4] = inv(A);
end M;
""").start()
    i = np.arange(1, 5)
    for t, *x, d, one in m.run(1.0, "x[1]", "x[2]", "x[3]", "x[4]", "d", "one", step=0.17).T:
        a = np.cos(np.outer(i, i) * t + i[:, None]) - 3 * t * np.eye(4)
        assert x == pytest.approx(np.linalg.solve(a, [1, 2, 3, t]), rel=1e-8)
        assert (d, one) == pytest.approx((np.linalg.det(a), 1.0), rel=1e-8)
