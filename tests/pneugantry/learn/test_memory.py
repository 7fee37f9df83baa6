"""Terms that remember: what they make of a variable, as rows and as Modelica."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pneugantry.engine.answer.confirm import replays
from pneugantry.engine.plant import Plant, Record, Signal
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.build import build_views
from pneugantry.learn.curves.memory import MEMORIES
from pneugantry.learn.equations.points import Point, Shared, recut
from pneugantry.learn.equations.sources import components_of, declared_in, equations_of
from pneugantry.learn.screening.regressors import Regressor
from pneugantry.learn.terms.forms import REMEMBERING
from pneugantry.learn.terms.term import Term, with_term

PERIOD, ROWS = 1e-3, 6000
T = PERIOD * np.arange(ROWS)
OF_NAME = {m.name: m for m in MEMORIES}
MODEL = """
package Two
  block Reader "with a gain"
    input Real u;
    output Real y;
  equation
    y = 2*u;
  end Reader;
  model Both
    Reader first, second;
    Reader third(y(start = 1)) "modified";
    input Real u;
    output Real a, b, c;
  equation
    first.u = u;
    second.u = u;
    third.u = 3*u;
    a = first.y;
    b = second.y;
    c = third.y;
  end Both;
end Two;
"""

CART = """
model Cart "a body that a force moves"
  input Real f;
  output Real v(start = 0, fixed = true);
equation
  2*der(v) = f;
end Cart;
"""


def test_a_play_stays_where_it_is_until_its_band_ends() -> None:
    z = np.array([0.0, 0.2, 0.5, 1.0, 0.8, 0.3, 0.1])
    left = OF_NAME["play"].walk(z, PERIOD, (0.3,))
    assert left == pytest.approx([0.0, 0.2, 0.3, 0.3, 0.1, -0.3, -0.3])


@pytest.mark.parametrize(
    ("name", "p"),
    [("play", (0.3,)), ("lag", (0.1,)), ("resonance", (0.2, 0.1)), ("recoil", (0.2, 0.1))],
)
def test_its_slope_is_that_of_one_row_alone(name: str, p: tuple[float, ...]) -> None:
    memory, z = OF_NAME[name], np.sin(np.arange(40)) + 0.2 * np.cos(2.3 * np.arange(40))
    off = memory.walk(z, 0.01, p)
    slope = np.broadcast_to(memory.slope(off, 0.01, p), z.shape)
    assert np.ptp(slope) > 0 or name != "play"  # its ends are met
    for k in range(1, len(z)):
        moved = np.where(np.arange(len(z)) == k, z + 1e-6, z)
        other = (memory.walk(moved, 0.01, p)[k] - off[k]) / 1e-6
        assert slope[k] == pytest.approx(other, abs=1e-6)


def test_a_lag_is_behind_a_ramp_by_its_own_time() -> None:
    left = OF_NAME["lag"].walk(4 * T + 1, PERIOD, (0.3,))
    assert left == pytest.approx(4 * 0.3 * (1 - np.exp(-T / 0.3)), abs=1e-12)


def test_a_resonance_answers_its_own_period_by_its_damping() -> None:
    turn, zeta = 0.4, 0.05
    left = OF_NAME["resonance"].walk(np.sin(2 * np.pi * T / turn), PERIOD, (turn, zeta))
    answer = left[-2000:] - np.sin(2 * np.pi * T[-2000:] / turn)
    assert np.abs(answer).max() == pytest.approx(1 / (2 * zeta), rel=0.02)


def test_a_recoil_takes_what_is_pushed_along_at_once_and_gives_it_back() -> None:
    """A stroke much shorter than the period moves the base as if it were free; one much longer
    leaves it in its place.
    """
    turn, zeta = 0.4, 0.7
    walk = OF_NAME["recoil"].walk
    fast = 2 * np.pi / (0.02 * turn)
    left = walk(np.sin(fast * T), PERIOD, (turn, zeta))[-2000:]
    assert np.abs(left).max() == pytest.approx(fast, rel=0.1)
    slow = 2 * np.pi / (20 * turn)
    left = walk(np.sin(slow * T), PERIOD, (turn, zeta))[-2000:]
    assert np.abs(left).max() < 0.01 * slow


def _plant(folder: Path) -> Plant:
    model = folder / "Two.mo"
    model.write_text(MODEL, encoding="utf-8")
    signals = tuple(Signal(n, n, 1.0) for n in ("a", "b", "c"))
    return Plant("two", model, "Two.Both", ("u",), signals, {}, (), {})


def _record(u: np.ndarray) -> Record:
    signals = {n: np.zeros(len(u)) for n in ("a", "b", "c")}
    return Record("run", PERIOD, {"u": u}, signals, {})


@pytest.mark.parametrize(
    ("name", "values", "error"),
    [("play", (0.3,), 0.02), ("lag", (0.2,), 5e-3), ("resonance", (0.5, 0.1), 0.01)],
)
def test_its_modelica_does_what_its_rows_do(
    tmp_path: Path, name: str, values: tuple[float, ...], error: float
) -> None:
    plant = _plant(tmp_path)
    law = next(f for f in REMEMBERING if f.name == name)
    point = Point("second", equations_of(plant.model)[0])
    term = Term(point, Regressor("second", "u"), law, (1.5, *values), (1.0, 0.5, 0.5), "second")
    u = np.sin(3 * T)
    made = with_term(plant, term, tmp_path)
    (told,) = replays(made, _record(u), [term.starts], tmp_path)
    assert told is not None
    expected = 1.5 * OF_NAME[name].walk(u, PERIOD, values)
    assert told.simulated[:, 0] == pytest.approx(2 * u, abs=1e-6)
    assert told.simulated[:, 1] - 2 * u == pytest.approx(expected, abs=error)
    assert f"{name}(u, " in term.formula()


def test_a_recoil_is_that_of_a_body_on_an_elastic_base(tmp_path: Path) -> None:
    """Against two bodies: a force pushes the base with `ratio` of the acceleration that it gives
    the body; what is measured is how fast the body moves along the base.
    """
    mass, ratio, w, zeta = 2.0, 0.25, 15.0, 0.05
    force = 8 * np.sin(5 * T) + 4 * np.sign(np.sin(2 * T))

    def moved(t: float, y: np.ndarray) -> list[float]:
        pushed = force[int(t / PERIOD)] / mass  # held from row to row
        base = -(w**2) * y[1] - 2 * zeta * w * y[2] - ratio * pushed
        return [pushed - base, y[2], base]

    true = solve_ivp(moved, (0, T[-1]), [0.0] * 3, t_eval=T, max_step=PERIOD).y[0]
    model = tmp_path / "Cart.mo"
    model.write_text(CART, encoding="utf-8")
    plant = Plant("cart", model, "Cart", ("f",), (Signal("v", "v", 1.0),), {}, (), {})
    law = next(f for f in REMEMBERING if f.name == "recoil")
    lighter = np.sqrt(1 + ratio)  # the base swings with the body on it
    values = (mass * ratio / (1 + ratio), 2 * np.pi * lighter / w, zeta / lighter)
    point = Point("", equations_of(model)[0])
    term = Term(point, Regressor("", "v"), law, values, (1.0, 0.5, 0.5), "cart")
    record = Record("run", PERIOD, {"f": force}, {"v": true}, {})
    (told,) = replays(with_term(plant, term, tmp_path), record, [term.starts], tmp_path)
    assert told is not None
    rigid = np.cumsum(force) * PERIOD / mass
    off = np.abs(told.simulated[:, 0] - true).max()
    assert off < 0.05 * np.abs(rigid - true).max()  # its slope is 2 ms late at jumps of the force
    assert "*recoil(v, " in term.formula()


def test_a_common_cause_has_one_set_of_parameters(tmp_path: Path) -> None:
    plant = _plant(tmp_path)
    paths = ("first", "third")
    declared = declared_in(plant.model, components_of(plant.model, plant.class_name))
    assert sorted(declared) == ["first", "second", "third"]
    equations = equations_of(plant.model)
    shared = Shared(paths, tuple(declared[p] for p in paths), equations[-1].section)
    law = next(f for f in REMEMBERING if f.name == "lag")
    point = Point("first", equations[0], shared=shared)
    term = Term(point, Regressor("first", "u"), law, (1.5, 0.2), (1.0, 0.5), "first")
    assert term.parameters == ("common_missing_1_p1", "common_missing_1_p2")
    u = np.sin(3 * T)
    made = with_term(plant, term, tmp_path)
    (told,) = replays(made, _record(u), [term.starts], tmp_path)
    assert told is not None
    left = 1.5 * OF_NAME["lag"].walk(u, PERIOD, (0.2,))
    assert told.simulated == pytest.approx(
        np.column_stack([2 * u + left, 2 * u, 6 * u + 3 * left]), abs=0.02
    )


def test_a_view_shows_the_same_records_whatever_a_term_remembers(tmp_path: Path) -> None:
    plant = _plant(tmp_path)
    still = _record(np.zeros(ROWS))
    (view,) = build_views(plant, ["b"], tmp_path, PERIOD, Rules())
    assert view.shows(still)  # nothing happens, and nothing could have been missed
    law = next(f for f in REMEMBERING if f.name == "lag")
    point = Point("second", equations_of(plant.model)[0])
    term = Term(point, Regressor("second", "u"), law, (1.5, 0.2), (1.0, 0.5), "second")
    made = recut(view, with_term(plant, term, tmp_path), tmp_path)
    assert made.part.of("state")
    assert made.shows(still)
