"""Silent miscompiles that an audit found, one test each."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from tiny import library_of

from modelica_fmu.compiler import compile_model
from modelica_fmu.errors import InputError
from modelica_fmu.units import rate_unit


def test_relations_that_differ_in_the_seventh_digit_are_two_events(tmp_path: Path) -> None:
    model = library_of(
        """model M
  output Boolean early = time > 100000.1;
  output Boolean late = time > 100000.4;
  Real x(start = 0, fixed = true);
equation
  der(x) = if late then 1 else 0;
end M;
""",
        tmp_path,
    ).start(100_000.0)
    t, early, late, x = model.run(100_000.98, "early", "late", "x", step=0.07)
    assert (early == (t > 100_000.1)).all()
    assert (late == (t > 100_000.4)).all()
    assert x[-1] == pytest.approx(0.58, abs=1e-8)


def test_a_nominal_that_is_computed_is_the_same_in_solver_and_description(tmp_path: Path) -> None:
    file = tmp_path / "m.mo"
    file.write_text(
        "model M\n  Real x(start = 1, fixed = true, nominal = 2*1000);\nequation\n"
        "  der(x) = -x;\nend M;\n"
    )
    compiled = compile_model(file, "M")
    assert [v.nominal for v in compiled.variables if v.name == "x"] == [2000.0]
    assert "model_nominals[] = {2000.0}" in compiled.sources["model.c"]


PIVOT = "model M\n  parameter Real k = 1;\n  output Real x;\nequation\n  k*x = time;\nend M;\n"


def test_an_equation_whose_factor_is_zero_stops_the_run(tmp_path: Path) -> None:
    good = library_of(PIVOT, tmp_path).start()
    assert good.step(0.5) == 0
    assert good.get("x") == pytest.approx(0.5)
    bad = good.twin().set(k=0)
    assert bad.library.core_initialise(bad.core, 0.0) == 3
    assert any("line 5 cannot be solved for x: its factor is 0" in m for _, m in bad.messages)


def test_equations_that_are_singular_whatever_the_parameters_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "m.mo"
    file.write_text("model M\n  Real x, y;\nequation\n  x + y = time;\n  2*x + 2*y = 1;\nend M;\n")
    with pytest.raises(InputError, match=r"m\.mo:[45]: .*singular"):
        compile_model(file, "M")


def test_the_solver_is_told_where_its_settings_are(tmp_path: Path) -> None:
    file = tmp_path / "m.mo"
    file.write_text(PIVOT)
    compiled = compile_model(file, "M")
    places = {v.name: v.index for v in compiled.variables if v.kind == "parameter"}
    told = dict(re.findall(r"#define (P_\w+) (\d+)", compiled.sources["model.h"]))
    assert int(told["P_MAX_STEP"]) == places["solver.max_step"]
    assert int(told["P_TOLERANCE"]) == places["solver.tolerance"]


@pytest.mark.parametrize(
    ("unit", "rate"),
    [
        ("m", "m/s"),
        ("m/s", "m/s2"),
        ("N", "N/s"),
        ("N/s", "N/s2"),
        ("1", "1/s"),
        ("N/(m.s)", "N/(m.s2)"),
        ("N.s/m", "N.s/(m.s)"),
        ("K", "K/s"),
        ("mol/m3", "mol/(m3.s)"),
        ("furlong", None),
        (None, None),
    ],
)
def test_the_unit_of_a_rate_follows_from_the_unit(unit: str | None, rate: str | None) -> None:
    assert rate_unit(unit) == rate


def test_a_step_that_no_internal_step_can_end_is_refused(tmp_path: Path) -> None:
    """With a sampled clock it would tick for ever."""
    model = library_of(
        "model M\n  discrete Real n(start = 0, fixed = true);\nequation\n"
        "  when sample(0, 1e-3) then\n    n = pre(n) + 1;\n  end when;\nend M;\n",
        tmp_path,
    ).start()
    assert model.step(1e300) == 3
    assert any("its end is no number" in m for _, m in model.messages)


@pytest.mark.parametrize(
    "action",
    [
        "reinit(x, {0, 0, 0})",
        "reinit(x, 0)",
        "reinit(x[1], {0, 0})",
        "y = {time, time, time}",
        "y = time",
        "k = {1, 2}",
    ],
)
def test_sizes_that_differ_in_a_when_clause_are_refused_with_their_line(
    action: str, tmp_path: Path
) -> None:
    file = tmp_path / "m.mo"
    file.write_text(
        "model M\n  Real x[2](each start = 1, each fixed = true);\n  discrete Real y[2];\n"
        f"  discrete Real k;\nequation\n  der(x) = -x;\n  when time > 1 then\n    {action};\n"
        "  end when;\nend M;\n"
    )
    with pytest.raises(InputError, match=r"m\.mo:8: .*dimension mismatch"):
        compile_model(file, "M")


def test_arrays_of_one_size_are_reinitialised_and_assigned_together(tmp_path: Path) -> None:
    model = library_of(
        "model M\n  Real x[2](each start = 1, each fixed = true);\n  discrete Real y[2];\n"
        "equation\n  der(x) = {0, 1};\n  when time > 1 then\n    reinit(x, {5, 7});\n"
        "    y = {time, 2*time};\n  end when;\nend M;\n",
        tmp_path,
    ).start()
    _, first, second, y = model.run(2.0, "x[1]", "x[2]", "y[2]")
    assert (first[-1], second[-1], y[-1]) == pytest.approx((5.0, 8.0, 2.0), abs=1e-6)


def test_a_chattering_mode_slides_along_its_surface(tmp_path: Path) -> None:
    """Modes that stayed frozen to the end of a step carried x 0.02 away from Filippov's solution:
    x falls with 20/s to 0, where x' = 5 and x' = -20 hold it.
    """
    model = library_of(
        "model M\n  Real x(start = 1, fixed = true);\nequation\n"
        "  der(x) = if x < 0 then 5 else -20;\nend M;\n",
        tmp_path,
    ).start()
    t, x = model.run(0.2, "x")
    assert x == pytest.approx([max(1 - 20 * now, 0) for now in t], abs=20 * 1e-2 / 200)
    assert [text for _, text in model.messages if "each mode now holds for 5e-05 s" in text]


def test_a_when_clause_sees_what_another_one_gives_at_the_same_event(tmp_path: Path) -> None:
    """change(k) was never true of a k that a when-clause counts: it was compared a round late."""
    model = library_of(
        """model M
  Integer k(start = 0, fixed = true);
  discrete Real seen, twice, last;
equation
  when sample(0.1, 0.1) then
    k = pre(k) + 1;
  end when;
  when change(k) then
    seen = time;
  end when;
  when sample(0.1, 0.1) then
    twice = 2*k;
  end when;
  when mod(k - 1, 2) == 0 and edge(odd) then
    last = time;
  end when;
public
  Boolean odd = mod(k, 2) == 1;
end M;
""",
        tmp_path,
    ).start()
    t, k, seen, twice, last = model.run(1.05, "k", "seen", "twice", "last", step=0.05)
    assert list(k) == [int((now - 1e-6) / 0.1) for now in t]
    assert seen == pytest.approx(0.1 * k)
    assert list(twice) == list(2 * k)
    assert last == pytest.approx([0.1 * (n - (n % 2 == 0)) if n else 0 for n in k])


def test_bounds_that_follow_from_parameters(tmp_path: Path) -> None:
    """nominal: at the parameters' own values; min and max, which would move with them: none."""
    file = tmp_path / "m.mo"
    file.write_text(
        "model M\n  parameter Real a = 2;\n  parameter Real b = 3*a;\n"
        "  Real x(start = 1, fixed = true, nominal = if b > 5 then b else 1, min = -b, max = 7);\n"
        "equation\n  der(x) = -x;\nend M;\n"
    )
    compiled = compile_model(file, "M")
    x = next(v for v in compiled.variables if v.name == "x")
    assert (x.nominal, x.min, x.max) == (6.0, None, 7.0)


def test_a_bound_that_follows_a_variable_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "m.mo"
    file.write_text(
        "model M\n  Real y = time;\n  Real x(start = 1, fixed = true, max = y);\n"
        "equation\n  der(x) = -x;\nend M;\n"
    )
    with pytest.raises(InputError, match=r"m\.mo:3: .*a bound of x depends on a variable"):
        compile_model(file, "M")


def test_the_experiment_of_a_model_is_the_default_of_its_fmu(tmp_path: Path) -> None:
    file = tmp_path / "m.mo"
    text = "model M\n  Real x = time;\n{}end M;\n"
    for annotation, stop in (("", 1.0), ("  annotation(experiment(StopTime = 7.5));\n", 7.5)):
        file.write_text(text.format(annotation))
        made = compile_model(file, "M")
        assert (made.default_stop, made.tool) == (stop, "modelica_fmu")


STICKING = """model M
  constant Real inertia = 0.05, slides = 80, breaks = 90;
  Real w(start = -10, fixed = true), phi(start = 0, fixed = true), a, sa;
  Integer mode(start = -1, fixed = true);
  Boolean forward, backward, locked;
  output Boolean stuck = locked;
equation
  forward = pre(mode) == 0 and (sa > breaks or pre(forward) and sa > slides);
  backward = pre(mode) == 0 and (sa < -breaks or pre(backward) and sa < -slides);
  locked = not (pre(mode) == 1 or forward or pre(mode) == -1 or backward);
  a = if locked then 0 elseif forward or pre(mode) == 1 then sa - breaks else sa + breaks;
  mode = if (pre(mode) == 1 or forward) and w > 0 then 1
    elseif (pre(mode) == -1 or backward) and w < 0 then -1 else 0;
  der(phi) = w;
  der(w) = a;
  inertia*a = 10 - (if locked then sa elseif forward or pre(mode) == 1 then slides else -slides);
end M;
"""


def test_what_stops_sliding_sticks(tmp_path: Path) -> None:
    """Relations that the last mode left behind decided the next one: it slid back and forth."""
    model = library_of(STICKING, tmp_path).start()
    t, w, phi, stuck = model.run(0.02, "w", "phi", "stuck", step=1e-3)
    rate = (10 + 80) / 0.05  # rad/s2
    stop = 10 / rate
    assert w == pytest.approx(np.minimum(rate * t - 10, 0), abs=1e-6)
    assert phi[-1] == pytest.approx(-0.5 * rate * stop**2, abs=1e-7)
    assert (stuck == (t > stop)).all()
    assert not model.messages


def test_an_event_without_a_solution_stops_the_run(tmp_path: Path) -> None:
    model = library_of(
        "model M\n  output Boolean b(start = false, fixed = true);\nequation\n"
        "  b = time > 1 and not pre(b);\nend M;\n",
        tmp_path,
    ).start()
    assert model.step(0.9) == 0
    assert model.step(0.2) == 3
    assert any("contradict one another" in m for _, m in model.messages)


def test_relations_that_follow_each_other_in_circles_are_tried(tmp_path: Path) -> None:
    """Each of the two, followed from both false or both true, changes the other at once."""
    model = library_of(
        """model M
  Real x, y;
  output Boolean a, b;
equation
  a = x > 1;
  b = y > 1;
  x = if b then 0 else 2*time;
  y = if a then 0 else 2*time;
end M;
""",
        tmp_path,
    ).start()
    t, a, b = model.run(1.0, "a", "b", step=0.04)
    assert ((a + b) == (t > 0.5)).all()


def test_events_of_a_model_that_lives_for_nanoseconds(tmp_path: Path) -> None:
    """Brackets and shortest steps were numbers of seconds: 1e-10 and 1e-9."""
    model = library_of(
        """model M
  Real x(start = 0, fixed = true), y(start = 0, fixed = true);
equation
  der(x) = 1e9*(1 - x);
  der(y) = if x > 0.3 then 1e9 else 0;
end M;
""",
        tmp_path,
    ).start()
    t, x, y = model.run(2e-9, "x", "y", step=1e-10)
    assert x == pytest.approx(1 - np.exp(-1e9 * t), abs=1e-5)
    assert y[-1] == pytest.approx(2 + np.log(0.7), abs=1e-5)


def test_a_record_s_value_counts_more_than_the_declarations_of_its_fields(tmp_path: Path) -> None:
    """Fields with a value of their own kept it, whatever the record was bound to."""
    model = library_of(
        """model M
  record R
    Real a; Real b = 5; Real c = 7;
  end R;
  function f
    input Real x; output R r;
  algorithm
    r.a := x; r.b := 2*x; r.c := 3*x;
  end f;
  parameter R p = R(a = 1, b = 2);
  R q = f(time + 1);
  R copy(c = 11) = p;
  R plain(a = 4);
end M;
""",
        tmp_path,
    ).start()
    names = ("p.a", "p.b", "p.c", "q.b", "copy.b", "copy.c", "plain.b")
    assert [model.get(n) for n in names] == [1, 2, 7, 2, 2, 11, 5]
