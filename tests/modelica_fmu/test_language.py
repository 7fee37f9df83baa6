"""The language beyond plain equations: each model's answer has a closed form."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tiny import library_of

from modelica_fmu.compiler import compile_model
from modelica_fmu.errors import InputError


def test_initial_equations_find_a_steady_state(tiny) -> None:
    m = tiny("""model M
  parameter Real a = 0.1; parameter Real b = 0.02; parameter Real c = 0.3; parameter Real d = 0.01;
  Real x(start = 10), y(start = 10);
initial equation
  der(x) = 0;
  der(y) = 0;
equation
  der(x) = x*(a - b*y);
  der(y) = y*(d*x - c);
end M;
""").start()
    assert [m.get("x"), m.get("y")] == pytest.approx([30.0, 5.0])
    _t, x, y = m.run(1.0, "x", "y", step=0.1)
    assert x == pytest.approx(30.0)
    assert y == pytest.approx(5.0)


def test_a_parameter_that_is_not_fixed_is_found(tiny) -> None:
    m = tiny("""model M
  parameter Real k(fixed = false, start = 1);
  Real x(start = 2, fixed = true);
  output Real y = 3*k;
initial equation
  der(x) = -8;
equation
  der(x) = -k*x;
end M;
""").start()
    assert [m.get("k"), m.get("y")] == pytest.approx([4.0, 12.0])
    assert m.run(0.5, "x")[1][-1] == pytest.approx(2 * math.exp(-2), rel=1e-6)


def test_initial_algorithms_and_discrete_start_values(tiny) -> None:
    m = tiny("""model M
  Real x; discrete Real n; parameter Real start = 5;
initial algorithm
  x := start;
  x := x + 1;
initial equation
  n = 2*start;
equation
  der(x) = -x;
  when sample(0.1, 0.1) then
    n = pre(n) + 1;
  end when;
end M;
""").start()
    assert [m.get("x"), m.get("n")] == pytest.approx([6.0, 10.0])
    m.run(0.35, "x", step=0.05)
    assert m.get("n") == 13.0


def test_too_many_initial_equations_are_refused(tmp_path: Path) -> None:
    (tmp_path / "m.mo").write_text(
        "model M\n  Real x(start = 1, fixed = true);\ninitial equation\n  der(x) = 0;\n"
        "equation\n  der(x) = -x;\nend M;\n"
    )
    with pytest.raises(InputError, match=r"m\.mo:4: too many initial equations"):
        compile_model(tmp_path / "m.mo", "M")


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("floor(3*time)", lambda t: np.floor(3 * t)),
        ("ceil(3*time)", lambda t: np.ceil(3 * t)),
        ("mod(time, 0.4)", lambda t: np.mod(t, 0.4)),
        ("rem(-time, 0.4)", lambda t: -np.fmod(t, 0.4)),
        ("div(5*time, 2)", lambda t: np.trunc(2.5 * t)),
        ("integer(2*time)", lambda t: np.floor(2 * t)),
        ("sign(time - 0.55)", lambda t: np.sign(t - 0.55)),
        ("semiLinear(time - 0.55, 2, 3)", lambda t: np.where(t > 0.55, 2, 3) * (t - 0.55)),
        ("homotopy(time, 7)", lambda t: t),
        ("smooth(0, if time > 0.55 then time - 0.55 else 0)", lambda t: np.maximum(t - 0.55, 0)),
    ],
)
def test_operators_that_jump_follow_their_definition(tiny, expression: str, value) -> None:
    m = tiny(
        f"model M\n  output Real y = {expression};\n  Real x(start = 0, fixed = true);\n"
        "equation\n  der(x) = y;\nend M;\n"
    ).start()
    t, y, x = m.run(1.5, "y", "x", step=0.07)
    assert y == pytest.approx(value(t), abs=1e-8)
    fine = (np.arange(200_000) + 0.5) * t[-1] / 200_000  # the integral by the midpoint rule
    assert x[-1] == pytest.approx(value(fine).mean() * t[-1], abs=1e-5)


def test_algorithms_if_equations_and_subscripts_that_vary(tiny) -> None:
    m = tiny("""model M
  output Real y, z, w; Integer i; Real v[3];
protected
  Real sum;
algorithm
  sum := 0;
  for k in 1:3 loop
    sum := sum + v[k];
  end for;
  y := sum/3;
equation
  v = {time, 2*time, 3*time};
  i = if time < 0.45 then 1 elseif time < 0.85 then 2 else 3;
  z = v[i];
  if time < 0.65 then
    w = 1;
  else
    w = 2;
  end if;
end M;
""").start()
    t, y, z, w = m.run(1.0, "y", "z", "w", step=0.1)
    assert y == pytest.approx(2 * t)
    assert z == pytest.approx(t * np.where(t < 0.45, 1, np.where(t < 0.85, 2, 3)))
    assert w == pytest.approx(np.where(t < 0.65, 1.0, 2.0))


def test_when_statements_of_one_algorithm_see_each_other(tiny) -> None:
    m = tiny("""model M
  discrete Integer n(start = 0, fixed = true), last(start = 0, fixed = true);
algorithm
  when sample(0.1, 0.1) then
    n := pre(n) + 1;
  end when;
  when sample(0.45, 1) then
    last := n;
    n := 0;
  end when;
end M;
""").start()
    m.run(0.65, "n", step=0.05)
    assert [m.get("last"), m.get("n")] == [4.0, 2.0]


def test_nonlinear_and_large_loops_are_solved_while_running(tiny) -> None:
    m = tiny("""model M
  Real x(start = 1), y(start = 1), v[12]; output Real s = sum(v);
equation
  x^2 + y^2 = 4 + time;
  x = y*exp(time);
  for i in 1:11 loop
    v[i] + v[i + 1] = i*time;
  end for;
  v[1] + v[3] + v[12] = 1;
end M;
""").start()
    t, x, y, s = m.run(1.0, "x", "y", "s", step=0.1)
    wanted = np.sqrt((4 + t) / (1 + np.exp(2 * t)))
    assert y == pytest.approx(wanted, rel=1e-9)
    assert x == pytest.approx(wanted * np.exp(t), rel=1e-9)
    for k, time in enumerate(t):
        matrix, right = np.zeros((12, 12)), np.zeros(12)
        for i in range(11):
            matrix[i, i] = matrix[i, i + 1] = 1
            right[i] = (i + 1) * time
        matrix[11, [0, 2, 11]], right[11] = 1, 1
        assert s[k] == pytest.approx(np.linalg.solve(matrix, right).sum())


def test_a_loop_without_a_solution_says_where(tiny) -> None:
    m = tiny(
        "model M\n  Real x(start = 1), y;\nequation\n  x^2 = 1 - time;\n  der(y) = x;\nend M;\n"
    )
    m.start()
    statuses = [m.step(0.1) for _ in range(12)]
    assert statuses[:9] == [0] * 9
    assert max(statuses) == 3
    assert any("of line 4 have no solution for x" in text for _, text in m.messages)


RIGID = """model M
  Real phi1(start = 0, fixed = true), w1(start = 0, fixed = true), phi2, w2, tau;
equation
  der(phi1) = w1; der(phi2) = w2;
  2*der(w1) = 3 - tau;
  4*der(w2) = tau;
  phi1 = phi2;
end M;
"""


def test_a_rigid_coupling_leaves_one_inertia(tiny) -> None:
    m = tiny(RIGID).start()
    t, phi, w, tau = m.run(1.0, "phi2", "w2", "tau", step=0.1)
    assert phi == pytest.approx(0.25 * t**2)
    assert w == pytest.approx(0.5 * t)
    assert tau == pytest.approx(2.0)


PENDULUM = """model M
  parameter Real L = 1; parameter Real g = 9.81;
  Real x(start = L, fixed = true), y(start = 0), vx(start = 0), vy(start = 0), lambda;
  output Real energy = 0.5*(vx^2 + vy^2) + g*y;
equation
  der(x) = vx; der(y) = vy;
  der(vx) = -lambda*x; der(vy) = -lambda*y - g;
  x^2 + y^2 = L^2;
end M;
"""


def test_a_pendulum_in_cartesian_coordinates_swings_through(tiny) -> None:
    m = tiny(PENDULUM).start()
    _t, x, y, energy = m.run(5.0, "x", "y", "energy", step=0.01)
    assert x**2 + y**2 == pytest.approx(1.0, abs=1e-12)
    assert energy == pytest.approx(0.0, abs=1e-6)
    assert x.min() < -0.999  # it has passed its lowest point


LIBRARY = {
    "package.mo": 'within ;\npackage L "A library"\n  constant Real half = 0.5;\n'
    '  type Angle = Real(unit = "rad");\nend L;\n',
    "package.order": "Parts\nTest\n",
    "Parts/package.mo": "within L;\npackage Parts\nend Parts;\n",
    "Parts/Pin.mo": "within L.Parts;\nconnector Pin\n  Real v;\n  flow Real i;\nend Pin;\n",
    "Parts/TwoPin.mo": "within L.Parts;\npartial model TwoPin\n  Pin p, n;\n  Real v, i;\n"
    "equation\n"
    "  v = p.v - n.v;\n  0 = p.i + n.i;\n  i = p.i;\nend TwoPin;\n",
    "Parts/Resistor.mo": "within L.Parts;\nmodel Resistor\n  extends TwoPin;\n"
    "  parameter Real R = 1;\nequation\n  v = R*i;\nend Resistor;\n",
    "Parts/Capacitor.mo": "within L.Parts;\nmodel Capacitor\n  extends TwoPin(v(start = 0, fixed = "
    "true));\n  parameter Real C = 1;\nequation\n  C*der(v) = i;\nend Capacitor;\n",
    "Parts/Source.mo": "within L.Parts;\nmodel Source\n  extends TwoPin;\n  outer Real level;\n"
    "equation\n  v = level;\nend Source;\n",
    "Parts/Ground.mo": "within L.Parts;\nmodel Ground\n  Pin p;\nequation\n"
    "  p.v = 0;\nend Ground;\n",
    "Test.mo": "within L;\nmodel Test\n  import L.Parts.*;\n  inner parameter Real level = 2;\n"
    "  replaceable model Load = Resistor(R = 3) constrainedby TwoPin;\n"
    "  parameter Boolean loaded = true;\n  Source s; Resistor r(R = half); Capacitor c; Ground g;\n"
    "  Load load if loaded;\nequation\n  connect(s.p, r.p); connect(r.n, c.p); connect(c.n, g.p);\n"
    "  connect(s.n, g.p); connect(load.p, c.p); connect(load.n, g.p);\nend Test;\n",
    "Other.mo": "within L;\nmodel Other\n  extends Test(redeclare model Load =\n"
    "    Parts.Resistor(R = 1));\n"
    "end Other;\n",
}


@pytest.mark.parametrize(("name", "load"), [("L.Test", 3.0), ("L.Other", 1.0)])
def test_a_library_of_folders_with_connectors_and_replaceable_models(
    tmp_path: Path, name: str, load: float
) -> None:
    for file, text in LIBRARY.items():
        (tmp_path / "L" / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "L" / file).write_text(text)
    m = library_of(None, tmp_path, name, [tmp_path / "L"]).start()
    t, v = m.run(1.0, "c.v", step=0.1)
    rate = 1 / 0.5 + 1 / load
    assert v == pytest.approx(2 / 0.5 / rate * (1 - np.exp(-rate * t)), rel=1e-6)


def test_enumerations_of_one_name_in_two_packages_are_two_types(tmp_path: Path) -> None:
    (tmp_path / "m.mo").write_text(
        "package P\n  package A\n    type E = enumeration(x, y);\n  end A;\n  package B\n"
        "    type E = enumeration(u, v, w);\n  end B;\n  model M\n    parameter A.E a = A.E.y;\n"
        "    parameter B.E b = B.E.w;\n    output Real z = if b == B.E.w and a == A.E.y then 1 "
        "else 0;\n  end M;\nend P;\n"
    )
    made = compile_model(tmp_path / "m.mo", "P.M")
    kinds = {v.name: v.enumeration for v in made.variables if v.enumeration}
    assert kinds == {"a": "P.A.E", "b": "P.B.E"}
    assert [name for name, _ in made.enumerations["P.B.E"]] == ["u", "v", "w"]


def test_records_functions_with_several_outputs_and_while(tiny) -> None:
    m = tiny(
        """record Point
  Real x = 1; Real y;
end Point;
function polar
  input Point p;
  output Real r; output Real angle;
algorithm
  r := sqrt(p.x^2 + p.y^2);
  angle := atan2(p.y, p.x);
end polar;
function find
  input Real u; input Real table[:]; output Real k;
algorithm
  k := 1;
  while u > table[integer(k)] loop
    k := k + 1;
  end while;
end find;
model M
  Point p(y = 1 + time); output Real r, a, k;
equation
  p.x = 2;
  (r, a) = polar(p);
  k = find(time, {0.25, 0.5, 0.75, 2});
end M;
""".replace("Real x = 1;", "Real x;")
    )
    m.start()
    t, r, a, k = m.run(1.0, "r", "a", "k", step=0.1)
    assert r == pytest.approx(np.hypot(2, 1 + t))
    assert a == pytest.approx(np.arctan2(1 + t, 2))
    assert k == pytest.approx(1 + np.searchsorted([0.25, 0.5, 0.75, 2], t))


def test_second_derivatives_and_derivatives_of_expressions(tiny) -> None:
    m = tiny("""model M
  Real x(start = 1, fixed = true), v; output Real p = der(x*v);
initial equation
  v = 0;
equation
  v = der(x);
  der(der(x)) = -4*x;
end M;
""").start()
    t, x, p = m.run(1.0, "x", "p", step=0.1)
    assert x == pytest.approx(np.cos(2 * t), abs=1e-6)
    assert p == pytest.approx(-4 * np.cos(4 * t), abs=1e-5)
