"""Algebraic loops whose solution ends under noEvent(): the jump is located, told and right."""

import ctypes
import math
import re
from pathlib import Path

import numpy as np
import pytest
from tiny import Tiny

ERROR = 3


def jumps(m: Tiny) -> list[float]:
    """Instants that the log tells of, s."""
    told = (re.search(r"ends at t = (\S+) s", text) for _, text in m.messages)
    return [float(found[1]) for found in told if found]


SCHMITT = """model M "amplifier of gain 10 with positive feedback, which charges a capacitor"
  output Real y(start = 1) "limited to -1..1"; output Real v(start = 0, fixed = true);
  Real d = 10*(y - 2*v); output Integer falls(start = 0, fixed = true);
equation
  y = noEvent(if d > 1 then 1 else if d < -1 then -1 else d);
  der(v) = y - v;
  when y < 0 then
    falls = pre(falls) + 1;
  end when;
end M;
"""
HALF = math.log(1.45 / 0.55)  # s, from one threshold, |v| = 0.45, to the other
FIRST = math.log(1 / 0.55)  # s, from 0 to the first one


@pytest.mark.parametrize("step", [0.001, 0.1])
def test_a_schmitt_trigger_switches_at_its_thresholds(tiny, step: float) -> None:
    """In closed form, and whatever the communication steps are."""
    m = tiny(SCHMITT).set(**{"solver.tolerance": 1e-9}).start()
    t, y, v, falls = m.run(3.0, "y", "v", "falls", step=step)
    switched = [FIRST + k * HALF for k in range(3)]
    assert jumps(m) == pytest.approx(switched, abs=1e-7)
    stretch = np.searchsorted(switched, t)
    side, since = 1.0 - 2 * (stretch % 2), t - np.array([0.0, *switched])[stretch]
    begun = np.where(stretch == 0, 0.0, -0.45 * side)
    assert y == pytest.approx(side, abs=1e-12)
    assert v == pytest.approx(side + (begun - side) * np.exp(-since), abs=1e-7)
    assert list(falls) == list((stretch + 1) // 2)


FOLDS = """model M "van der Pol's oscillator of infinite stiffness"
  output Real y(start = 2); output Real v(start = -2/3, fixed = true);
equation
  v = y - y^3/3;
  der(v) = y;
end M;
"""


def test_smooth_folds_give_the_period_of_the_relaxation_oscillation(tiny) -> None:
    """3 - 2 ln 2: from y = 2 to 1, and the same on the other side (van der Pol, 1926)."""
    m = tiny(FOLDS).set(**{"solver.tolerance": 1e-8}).start()
    _t, y = m.run(4.0, "y", step=0.05)
    told = jumps(m)
    assert np.diff([0.0, *told]) == pytest.approx(1.5 - math.log(2), abs=2e-6)
    assert len(told) == 4
    assert np.abs(y).min() >= 1 - 1e-3
    assert np.abs(y).max() <= 2 + 1e-3


def test_the_first_jump_is_a_warning_the_others_are_events(tiny) -> None:
    m = tiny(SCHMITT).start()
    m.run(3.0, step=0.1)
    assert [status for status, _ in m.messages] == [1, 0, 0]
    assert "equations of line 5 for" in m.messages[0][1]
    m.library.core_reset(m.core)
    m.start().run(1.0, step=0.1)
    assert m.messages[-1][0] == 1


def test_a_saved_state_goes_on_to_the_same_jumps(tiny) -> None:
    m = tiny(SCHMITT).start()
    m.run(0.59, step=0.01)
    m.library.core_snapshot_size.restype = ctypes.c_size_t
    size, at = m.library.core_snapshot_size(m.core), m.time
    kept = ctypes.create_string_buffer(size)
    m.library.core_save(m.core, kept)
    first = m.run(1.59, "v", step=0.1)
    m.time = at
    assert m.library.core_load(m.core, kept, ctypes.c_size_t(size)) == 0
    assert np.array_equal(m.run(1.59, "v", step=0.1), first)


def test_a_steep_loop_with_one_solution_makes_no_events(tiny) -> None:
    """y moves by 3 within 2 ms, and no step is spent on looking for a jump."""
    m = tiny("""model M
  output Real y; output Real z(start = 0, fixed = true);
equation
  y + 0.001*y^3 = 3*tanh(1000*(time - 0.5)) + 0.1*z;
  der(z) = y - z;
end M;
""").start()
    m.library.core_taken.restype = ctypes.c_ulong
    m.run(1.0, "y", step=0.1)
    assert m.messages == []
    assert m.library.core_taken(m.core) < 1100  # a thousand of 1 ms are the longest allowed


def test_a_solution_that_ends_where_there_is_no_other_stops_the_run(tiny) -> None:
    m = tiny("""model M
  output Real y(start = 1); output Real z(start = 0, fixed = true);
equation
  y^2 = 1 - z;
  der(z) = 1 + 0.01*y;
end M;
""").start()
    assert [m.step(0.3) for _ in range(4)][-1] == ERROR
    assert "have no solution for y" in m.messages[-1][1]
    assert m.get("z") == pytest.approx(1.0, abs=2e-3)


def test_model_exchange_asks_for_an_event_at_a_jump(tiny) -> None:
    """A rejected step leaves no trace: each one starts from the last that was completed."""
    m = tiny(SCHMITT).start()
    wanted = ctypes.c_int()

    def evaluate(time: float, v: float) -> float:
        assert m.library.core_set_time(m.core, ctypes.c_double(time)) == 0
        assert m.library.core_set_states(m.core, (ctypes.c_double * 1)(v)) == 0
        return m.get("y")

    def completed() -> bool:
        assert m.library.core_completed_step(m.core, ctypes.byref(wanted)) == 0
        return wanted.value != 0

    assert (evaluate(0.5, 0.4), completed()) == (1.0, False)
    assert evaluate(0.7, 0.5) == -1.0  # beyond the threshold; refused by the importer, say
    assert (evaluate(0.55, 0.44), completed()) == (1.0, False)
    assert (evaluate(0.7, 0.5), completed()) == (-1.0, True)
    assert (evaluate(0.8, 0.4), completed()) == (-1.0, False)


@pytest.mark.parametrize(
    ("equation", "several"), [("y^3 - y = time", 1), ("2*y + z = time; z = y - 1", 0)]
)
def test_only_loops_that_may_have_several_solutions_are_watched(
    tiny, tmp_path: Path, equation: str, several: int
) -> None:
    tiny(
        f"model M\n  output Real y(start = 2); Real z; equation\n  {equation};\n"
        + ("  z = 0;\n" if several else "")
        + "end M;\n"
    )
    assert f"#define JUMPING {several}\n" in (tmp_path / "model.h").read_text()


def trigger(n: int, rng: np.random.Generator) -> tuple[str, str, tuple[float, ...]]:
    """(declarations, equations, (amplitude, rad/s, threshold)) of a trigger that a sine drives,
    smooth or in pieces, of an output between 0.01 and 10.
    """
    k, a, size = rng.uniform(5, 60), rng.uniform(0.3, 2), 10 ** rng.uniform(-2, 1)
    amplitude, rate = rng.uniform(1.2, 3) * a, rng.uniform(2, 9)
    d = f"{k}*({a}*y{n}/{size} - v{n})"
    if rng.random() < 0.5:
        law, fold = f"tanh({d})", math.sqrt(1 - 1 / (a * k))
        threshold = a * fold - math.atanh(fold) / k
    else:
        law, threshold = f"noEvent(if {d} > 1 then 1 else if {d} < -1 then -1 else {d})", a - 1 / k
    variables = f"  output Real y{n}(start = {size}); Real v{n}(start = 0, fixed = true);\n"
    equations = f"  y{n} = {size}*{law};\n  der(v{n}) = {amplitude * rate}*cos({rate}*time);\n"
    return variables, equations, (amplitude, rate, threshold)


@pytest.mark.parametrize(
    "seed", [3, 5, *(pytest.param(s, marks=pytest.mark.slow) for s in range(20) if s not in (3, 5))]
)
def test_random_triggers_switch_where_their_thresholds_are(tiny, seed: int) -> None:
    """Two in a model, each by itself: high until its sine exceeds the threshold, and back."""
    rng = np.random.default_rng(seed)
    variables, equations, laws = zip(*(trigger(n, rng) for n in range(2)), strict=True)
    m = tiny(f"model M\n{''.join(variables)}equation\n{''.join(equations)}end M;\n")
    m.set(**{"solver.tolerance": 1e-8}).start()
    t, *outputs = m.run(3.0, "y0", "y1", step=float(rng.choice([0.001, 0.01, 0.1])))
    fine, expected = np.linspace(0, 3, 300_001), []
    for (amplitude, rate, threshold), y in zip(laws, outputs, strict=True):
        v, high = amplitude * np.sin(rate * fine), True
        beyond = np.flatnonzero(np.abs(v) > threshold)
        switched = [0.0]
        for i in beyond:
            if (v[i] > 0) == high:
                high = not high
                switched.append(float(fine[i]))
        side = 1 - 2 * ((np.searchsorted(switched, t, "right") - 1) % 2)
        close = np.abs(t[:, None] - np.array(switched)).min(axis=1) < 2e-5
        assert np.all((np.sign(y) == side) | close)
        expected += switched[1:]
    assert jumps(m) == pytest.approx(sorted(expected), abs=2e-5)
