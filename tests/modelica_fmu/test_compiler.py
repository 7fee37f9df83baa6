"""Modelica → C: what the compiler takes gives the right numbers, what it does not take is refused
in one line with file and line.

The models are tiny; they are compiled with the simulation core to a shared library and driven
through core.h. Whole FMUs are tested in test_validation.py and test_solver.py.
"""

from __future__ import annotations

import math
import re

import fmpy
import numpy as np
import pytest

from modelica_fmu.compiler import compile_model
from modelica_fmu.errors import InputError
from pyfmi_runner.build import build_fmu

# ---- functions, arrays, enumerations
# ------------------------------------------------------------------------------------------


def test_functions_with_loops_ifs_and_arrays(tiny):
    m = tiny("""
function poly "Horner; negative arguments count twice"
  input Real c[:];
  input Real u;
  output Real y;
protected
  Real w[2];
algorithm
  w[1] := if u < 0 then 2*u else u;
  w[2] := 0;
  for i in size(c, 1):-1:1 loop
    w[2] := c[i] + w[1]*w[2];
  end for;
  if u > 1 then
    y := w[2] + 100;
  elseif u > 0.5 then
    y := w[2] + 10;
  else
    y := w[2];
  end if;
end poly;
function twice
  input Real u[3];
  input Real k = 2;
  output Real y[3];
algorithm
  for i in 1:3 loop
    y[i] := k*u[i];
  end for;
end twice;
model M
  parameter Real c[4] = {1, -2, 0.5, 0.25};
  input Real u;
  output Real y;
  output Real z;
protected
  Real v[3];
equation
  y = poly(c, u);
  v = twice({u, 2*u, 3*u});
  z = v[1] + 10*v[2] + 100*v[3] + sum(twice({1, 2, 3}, u));
end M;
""")
    m.start()
    for u in (-1.5, 0.2, 0.7, 2.0):
        m.set(u=u)
        w = 2 * u if u < 0 else u
        expected = np.polyval([0.25, 0.5, -2, 1], w) + (100 if u > 1 else 10 if u > 0.5 else 0)
        assert m.get("y") == pytest.approx(expected, rel=1e-14)
        assert m.get("z") == pytest.approx(2 * (u + 20 * u + 300 * u) + 6 * u, rel=1e-14)


def test_arrays_follow_modelica_and_not_elementwise_products(tiny):
    m = tiny("""
model M
  parameter Real A[2, 3] = {{1, 2, 3}, {4, 5, 6}};
  parameter Real b[3] = {1, 10, 100};
  input Real u;
  Real x[3](start = {1, 2, 3}, each fixed = true);
  output Real dot = b*x;
  Real Ab[2] = A*b;
  Real AB[2, 2] = A*{{1, 2}, {3, 4}, {5, 6}};
  Real elementwise[3] = b.*x + x.^2 - x./b;
  Real scaled[2, 3] = u*A - A/2;
  output Real extremes;
equation
  extremes = max(x) - min(b) + sum(A[2, j] for j in 1:3);
  for i in 1:2 loop
    der(x[i]) = x[i + 1];
  end for;
  der(x[3]) = 0;
end M;
""")
    m.set(u=3).start().run(1.0)
    x = np.array([1 + 2 + 1.5, 2 + 3, 3])
    A, b = np.array([[1, 2, 3], [4, 5, 6]]), np.array([1, 10, 100])
    assert [m.get(f"x[{i}]") for i in (1, 2, 3)] == pytest.approx(x, rel=1e-12)
    assert m.get("dot") == pytest.approx(b @ x, rel=1e-12)
    assert [m.get(f"Ab[{i}]") for i in (1, 2)] == list(A @ b)
    assert [m.get(f"AB[{i},{j}]") for i in (1, 2) for j in (1, 2)] == list(
        (A @ [[1, 2], [3, 4], [5, 6]]).flat
    )
    assert [m.get(f"elementwise[{i}]") for i in (1, 2, 3)] == pytest.approx(
        b * x + x**2 - x / b, rel=1e-12
    )
    assert [m.get(f"scaled[{i},{j}]") for i in (1, 2) for j in (1, 2, 3)] == list(
        (3 * A - A / 2).flat
    )
    assert m.get("extremes") == pytest.approx(x.max() - 1 + 15, rel=1e-12)


def test_enumerations_choose(tiny):
    m = tiny("""
type Law = enumeration(none, linear "proportional", square);
model M
  parameter Law law = Law.linear;
  input Real u;
  output Real y;
equation
  y = if law == Law.linear then u elseif law == Law.square then u^2 else 0;
end M;
""")
    values = [m.twin().set(law=law, u=3.0).start().get("y") for law in (1, 2, 3)]
    assert values == [0, 3, 9]


def test_elementary_functions_and_rounding_within_noevent(tiny):
    m = tiny(
        """
model M
  input Real u;
  input Real w;
  parameter Real d = -0.7;
  Real y[20];
equation
  y[1] = min(u, w);
  y[2] = max(u, w);
  y[3] = abs(u);
  y[4] = sign(u);
  y[5] = atan2(u, w);
  y[6] = noEvent(mod(u, d));
  y[7] = noEvent(rem(u, d));
  y[8] = noEvent(div(u, d));
  y[9] = noEvent(floor(u));
  y[10] = noEvent(ceil(u));
  y[11] = noEvent(integer(u));
  y[12] = exp(u/10) + log(abs(w)) + log10(abs(w)) + sqrt(abs(u));
  y[13] = sin(u) + cos(u) + tan(u) + asin(u/10) + acos(u/10) + atan(u);
  y[14] = sinh(u) + cosh(u) + tanh(u);
  y[15] = u^3 - u^2 + 2^w + abs(u)^0.5;
  y[16] = smooth(0, noEvent(if u > 0 and not w > 0 or u < -2 then 1 else 2));
  y[17] = min({u, w, 0}) + max({u, w, 1});
  y[18] = -u/w*2 - 3/u/w;
  y[19] = if u > w then (if u > 0 then 1 else 2) else 3;
  y[20] = if u <> w then 1e-3 else 1E3;
end M;
""".replace("u <> w", "noEvent(u >= w)")
    )
    m.start()
    for u, w in ((2.5, 0.7), (-2.5, 0.7), (2.5, -0.7), (-2.5, -0.7), (-1.2, 3.0)):
        m.set(u=u, w=w)
        expected = [
            min(u, w),
            max(u, w),
            abs(u),
            np.sign(u),
            math.atan2(u, w),
            u + math.floor(-u / 0.7) * 0.7,
            math.fmod(u, -0.7),
            math.trunc(-u / 0.7),
            math.floor(u),
            math.ceil(u),
            math.floor(u),
            math.exp(u / 10) + math.log(abs(w)) + math.log10(abs(w)) + math.sqrt(abs(u)),
            math.sin(u)
            + math.cos(u)
            + math.tan(u)
            + math.asin(u / 10)
            + math.acos(u / 10)
            + math.atan(u),
            math.sinh(u) + math.cosh(u) + math.tanh(u),
            u**3 - u**2 + 2**w + abs(u) ** 0.5,
            1 if (u > 0 and not w > 0) or u < -2 else 2,
            min(u, w, 0) + max(u, w, 1),
            -u / w * 2 - 3 / u / w,
            (1 if u > 0 else 2) if u > w else 3,
            1e-3 if u >= w else 1e3,
        ]
        m.step(1e-3)  # relations follow inputs at the next step
        assert [m.get(f"y[{i}]") for i in range(1, 21)] == pytest.approx(
            expected, rel=1e-12, abs=1e-12
        )


# ---- when, pre, sample, reinit, initial
# ------------------------------------------------------------------------------------------


def test_sample_pre_and_elsewhen(tiny):
    m = tiny("""
model M
  parameter Real period = 0.1;
  discrete Integer n(start = 0, fixed = true);
  discrete Real held(start = -1, fixed = true), before(start = -1, fixed = true);
  discrete Integer which(start = 0, fixed = true);
equation
  when sample(0.05, period) then
    n = pre(n) + 1;
    before = pre(held);
    held = time;
  end when;
  when time > 0.5 then
    which = pre(which) + 1;
  elsewhen time > 0.25 then
    which = pre(which) + 10;
  elsewhen n >= 5 then
    which = pre(which) + 100;
  end when;
end M;
""")
    time, n, held, before, which = m.start().run(1.0, "n", "held", "before", "which", step=0.004)
    ticks = np.floor((time - 0.05) / 0.1 + 1e-9) + 1
    assert n == pytest.approx(ticks)
    late = time > 0.151
    assert held[late] == pytest.approx(0.05 + 0.1 * (ticks - 1)[late], abs=1e-12)
    assert before[late] == pytest.approx(held[late] - 0.1, abs=1e-12)
    # n >= 5 becomes true at 0.45, after 0.25 and before 0.5
    assert list(which[np.searchsorted(time, [0.2, 0.3, 0.47, 0.6])]) == [0, 10, 110, 111]


def test_assignments_within_a_when_clause_are_sorted_and_pre_is_the_value_before(tiny):
    m = tiny("""
model M
  discrete Integer a(start = 1, fixed = true), b(start = 1, fixed = true);
  discrete Integer c(start = 0, fixed = true);
equation
  when sample(0.1, 0.1) then
    c = a + b;
    a = pre(b);
    b = pre(a) + pre(b);
  end when;
end M;
""")
    _, a, b, c = m.start().run(0.85, "a", "b", "c", step=0.05)
    assert (a[-1], b[-1], c[-1]) == (34, 55, 89)


def test_a_when_clause_with_several_conditions_fires_at_each(tiny):
    m = tiny("""
model M
  discrete Integer n(start = 0, fixed = true);
equation
  when {time > 0.2, time > 0.4, initial()} then
    n = pre(n) + 1;
  end when;
end M;
""")
    _, n = m.start().run(0.6, "n", step=0.1)
    assert list(n) == [1, 1, 2, 2, 3, 3]


def test_reinit_bounces_at_the_times_of_the_closed_form(tiny):
    m = tiny("""
model M
  parameter Real e = 0.8;
  Real h(start = 1, fixed = true), v(start = 0, fixed = true);
  discrete Real t_last(start = 0, fixed = true);
  discrete Integer n(start = 0, fixed = true);
equation
  der(h) = v;
  der(v) = -9.81;
  when h <= 0 then
    reinit(v, -e*pre(v));
    t_last = time;
    n = pre(n) + 1;
  end when;
end M;
""")
    _, n, t_last, _h = m.start().run(2.5, "n", "t_last", "h", step=0.02)
    fall = math.sqrt(2 / 9.81)
    for bounce in (1, 2, 3, 4, 5):
        expected = fall * (1 + 2 * sum(0.8**k for k in range(1, bounce)))
        assert t_last[n == bounce] == pytest.approx(expected, abs=1e-9)


def test_initial_is_true_at_the_start_only(tiny):
    m = tiny("""
model M
  parameter Real p = 3;
  discrete Real y(start = 0, fixed = true);
  discrete Integer fired(start = 0, fixed = true), late(start = 0, fixed = true);
  Real x(start = 1, fixed = true);
equation
  der(x) = 0;
  when initial() then
    y = 2*p;
    fired = pre(fired) + 1;
  end when;
  when x > 0 then
    late = pre(late) + 1;
  end when;
end M;
""")
    m.set(p=5).start().run(0.1)
    assert (m.get("y"), m.get("fired")) == (10, 1)
    assert m.get("late") == 0  # true from the start: it never rises


def test_edge_and_change(tiny):
    m = tiny("""
model M
  Boolean b;
  Integer i;
  discrete Integer rises(start = 0, fixed = true), changes(start = 0, fixed = true);
  discrete Integer steps(start = 0, fixed = true);
equation
  b = sin(6.283185307179586*time) > 0;
  i = if time > 0.7 then 3 elseif time > 0.3 then 2 else 1;
  when edge(b) then
    rises = pre(rises) + 1;
  end when;
  when change(b) then
    changes = pre(changes) + 1;
  end when;
  when change(i) then
    steps = pre(steps) + 1;
  end when;
end M;
""")
    m.start().run(2.25)
    assert (m.get("rises"), m.get("changes"), m.get("steps")) == (3, 5, 2)


def test_hysteresis_through_pre_of_an_algebraic_boolean(tiny):
    m = tiny("""
model M
  Real T(start = 0.5, fixed = true);
  Boolean heat(start = true, fixed = true);
equation
  der(T) = if heat then 1 else -2;
  heat = T < 0.4 or pre(heat) and not T > 1;
end M;
""")
    time, T = m.start().run(3.0, "T", step=0.013)
    phase = np.mod(time - 0.5, 0.9)  # falls 0.3 s, rises 0.6 s
    expected = np.where(
        time < 0.5, 0.5 + time, np.where(phase < 0.3, 1 - 2 * phase, 0.4 + phase - 0.3)
    )
    assert pytest.approx(expected, abs=1e-8) == T
    assert T.max() <= 1 + 1e-8
    assert T.min() >= 0.4 - 1e-8


def test_boolean_inputs_start_and_stop_at_the_step_they_are_set(tiny):
    m = tiny("""
model M
  input Boolean go;
  input Integer k;
  Real x(start = 0, fixed = true);
  discrete Integer n(start = 0, fixed = true);
equation
  der(x) = if go then k else 0;
  when go then
    n = pre(n) + 1;
  end when;
end M;
""")
    m.set(k=2).start().run(0.1)
    m.set(go=1).run(0.2)
    m.set(go=0).run(0.3)
    m.set(go=1, k=-1).run(0.4)
    assert m.get("x") == pytest.approx(0.1, abs=1e-12)
    assert m.get("n") == 2


# ---- events and their times
# ------------------------------------------------------------------------------------------


def test_relations_are_located_and_noevent_is_not(tiny):
    m = tiny("""
model M
  Real x(start = 0, fixed = true), y(start = 0, fixed = true);
equation
  der(x) = if time > 0.12345 then 1 else 0;
  der(y) = noEvent(if time > 0.12345 then 1 else 0);
end M;
""")
    m.set(**{"solver.max_step": 0.01}).start().run(0.2)
    assert m.get("x") == pytest.approx(0.2 - 0.12345, abs=1e-9)
    error = abs(m.get("y") - (0.2 - 0.12345))
    assert 1e-6 < error < 0.01


def test_an_event_at_a_communication_point_and_at_the_start_time(tiny):
    m = tiny("""
model M
  Real x(start = 0, fixed = true);
  discrete Integer n(start = 0, fixed = true), ticks(start = 0, fixed = true);
equation
  der(x) = if time >= 2.5 then 1 else 0;
  when time >= 2.5 then
    n = pre(n) + 1;
  end when;
  when sample(1, 0.5) then
    ticks = pre(ticks) + 1;
  end when;
end M;
""")
    m.start(2.0).run(3.0, step=0.1)
    assert m.get("x") == pytest.approx(0.5, abs=1e-9)
    assert m.get("n") == 1
    assert (
        m.get("ticks") == 2
    )  # at 2.0 and 2.5; that at 3.0 belongs to the next step, which may bring new inputs
    m.step(0.1)
    assert m.get("ticks") == 3


# ---- delay
# ------------------------------------------------------------------------------------------


def test_delay_of_a_ramp_of_a_constant_and_of_jumps(tiny):
    m = tiny("""
model M
  parameter Real T = 0.0123;
  input Real u;
  output Real ramp, still, jump;
  Real integral(start = 0, fixed = true), late(start = 0, fixed = true);
  Boolean high;
  discrete Real t_high(start = 0, fixed = true);
equation
  ramp = delay(2*time, T, 0.2);
  still = delay(7, 0.05);
  jump = delay(u, T, 0.2);
  der(integral) = jump;
  der(late) = if high then 1 else 0;
  high = delay(time, T, 0.2) > 0.1;
  when high then
    t_high = time;
  end when;
end M;
""")
    m.start().run(0.1)
    m.set(u=1).run(0.15)
    m.set(u=3).run(0.2)
    m.set(u=0).run(0.3)
    assert m.get("ramp") == pytest.approx(2 * (0.3 - 0.0123), abs=1e-12)
    assert m.get("still") == 7
    assert m.get("jump") == 0
    assert m.get("integral") == pytest.approx(0.05 * (1 + 3), abs=1e-9)
    assert m.get("t_high") == pytest.approx(0.1123, abs=1e-9)
    assert m.get("late") == pytest.approx(0.3 - 0.1123, abs=1e-9)


def test_what_jumps_at_an_event_is_delayed_as_a_jump(tiny):
    m = tiny("""
model M
  discrete Real n(start = 0, fixed = true);
  Boolean high = time > 0.1234;
  Real a(start = 0, fixed = true), b(start = 0, fixed = true);
equation
  when sample(0.0555, 1) then
    n = 1;
  end when;
  der(a) = delay(n, 0.033);
  der(b) = delay(if high then 1 else 0, 0.033);
end M;
""")
    m.set(**{"solver.max_step": 0.01}).start().run(0.3, step=0.02)
    assert m.get("a") == pytest.approx(0.3 - 0.0885, abs=1e-9)
    assert m.get("b") == pytest.approx(0.3 - 0.1564, abs=1e-9)


SWITCHED = """model M
  parameter Real T(min = 0, max = 0.2) = 0;
  input Real u(start = 0);
  Real x(start = 0, fixed = true);
  output Real y;
equation
  y = noEvent(if T > 0 then delay(u, if T > 0 then T else 1e-3, 0.2) else u);
  der(x) = y;
end M;
"""


def test_a_delay_switched_off_costs_no_event_and_one_switched_on_late_knows_its_history(tiny):
    m = tiny(SWITCHED).start()
    for k in range(100):
        assert m.set(u=float(k % 7)).step(1e-3) == 0
        assert m.get("y") == float(k % 7)
    m.set(T=0.03)
    got = []
    for k in range(100, 160):
        assert m.set(u=float(k % 7)).step(1e-3) == 0
        got.append(m.get("y"))
    assert got == [
        float((k - 29) % 7) for k in range(100, 160)
    ]  # read at the end of step k, at the instant of a jump
    m.set(T=0.0, u=-1.0).step(1e-3)
    assert m.get("y") == -1.0


def test_a_delay_that_nothing_reads_is_left_out_by_the_parameters_alone(tmp_path):
    (tmp_path / "m.mo").write_text(SWITCHED.replace("der(x) = y", "der(x) = y + delay(x, 0.05)"))
    source = compile_model(tmp_path / "m.mo", "M").sources["model.c"]
    used = dict(re.findall(r"used\[(\d)\] = (.*);", source.partition("void model_delays_used")[2]))
    assert sorted(used.values()) == ["(1)", "(q->h[0])"]


def test_two_jumps_within_one_delay_arrive_one_after_the_other(tiny):
    m = tiny("""
model M
  input Real u;
  output Real y = delay(u, 0.0105, 0.1);
end M;
""")
    m.start()
    sent, got = [], []
    for k in range(40):
        m.set(u=k % 7)
        m.step(1e-3)
        sent.append(k % 7)
        got.append(m.get("y"))
    assert got[11:] == sent[1:-10]  # at (k + 1) ms the value set at k + 1 - 10.5, rounded down, ms


# ---- algebra and parameters
# ------------------------------------------------------------------------------------------


def test_linear_loops_of_two_and_three_are_solved(tiny):
    m = tiny("""
model M
  input Real u;
  parameter Real a = 3;
  Real x, y, p, q, r;
  Real v(start = 0, fixed = true), w(start = 0, fixed = true);
equation
  x + a*y = u;
  a*x - y = 1;
  p + q = u + x;
  q + r = 2;
  a*p - r = y;
  2*der(v) + der(w) = 1;
  der(v) - der(w) = 0.5;
end M;
""")
    m.set(u=4, a=2).start().run(1.0)
    x, y = np.linalg.solve([[1, 2], [2, -1]], [4, 1])
    p, q, r = np.linalg.solve([[1, 1, 0], [0, 1, 1], [2, 0, -1]], [4 + x, 2, y])
    assert [m.get(n) for n in "xypqr"] == pytest.approx([x, y, p, q, r], rel=1e-12)
    assert [m.get("v"), m.get("w")] == pytest.approx([0.5, 0.0], abs=1e-12)


def test_calculated_parameters_follow_even_while_running(tiny):
    m = tiny("""
model M
  parameter Real b = 2*a + c;
  parameter Real a = 1.5;
  constant Real c = 10*k;
  constant Real k = 0.1;
  final parameter Real d = b^2;
  Real x(start = 0, fixed = true);
  output Real y = b*time;
equation
  der(x) = if b > 5 then d else -d;
end M;
""")
    m.start().run(0.5)
    assert [m.get("b"), m.get("d"), m.get("x")] == pytest.approx([4, 16, -8])
    m.set(a=3).run(1.0)
    assert [m.get("b"), m.get("d"), m.get("x")] == pytest.approx([7, 49, -8 + 24.5])
    assert m.get("y") == pytest.approx(7.0)


def test_what_a_protected_component_is_given_is_not_told(tmp_path):
    path = tmp_path / "M.mo"
    path.write_text("""
package P
  block Gain
    parameter Real k = 1;
    input Real u;
    output Real y;
  equation
    y = k*u;
  end Gain;
  model M
    parameter Real a = 2;
    parameter Real b = 3*a;
    output Real y;
  protected
    Gain hidden(k = b, u = time);
  equation
    y = hidden.y;
  end M;
end P;
""")
    told = {v.name: v.causality for v in compile_model(path, "P.M").variables}
    assert not [n for n in told if n.startswith("hidden")]
    assert (told["a"], told["b"], told["y"]) == ("parameter", "calculatedParameter", "output")


def test_start_values_follow_parameters(tiny):
    m = tiny("""
model M
  parameter Real a = 1;
  parameter Real s = 2*a;
  Real x(start = s + 1, fixed = true);
equation
  der(x) = -x;
end M;
""")
    m.set(a=4).start().run(0.5)
    assert m.get("x") == pytest.approx(9 * math.exp(-0.5), rel=1e-9)


def test_components_modifiers_and_inheritance(tiny):
    m = tiny("""
package P
  partial block Base
    parameter Real k = 1;
    input Real u;
    output Real y;
  end Base;
  block Gain
    extends Base;
  equation
    y = k*u;
  end Gain;
end P;
model M
  P.Gain g[2](k = {2, 3});
  P.Gain h(k = 10);
  parameter Boolean extra = true;
  Real z;
equation
  g[1].u = time;
  g[2].u = g[1].y;
  h.u = g[2].y;
  if extra then
    z = h.y;
  else
    z = 0;
  end if;
end M;
""")
    m.start().run(0.5)
    assert m.get("z") == pytest.approx(30.0)


def test_assertions_warn_or_stop_the_run_with_their_message(tiny):
    m = tiny("""
model M
  parameter Real limit = 0.5;
  Real x(start = 0, fixed = true);
equation
  der(x) = 1;
  assert(x < limit, "x has passed its limit");
  assert(x < 0.2, "x grows", AssertionLevel.warning);
end M;
""")
    m.start().run(0.4)
    assert any("x grows" in text for _, text in m.messages)
    assert m.step(0.2) == 3  # CORE_ERROR
    assert any("x has passed its limit at t = 0.6 s" in text for _, text in m.messages)


def test_two_instances_are_independent(tiny):
    one = tiny("""
model M
  parameter Real k = 1;
  Real x(start = 0, fixed = true);
  discrete Integer n(start = 0, fixed = true);
  output Real y = delay(x, 0.05);
equation
  der(x) = k;
  when sample(0, 0.1) then
    n = pre(n) + 1;
  end when;
end M;
""")
    two = one.twin().set(k=-3)
    one.start()
    two.start(1.0)
    for _ in range(30):
        one.step(0.01)
        two.step(0.02)
    assert [one.get("x"), one.get("n"), one.get("y")] == pytest.approx([0.3, 3, 0.25])
    assert [two.get("x"), two.get("n"), two.get("y")] == pytest.approx([-1.8, 6, -1.65])


# ---- refusals
# ------------------------------------------------------------------------------------------

FUNCTION = (
    "function f\n  input Real u;\n  output Real y;\nalgorithm\n{body}end f;\nmodel M\n  "
    "Real x;\nequation\n  x = f(time);\nend M;\n"
)
REFUSED = {  # name: (text, line, a piece of the message)
    "while": (
        FUNCTION.format(body="  y := u;\n  while y < 10 loop\n    y := y + 1;\n  end while;\n"),
        (1, 6),
        "statement",
    ),
    "recursion": (
        FUNCTION.format(body="  y := if u > 1 then u*f(u - 1) else 1;\n"),
        (5, 9),
        "calls itself",
    ),
    "long loop": (
        FUNCTION.format(body="  y := 0;\n  for i in 1:20000 loop\n    y := y + u;\n  end for;\n"),
        (6, 7),
        "loops more than 10000 times",
    ),
    "moving loop range": (
        FUNCTION.format(
            body="  y := 0;\n  for i in 1:integer(u) loop\n    y := y + i;\n  end for;\n"
        ),
        (1, 6),
        "loop",
    ),
    "external function": (
        'function f\n  input Real u;\n  output Real y;\nexternal "C" y = f(u);\nend '
        "f;\nmodel M\n  Real x;\nequation\n  x = f(time);\nend M;\n",
        9,
        "the function f",
    ),
    "too few equations": (
        "model N\nend N;\nmodel M\n  Real x, y;\nequation\n  x = time;\nend M;\n",
        3,
        "1 equations, 2 unknowns",
    ),
    "too many equations": (
        "model M\n  Real x;\nequation\n  x = time;\n  x = 2*time;\nend M;\n",
        1,
        "2 equations, 1 unknowns",
    ),
    "structurally singular": (
        "model M\n  Real x, y;\nequation\n  x = time;\n  x = 2*time;\nend M;\n",
        (4, 5),
        "none is left for y",
    ),
    "syntax error": ("model M\n  Real x;\nequation\n  x = ;\nend M;\n", 4, "unexpected `;`"),
    "syntax error at the end": (
        "model M\n  Real x;\nequation\n  x = 1;\n",
        5,
        "unexpected end of input",
    ),
    "unknown type": (
        "model M\n  Real z;\n  Rel x;\nequation\n  x = 1;\n  z = 1;\nend M;\n",
        3,
        "unresolved type reference: 'Rel'",
    ),
    "unknown variable": (
        "model N\n  Real y = 1;\nend N;\nmodel M\n  Real x; // y\nequation\n  x = 2\n    "
        "+ y;\nend M;\n",
        8,
        "'y'",
    ),
    "unknown function": (
        "model M\n  Real x;\nequation\n  x = g(time);\nend M;\n",
        4,
        "unresolved function call: 'g'",
    ),
    "unknown base class": ("model M\n  extends Foo;\nend M;\n", 2, "`Foo` does not exist"),
    "unknown class": ("model N\n  Real x;\nequation\n  x = 1;\nend N;\n", None, "no class M"),
    "type mismatch": (
        "model M\n  Real x;\n  Boolean b;\nequation\n  b = time > 1;\n  x = b;\nend M;\n",
        6,
        "type mismatch",
    ),
    "array sizes": (
        "model M\n  Real x[2];\nequation\n  x = {1, 2, 3};\nend M;\n",
        4,
        "dimension mismatch",
    ),
    "subscript out of bounds": (
        "model M\n  Real x[2];\n  Real y;\nequation\n  x[1] = 1;\n  x[2] = 2;\n  y = "
        "x[3];\nend M;\n",
        7,
        "out of bounds",
    ),
    "delay longer than its maximum": (
        "model M\n  Real x;\nequation\n  x = delay(time, 0.5, 0.2);\nend M;\n",
        4,
        "0.5 must not exceed",
    ),
    "parameters in a circle": (
        "model M\n  parameter Real a = b;\n  parameter Real b = a;\n  Real "
        "x;\nequation\n  x = a;\nend M;\n",
        2,
        "cyclic",
    ),
    "parameter from a variable": (
        "model M\n  Real x;\n  parameter Real p = x;\nequation\n  x = time;\nend M;\n",
        3,
        "cannot depend on",
    ),
    "start from a variable": (
        "model M\n  Real y;\n  Real x(start = y, fixed = true);\nequation\n  y = time;\n "
        " der(x) = 1;\nend M;\n",
        3,
        "start value of x",
    ),
    "bound from a variable": (
        "model M\n  Real x;\n  parameter Real p(max = x) = 0;\nequation\n  x = p;\nend M;\n",
        3,
        "a bound of p",
    ),
    "constant without a value": (
        "model M\n  constant Real a;\n  Real x;\nequation\n  x = a;\nend M;\n",
        2,
        "the constant a has no value",
    ),
    "reinit of no state": (
        "model M\n  Real x, y;\nequation\n  der(x) = 1;\n  y = x;\n  when x > 1 then\n   "
        " reinit(y, 0);\n  end when;\nend M;\n",
        7,
        "y is not a state",
    ),
    "sample of a variable": (
        "model M\n  Real x;\n  discrete Real y;\nequation\n  der(x) = 1;\n  when "
        "sample(0, x) then\n    y = x;\n  end when;\nend M;\n",
        6,
        "sample",
    ),
    "pre of a continuous variable": (
        "model M\n  Real x;\n  discrete Real y;\nequation\n  x = time;\n  when x > 1 "
        "then\n    y = pre(x);\n  end when;\nend M;\n",
        7,
        "pre(x)",
    ),
    "two when clauses for one variable": (
        "model M\n  discrete Real x;\nequation\n  when time > 1 then\n    x = 1;\n  end "
        "when;\n  when time > 2 then\n    x = 2;\n  end when;\nend M;\n",
        8,
        "two when-clauses",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_in_one_line_with_file_and_line(case, tmp_path):
    text, line, piece = REFUSED[case]
    file = tmp_path / "bad.mo"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        compile_model(file, "M")
    message = str(caught.value)
    assert "\n" not in message
    assert piece in message
    assert message.count(str(file)) == 1
    lines = line if isinstance(line, tuple) else (line,)
    assert any(message.startswith(f"{file}:{n}: " if n else f"{file}: ") for n in lines), message
    assert "; " in message, "a remedy"
    assert len(message) < len(str(file)) + 320


def test_a_missing_file_and_one_that_is_no_text(tmp_path):
    with pytest.raises(InputError, match=r"none\.mo: no such Modelica file; "):
        compile_model(tmp_path / "none.mo", "M")
    (tmp_path / "bytes.mo").write_bytes(b"\xff\xfe\x00model")
    with pytest.raises(InputError, match=r"bytes\.mo: cannot be read as UTF-8"):
        compile_model(tmp_path / "bytes.mo", "M")


# ---- model exchange of what the gantry's validation does not use
# -------------------------------------------------------------------


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_model_exchange_takes_samples_reinit_and_delays_as_co_simulation_does(fmi, tmp_path):
    file = tmp_path / "m.mo"
    file.write_text("""
model M
  output Real h(start = 1, fixed = true), v(start = 0, fixed = true);
  discrete Integer n(start = 0, fixed = true);
  output Real count = n;
  output Real late;
  output Real integral(start = 0, fixed = true);
equation
  der(h) = v;
  der(v) = -9.81;
  late = delay(count, 0.033);
  der(integral) = late;
  when h <= 0 then
    reinit(v, -0.8*pre(v));
  end when;
  when sample(0.05, 0.1) then
    n = pre(n) + 1;
  end when;
end M;
""")
    path = build_fmu("M", file, fmi, tmp_path).path
    names = ["h", "v", "count", "late", "integral"]
    common = {"stop_time": 1.2, "output_interval": 0.01, "output": names, "record_events": False}
    cs = fmpy.simulate_fmu(str(path), fmi_type="CoSimulation", **common)
    me = fmpy.simulate_fmu(str(path), fmi_type="ModelExchange", relative_tolerance=1e-9, **common)
    for name in names:
        # at a communication point that is a tick, co-simulation takes the tick at the start of the
        # next step
        quiet = np.abs(np.mod(cs["time"] - 0.05 + 1e-6, 0.1) - 1e-6) > 1e-3
        assert me[name][quiet] == pytest.approx(cs[name][quiet], abs=1e-6), name
    assert cs["integral"][-1] == pytest.approx(
        sum(1.2 - (0.083 + 0.1 * k) for k in range(12)), abs=1e-6
    )
