"""Curves and forms: what a form makes is recognised as it, in Modelica as in Python."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from modelica_fmu.batch import Drive, Subsystem
from pneugantry.engine.plant import Plant
from pneugantry.engine.views.model_parts import part_of
from pneugantry.learn.curves.curve import Knots, knots_over
from pneugantry.learn.equations.points import Point, written
from pneugantry.learn.equations.sources import EquationText, equations_of
from pneugantry.learn.screening.candidate import Candidate, Course
from pneugantry.learn.screening.linear import Base, Estimate, Response
from pneugantry.learn.screening.regressors import TIME, Regressor, products_of
from pneugantry.learn.terms.forms import (
    FORMS,
    LINE,
    FormLaw,
    distilled,
    distinct,
    free_curve,
    line_of,
)
from pneugantry.learn.terms.term import Term

HERE = Point("", EquationText(("M",), 1, "y", "u", 0, 0, 0))
KNOTS = Knots(np.linspace(-2.0, 3.0, 11), jumps=True)
TRUE = {  # where each form is most itself
    "sign": (0.7, 0.6),
    "fading sign": (-2.0, 1.1),
    "exponential": (1.5, 0.8),
    "dead zone": (3.0, 0.9),
    "ramp": (1.5, 0.7),
    "square beyond": (0.8, -0.4),
    "bump": (2.0, 0.8, 1.2),
    "sine": (1.0, 2.3, 0.4),
    "polynomial": (1.0, -0.7, 0.4),
}


def curve_of(form: FormLaw, values: tuple[float, ...]) -> np.ndarray:
    """Coefficients of a form."""
    edges = np.array([-2 * KNOTS.width, 2 * KNOTS.width])
    low, high = form.law(edges, values)
    return KNOTS.seen(form.law(KNOTS.at, values), (float(low), float(high)))


def candidate(curve: np.ndarray, sigma: float) -> Candidate:
    answer = Estimate(curve, sigma**2 * np.eye(len(curve)), 0.0)
    base, course = cast(Base, None), Course({}, None)  # of no plant
    response, u = Response(base, {}, {}), Regressor("", "u")
    return Candidate(HERE, u, KNOTS, answer, 100.0, 1.0, 1.0, 1.0, response, course)


def values_of(form: FormLaw) -> tuple[float, ...]:
    return TRUE.get(form.name, (1.3,))


@pytest.mark.parametrize(
    ("low", "high", "twins"),
    [
        (0.0, 2.0, {"signed square", "magnitude"}),
        (-2.0, 0.0, {"signed square", "magnitude"}),
        (-1.0, 2.0, set[str]()),
    ],
)
def test_on_one_side_of_zero_forms_that_differ_by_their_sign_are_one(
    low: float, high: float, twins: set[str]
) -> None:
    told = {f.name for f in distinct(np.linspace(low, high, 21))}
    assert {f.name for f in FORMS} - told == twins


@pytest.mark.parametrize("form", FORMS, ids=lambda f: f.name)
def test_a_form_is_recognised_through_noise_and_a_constant(form: FormLaw) -> None:
    curve = curve_of(form, values_of(form))
    curve += 0.4 * KNOTS.seen(np.ones(len(KNOTS.at)), (1.0, 1.0))
    curve += 1e-3 * np.random.default_rng(1).standard_normal(len(curve))
    best = distilled(KNOTS, curve, 1e-6 * np.eye(len(curve)))[0]
    assert best.law.name == form.name
    z = np.linspace(-2.0, 3.0, 50)
    left = best.law.law(z, best.values) - form.law(z, values_of(form))
    assert np.ptp(left) < 0.05 * np.ptp(form.law(z, values_of(form)))  # but for a constant


def test_a_line_has_the_constant_of_its_curve() -> None:
    curve = curve_of(LINE, (1.3, 0.4))
    curve += 1e-3 * np.random.default_rng(1).standard_normal(len(curve))
    line = line_of(KNOTS, curve, 1e-6 * np.eye(len(curve)))
    assert line is not None
    assert line.values == pytest.approx((1.3, 0.4), abs=0.002)


def test_a_curve_s_coefficients_make_it_again() -> None:
    z = np.linspace(-1.9, 2.9, 400)
    sign = next(f for f in FORMS if f.name == "fading sign")
    made = KNOTS.shapes(z) @ curve_of(sign, (-2.0, 1.1))
    far = np.abs(z) > 0.6  # nearer to 0 than a knot it is straight
    assert made[far] == pytest.approx(sign.law(z, (-2.0, 1.1))[far], abs=0.06)
    assert made[np.argmin(np.abs(z - 0.03))] < -1.3 < 1.3 < made[np.argmin(np.abs(z + 0.03))]


def test_every_form_and_a_free_curve_are_the_same_in_modelica(tmp_path: Path) -> None:
    start = free_curve(candidate(np.append(np.sin(KNOTS.at), 0.3), 0.1), KNOTS).start
    laws = [(form, values_of(form)) for form in FORMS]
    laws += [(LINE, (1.3, 0.4)), (start.law, start.values)]
    told = simulated(laws, tmp_path, Regressor("", "u"))
    for (form, values), column in zip(laws, told.T, strict=True):
        assert column == pytest.approx(form.law(INPUT, values), abs=1e-7), form.name
        assert np.ptp(column) > 0.5


INPUT = np.linspace(-2.5, 3.5, 41)  # beyond the knots, too


def simulated(
    laws: list[tuple[FormLaw, tuple[float, ...]]], folder: Path, regressor: Regressor
) -> np.ndarray:
    """Forms as the terms of `y1 = 0*u`, `y2 = 0*u`, ... over INPUT: (rows, forms)."""
    path, names = folder / "M.mo", [f"y{k + 1}" for k in range(len(laws))]
    declared = "".join(f"  output Real {n};\n" for n in names)
    body = "".join(f"  {n} = 0*u;\n" for n in names)
    path.write_text(f"model M\n  input Real u;\n{declared}equation\n{body}end M;\n", "utf-8")
    additions = {}
    for e, (form, values) in zip(equations_of(path), laws, strict=True):
        term = Term(Point("", e), regressor, form, values, (1.0,) * len(values), "block")
        additions[e] = term.addition(neutral=False)
    plant = Plant("m", path, "M", ("u",), (), {}, (), {})
    part = part_of(replace(plant, model=written(plant, additions, folder)), names, (), folder)
    return Subsystem(part).run([], np.zeros((1, 0)), Drive({"u": INPUT}), names, 0.01)[0]


def test_what_a_speed_has_travelled_is_the_same_in_modelica(tmp_path: Path) -> None:
    travelled, (linear, free) = Regressor("", "u", travelled=True), (FORMS[0], KNOTS)
    start = free_curve(candidate(np.append(np.sin(free.at), 0.3), 0.1), free).start
    told = simulated([(linear, (2.0,)), (start.law, start.values)], tmp_path, travelled)
    held = np.concatenate([[0.0], np.cumsum(np.abs(INPUT))[:-1]]) * 0.01  # each row is held
    assert told[:, 0] == pytest.approx(2.0 * held, abs=1e-6)
    assert told[:, 1] == pytest.approx(start.law.law(held, start.values), abs=1e-6)
    against = Regressor("box", "w", "w", 0.01, travelled=True)
    term = Term(point_of("y"), against, linear, (0.3,), (0.1,), "box")
    assert term.regressor.label == "travel of box.w against w"
    assert term.formula() == "(0.3*travel(w))*sign(w)"


def test_a_coefficient_may_vary() -> None:
    varying = Regressor("box", "i", times="v")
    term = Term(point_of("y"), varying, FORMS[0], (0.3,), (0.1,), "box")
    assert (varying.label, term.formula()) == ("box.i times v", "(0.3*i)*v")
    assert term.addition(neutral=True).term == "missing_1.y*v"
    clock, (i, v, rate) = Regressor("", TIME), (Regressor("box", n) for n in ("i", "v", "u"))
    log = {"log": np.array([-1.0, 0.0, 2.0])}
    made = products_of({i: log, v: log, rate: log, clock: log, replace(i, speed="v"): log})
    assert {r.label for r in made} == {
        *("box.i times v", "box.i times u", "box.v times i", "box.v times u", "box.u times i"),
        *("box.u times v", "time times i", "time times v", "time times u"),
    }
    assert all(r.plain in (i, v, rate, clock) for r in made)
    assert varying.factors({v: log}) == log
    reads_u = [r.times for r in made if r.within(point_of("y"))]
    assert set(reads_u) == {"u"}


def test_knots_lie_where_the_data_do() -> None:
    values = np.concatenate([np.linspace(0.0, 1.0, 1000), [50.0]])
    even = np.ones(len(values))
    knots = knots_over(values, [even])
    assert knots is not None
    assert knots.at[-1] < 1.01
    assert knots.hats(np.array([-3.0, 0.5, 50.0])).sum(axis=1) == pytest.approx(1.0)
    assert knots_over(np.full(10, 3.0), [np.ones(10)]) is None
    felt = np.where(values < 0.2, 1.0, 0.0)  # elsewhere an addend changes no residual
    asked = np.where(values > 20, 100.0, 0.1)  # there the residuals are large
    near, both = knots_over(values, [felt]), knots_over(values, [felt, asked])
    assert near is not None
    assert both is not None
    assert near.at[[0, -1]] == pytest.approx([0.0, 0.2], abs=0.01)
    assert both.at[[0, -1]] == pytest.approx([0.0, 50.0], abs=0.01)
    assert knots_over(values, [np.zeros(len(values))]) is None


def point_of(left: str) -> Point:
    """The equation LEFT = u of the component box."""
    return Point("box", EquationText(("M",), 1, left, "u", 0, 0, 0))


def test_a_term_may_turn_round_with_a_speed() -> None:
    against = Regressor("box", "T", "w", 0.01)
    term = Term(point_of("y"), against, FORMS[0], (0.3,), (0.1,), "box")
    assert term.formula() == "(0.3*T)*sign(w)"
    assert term.addition(neutral=True).term == "missing_1.y*tanh(w/0.01)"
    assert against.label == "box.T against w"
    speeds = {Regressor("box", "w"): {"log": np.array([-1.0, 0.0, 2.0])}}
    signs = against.factors(speeds)
    assert signs is not None
    assert signs["log"] == pytest.approx([-1.0, 0.0, 1.0])
    assert against.plain.factors(speeds) is None


def test_a_curve_has_the_units_that_are_declared() -> None:
    """Not where another variable is a factor of it; what a speed has travelled is a way."""
    known = {"box.v": "m/s", "box.F": "N", "box.u": "V"}

    def units(regressor: Regressor) -> tuple[str, str]:
        return Term(point_of("F"), regressor, FORMS[0], (1.0,), (1.0,), "box").units(known)

    assert units(Regressor("box", "v")) == ("m/s", "N")
    assert units(Regressor("box", "v", travelled=True)) == ("m", "N")
    assert units(Regressor("box", "v", times="u")) == ("m/s", "")
    assert units(Regressor("", "time")) == ("s", "N")
    assert units(Regressor("box", "w")) == ("", "N")
