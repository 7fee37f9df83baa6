"""Which start is taken where the equations have several, and that the log tells of it."""

import math

import pytest
from tiny import Tiny

WARNING = 1


def warnings(m: Tiny) -> list[str]:
    return [text for status, text in m.messages if status == WARNING]


ROOT = "model M\n  output Real y{}; equation\n  y^2 + y = 6 + time;\nend M;\n"


def test_one_of_several_solutions_of_a_loop_is_told(tiny) -> None:
    """y² + y = 6: 2 and -3, and the model gives no start value."""
    m = tiny(ROOT.format("")).start()
    taken = m.get("y")
    assert taken in (pytest.approx(2.0), pytest.approx(-3.0))
    (said,) = warnings(m)
    other = -1 - taken
    assert f"y = {taken:g} is taken, {other:g} solves the equations, too; give start" in said
    m.start()
    assert len(warnings(m)) == 1  # once is enough


@pytest.mark.parametrize(("start", "solution"), [(1, 2.0), (-5, -3.0)])
def test_a_start_value_chooses_and_nothing_is_told(tiny, start: float, solution: float) -> None:
    m = tiny(ROOT.format(f"(start = {start})")).start()
    assert m.get("y") == pytest.approx(solution)
    assert warnings(m) == []


def test_a_loop_with_one_solution_is_not_doubted(tiny) -> None:
    m = tiny("model M\n  output Real y; equation\n  y^3 + y = 2 + time;\nend M;\n").start()
    assert m.get("y") == pytest.approx(1.0)
    assert warnings(m) == []


RESTING = """model M
  parameter Real k = 1; Real x{}; output Real y = 2*x;
initial equation
  der(x) = 0;
equation
  der(x) = k*x*(1 - x);
end M;
"""


def test_one_of_several_steady_states_is_told(tiny) -> None:
    """der(x) = x(1 - x) rests at 0 and at 1; what has been tried leaves no trace."""
    m = tiny(RESTING.format("")).start()
    assert (m.get("x"), m.get("y")) == (0.0, 0.0)
    assert "x = 0 is taken, 1 solves the equations, too" in warnings(m)[0]
    m.run(1.0, "y", step=0.5)
    assert m.get("y") == 0.0


def test_a_start_value_chooses_the_steady_state(tiny) -> None:
    m = tiny(RESTING.format("(start = 0.9)")).start()
    assert m.get("x") == pytest.approx(1.0)
    assert warnings(m) == []


SCHMITT = """model M "an amplifier of limited output, fed back to its positive input"
  parameter Real v(start = 0) = 0.2; output Real y{start};
equation
  y = {limited};
end M;
"""
LIMITED = "min(1, max(-1, 10*(y - v)))"  # y = 1, y = -1 and, between, y = 2/9


def test_a_bistable_circuit_is_told(tiny) -> None:
    m = tiny(SCHMITT.format(start="", limited=LIMITED)).start()
    assert len(warnings(m)) == 1


@pytest.mark.parametrize(("simplified", "chosen"), [("1", 1.0), ("-1", -1.0)])
def test_homotopy_chooses_among_solutions(tiny, simplified: str, chosen: float) -> None:
    """From the limit that the simplified side names, the path ends at that limit."""
    m = tiny(
        SCHMITT.format(start="", limited=f"homotopy({LIMITED}, simplified = {simplified})")
    ).start()
    assert m.get("y") == pytest.approx(chosen, abs=1e-12)
    assert warnings(m) == []


def test_homotopy_starts_what_newton_cannot(tiny) -> None:
    """A step of arctan's between the guess and the solution; the simplified side is a line."""
    text = """model M
  output Real y; output Real z(start = 0, fixed = true);
equation
  homotopy(actual = y + atan(50*(y - 3)), simplified = y) = 4;
  der(z) = y;
end M;
"""
    m = tiny(text).start()
    y = m.get("y")
    assert y + math.atan(50 * (y - 3)) == pytest.approx(4.0)
    _t, z = m.run(0.5, "z", step=0.1)
    assert z[-1] == pytest.approx(0.5 * y, rel=1e-9)


def test_where_the_path_ends_nowhere_the_actual_equations_are_solved(tiny) -> None:
    """The simplified side alone has no solution: y² = -1."""
    m = tiny("""model M
  output Real y(start = 1);
equation
  homotopy(y^2, y^2 + 5) = 4;
end M;
""").start()
    assert m.get("y") == pytest.approx(2.0)


def test_modes_that_could_be_the_other_way_round_are_told(tiny) -> None:
    """y = 1 where y > 0, else -1: both agree with themselves."""
    m = tiny("""model M
  output Real y; Real z; parameter Real k = 2;
equation
  k*y = (if z > 0 then 1 else -1) + 0.1*z;
  z = y;
end M;
""").start()
    assert abs(m.get("y")) == pytest.approx(1 / 1.9)
    (said,) = warnings(m)
    assert "remember by pre()" in said


def test_modes_that_follow_from_one_another_are_not_doubted(tiny) -> None:
    m = tiny("""model M
  output Real y; Real z; parameter Real k = 2;
equation
  k*y = (if z > 0 then -1 else 1) + 0.1*z + time - 2;
  z = y;
end M;
""").start()
    assert m.get("y") < 0
    assert warnings(m) == []


def test_what_is_true_from_the_start_does_not_fire(tiny) -> None:
    """change(u) holds during the initialisation, with an initial system beside it; the when-clause
    waits for the next change.
    """
    m = tiny("""model M
  output Integer n(start = 0); discrete Real s; Boolean u;
initial equation
  pre(u) = false;
  pre(n) = 0;
  s = 0;
equation
  u = time >= s and time < s + 0.8;
  when sample(1, 1) then
    s = time;
  end when;
  when change(u) then
    n = pre(n) + 2;
  end when;
end M;
""").start()
    m.step(0.1)
    assert m.get("n") == 0.0
    m.run(1.1, "n", step=0.1)
    assert m.get("n") == 4.0  # off at 0.8 s, on at 1 s
