"""Terms of a measured state that another component has, which the plant's own class gives them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pneugantry.cli import main
from pneugantry.engine.answer.confirm import replays
from pneugantry.engine.plant import Plant, Record, Signal
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.build import build_views
from pneugantry.learn.equations.points import Opened, Point, opened
from pneugantry.learn.screening.regressors import Regressor, products_of, regressors_of
from pneugantry.learn.terms.forms import FORMS
from pneugantry.learn.terms.term import Term, with_term

PERIOD, ROWS = 1e-3, 3000
DESCRIPTION = """
[plant]
model = "Fed.mo"
class = "Fed.Plant"
catalogue = "effects.toml"
period = 0.01
[inputs]
u = "u"
w = "w"
[outputs.s]
sigma = 0.001
[outputs.a]
sigma = 0.02
[outputs.b]
sigma = 0.02
[tolerance]
"near.k" = 0.03
"far.k" = 0.03
[log.swings]
file = "swings.csv"
[log.steps]
file = "steps.csv"
[log.other]
file = "other.csv"
use = "held out"
"""
T = PERIOD * np.arange(ROWS)
MODEL = """
package Fed
  model Slide
    input Real f;
    output Real s(unit = "m", start = 0, fixed = true);
    output Real v(unit = "m/s", start = 0, fixed = true);
  equation
    der(s) = v;
    der(v) = f - v;
  end Slide;
  block Spring
    parameter Real k = 2;
    parameter Real F_0 = 0;
    input Real d;
    output Real y;
  equation
    y = k*d + F_0;
  end Spring;
  model Plant
    Slide slide;
    Spring near "its stiffness grows along the slide";
    Spring far(y(start = 1));
    input Real u, w;
    output Real s(unit = "m"), a, b;
  equation
    slide.f = u;
    near.d = w;
    far.d = w;
    s = slide.s;
    a = near.y;
    b = far.y;
  end Plant;
end Fed;
"""

EFFECT = """
name = "constant_force"
block = "near"
[[form]]
name = "force"
[form.parameters."near.F_0"]
scale = 0.3
low = -50
high = 50
"""


def _opened(folder: Path, name: str = "Fed", text: str = MODEL) -> tuple[Plant, Opened]:
    model = folder / f"{name}.mo"
    model.write_text(text, encoding="utf-8")
    signals = tuple(Signal(n, n, 1.0) for n in ("s", "a", "b"))
    plant = Plant(name, model, f"{name}.Plant", ("u", "w"), signals, {}, (), {})
    views = build_views(plant, ["s", "a", "b"], folder, PERIOD, Rules())
    return plant, opened(plant, views, folder)


def _point(apart: Opened, component: str) -> Point:
    return next(p for p in apart.points if p.component == component)


def _record() -> Record:
    signals = {"s": np.sin(T), "a": np.cos(T), "b": np.cos(T)}
    return Record("run", PERIOD, {"u": np.sin(2 * T), "w": np.cos(3 * T)}, signals, {})


@pytest.mark.parametrize("component", ["near", "far"])  # without and with a modifier
@pytest.mark.parametrize("blank", [False, True])
def test_the_plant_gives_a_component_what_another_one_has(
    tmp_path: Path, component: str, blank: bool
) -> None:
    plant, apart = _opened(tmp_path)
    point = _point(apart, component)
    regressor = Regressor(component, "s", times="d", fed=True)
    linear = next(f for f in FORMS if f.name == "linear")
    term = Term(point, regressor, linear, (0.7,), (1.0,), component)
    made = with_term(plant, term, tmp_path, blank=blank)
    values = {**term.starts, **(term.settings if blank else {})}
    (told,) = replays(made, _record(), [values], tmp_path)
    assert told is not None
    s, a, b = told.simulated.T
    own, other = (a, b) if component == "near" else (b, a)
    w = np.cos(3 * T)
    assert np.ptp(s) > 0.1
    assert own == pytest.approx((2 + 0.7 * s) * w, abs=5e-3)  # an input is held over a row
    assert other == pytest.approx(2 * w, abs=5e-3)
    assert term.formula() == "(0.7*s)*d"
    assert term.name == "linear of s times d"
    assert term.units(apart.shape.units)[0] == "m"


def test_what_a_component_has_itself_is_not_given_to_it(tmp_path: Path) -> None:
    _, apart = _opened(tmp_path)
    assert _point(apart, "near").fed == (("s", "s"),)
    assert _point(apart, "slide").fed == ()


def test_what_an_opened_view_forgets_the_plant_s_views_keep(tmp_path: Path) -> None:
    """These share what they have made of readings."""
    plant, _ = _opened(tmp_path)
    views = build_views(plant, ["s", "a", "b"], tmp_path, PERIOD, Rules())
    apart = opened(plant, views, tmp_path)
    first, *others = views
    first.readings.true.of("made", lambda: np.zeros(1))
    assert others
    assert all(v.readings.true.get("made") is not None for v in others)
    for view in apart.views:
        view.forget()
    assert first.readings.true.get("made") is not None
    others[0].forget()
    assert first.readings.true.get("made") is None


def test_it_is_tried_alone_and_times_the_component_s_variables(tmp_path: Path) -> None:
    _, apart = _opened(tmp_path)
    point, record = _point(apart, "near"), _record()
    wanted = {point: apart.variables(point)}
    found = regressors_of(wanted, apart, [record], {"run": {}})
    s = Regressor("", "s", fed=True)
    assert found[s]["run"] == pytest.approx(np.sin(T), abs=1e-3)
    assert Regressor("near", "s", times="d", fed=True) in products_of(found)
    assert not any(r.times == "s" for r in products_of(found))


NESTED = """
package Nested
  block Resistance
    parameter Real level = 2;
    input Real v;
    output Real y;
  equation
    y = level*v;
  end Resistance;
  block Carriage
    input Real p, v;
    output Real F;
    Resistance seal(level = 2);
  equation
    seal.v = v;
    F = seal.y;
  end Carriage;
  model Plant
    input Real u, w;
    output Real s(start = 0, fixed = true);
    output Real a, b;
    Carriage near, far;
  equation
    der(s) = u;
    near.p = s;
    far.p = 0;
    near.v = w;
    far.v = w;
    a = near.F;
    b = far.F;
  end Plant;
end Nested;
"""


def test_a_part_of_a_component_is_given_what_that_has(tmp_path: Path) -> None:
    """A seal's friction may grow with the pressure that acts on its carriage."""
    plant, apart = _opened(tmp_path, "Nested", NESTED)
    point = _point(apart, "near.seal")
    assert point.fed == (("s", "p"),)
    assert _point(apart, "far.seal").fed == ()
    assert not any("seal" in p.component for p in apart.shared)
    linear = next(f for f in FORMS if f.name == "linear")
    term = Term(point, Regressor("near.seal", "s", times="v", fed=True), linear, (0.7,), (1.0,), "")
    made = with_term(plant, term, tmp_path)
    assert "seal(missing_1(z = p), level = 2)" in made.model.read_text(encoding="utf-8")
    (told,) = replays(made, _record(), [term.starts], tmp_path)
    assert told is not None
    s, a, b = told.simulated.T
    w = np.cos(3 * T)
    assert np.ptp(s) > 0.1
    assert a == pytest.approx((2 + 0.7 * s) * w, abs=5e-3)
    assert b == pytest.approx(2 * w, abs=5e-3)


def _log(folder: Path, name: str, seed: int) -> None:
    """Of a spring that is stiffer the farther the slide is from 0.4 m."""
    rows, dt = 800, 0.01
    rng = np.random.default_rng(seed)
    t = dt * np.arange(rows)
    u = np.sin((1.1 + 0.3 * seed) * t) + 0.5 * np.sin(2.9 * t + seed)
    u = np.sign(u) if name == "steps" else u
    w = 1.5 * np.cos((2.3 - 0.2 * seed) * t) + np.sin(0.7 * t)
    s, v, way = 0.0, 0.0, []
    for f in u:
        way.append(s)
        for _ in range(10):
            s, v = s + 0.001 * v, v + 0.001 * (f - v)
    stiff = 2.03 + 0.8 * (np.array(way) - 0.4)
    made = {"s": np.array(way), "a": stiff * w, "b": 1.98 * w}
    noise = {"s": 0.001, "a": 0.02, "b": 0.02}
    read = {n: x + noise[n] * rng.standard_normal(rows) for n, x in made.items()}
    pd.DataFrame({"u": u, "w": w, **read}).to_csv(folder / f"{name}.csv", index=False)


def test_a_stiffness_that_grows_along_another_component_is_learnt(tmp_path: Path) -> None:
    (tmp_path / "Fed.mo").write_text(MODEL, encoding="utf-8")
    (tmp_path / "effects.toml").write_text(EFFECT, encoding="utf-8")
    (tmp_path / "plant.toml").write_text(DESCRIPTION, encoding="utf-8")
    for seed, name in enumerate(("swings", "steps", "other")):
        _log(tmp_path, name, seed)
    out, told = tmp_path / "out", tmp_path / "told.json"
    command = ["diagnose", str(tmp_path / "plant.toml"), "--json", str(told)]
    assert main([*command, "--augmented", str(out)]) == 0
    learned = json.loads(told.read_text(encoding="utf-8"))["learned"]
    assert learned["accepted"], learned["why"]
    term = learned["term"]
    assert (term["component"], term["regressor"]) == ("near", "s times d")
    assert term["form"] == "line"  # about 0.4 m: its constant is beyond the tolerance of k
    slope, place = (p["value"] for p in term["parameters"].values())
    assert slope == pytest.approx(0.8, abs=0.02)
    assert place == pytest.approx(0.4, abs=0.1)
    assert learned["gap"]["with"] < 1.3 * learned["gap"]["floor"]
    assert "near(missing_1(z = s))" in (out / "Fed.mo").read_text(encoding="utf-8")
