"""A curve over a variable that records pass once is as well one over the way travelled."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pneugantry.engine.answer.decide import UNKNOWN, Evidence, Outstanding, beliefs, decide
from pneugantry.engine.answer.imitation import expected, imitations, imitators
from pneugantry.engine.chances import Chances
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.noise import Whitener
from pneugantry.engine.hypotheses.catalogue import Effect, Form, Parameter
from pneugantry.engine.hypotheses.hypothesis import Coordinate, Hypothesis
from pneugantry.engine.plant import Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.simulation import Point

NODES, ROWS, SIGMA = 9, 1200, 0.01
ONE_WAY = {"there": (0.0, 8.0), "half": (0.0, 4.0)}
FORTH_AND_BACK = {"there": (0.0, 8.0, 0.0, 8.0), "half": (4.0, 8.0, 0.0, 4.0)}


def curve_of(ways: dict[str, tuple[float, ...]], told: bool = True) -> tuple[Any, Fit]:
    """A fitter and a fit of friction over position, on records that move through these places."""
    names = [f"friction.table[{k + 1}]" for k in range(NODES)]
    theta = np.sin(np.arange(NODES)) + 1.0
    form = Form("profile", tuple(Parameter(n, 0.0, 1.0, -9.0, 9.0) for n in names))
    effect = Effect("friction_position", "x", "friction_x", "", (form,))
    coordinates = [Coordinate(n, 0.0, 1.0, effect=True, spread=2.0) for n in names]
    random, residuals, columns = np.random.default_rng(1), {}, {}
    for record, places in ways.items():
        at = np.interp(np.linspace(0, len(places) - 1, ROWS), range(len(places)), places)
        for k, name in enumerate(names):
            hat = np.maximum(0.0, 1.0 - np.abs(at - k)) * (1.0 if told else (-1.0) ** k)
            columns[("axis", record), name] = 0.1 * hat[:, None]
        residuals["axis", record] = SIGMA * random.standard_normal((ROWS, 1))
    fit = Fit(
        Hypothesis(((effect, form),)),
        Point(tuple(coordinates), theta, {}),
        residuals,
        columns,
        {cell: (Whitener(np.zeros(0), SIGMA),) for cell in residuals},
        {},
        np.eye(NODES),
        1.0,
        {},
        0.0,
    )
    fitter = SimpleNamespace(
        rules=Rules(),
        simulation=SimpleNamespace(views={"axis": SimpleNamespace(sigmas=(SIGMA,))}),
        noise=SimpleNamespace(by_stretch=lambda cell, terms: stretches(terms)),
    )
    return fitter, fit


def stretches(terms: np.ndarray) -> np.ndarray:
    return np.array([p.sum() for p in np.array_split(terms, len(terms) // 50)])


def behind(ways: dict[str, tuple[float, ...]], told: bool = True) -> dict[str, float]:
    return {i.variable: i.behind for i in imitations(*curve_of(ways, told))}


def test_one_way_tells_position_from_time_but_not_from_the_way() -> None:
    found = behind(ONE_WAY)
    assert found["way travelled"] < 10
    assert found["time"] > 30  # a curve of its own for each record costs as many numbers again


def test_back_over_the_same_places_tells_it_from_both() -> None:
    assert min(behind(FORTH_AND_BACK).values()) > 200


def test_a_run_from_elsewhere_tells_position_from_the_way() -> None:
    assert behind({**ONE_WAY, "next": (3.0, 8.0)})["way travelled"] > 100


def test_a_record_that_is_expected_is_read_by_the_rig_s_sensors_under_a_name_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[Record] = []

    class Stub:
        def __init__(self, plant: object, views: object, records: list[Record], *rest: object):
            seen.extend(records)

        def in_more_records(self, fit: Fit) -> Fit:
            return fit

        def close(self) -> None: ...

    monkeypatch.setattr("pneugantry.engine.answer.imitation.Fitter", Stub)
    monkeypatch.setattr("pneugantry.engine.answer.imitation.imitations", lambda fitter, fit: [])
    at = np.linspace(0.0, 1.0, 100)
    logged = Record("next", 0.01, {}, {"x": at}, {})
    bias = Coordinate("sensors.x.bias", 0.0, 1.0, effect=False, spread=1.0)
    point = Point((bias,), np.array([0.5]), {})
    fit = Fit(**{**vars(curve_of(ONE_WAY)[1]), "point": point})
    task: Any = SimpleNamespace(plant=None, views=(), data=SimpleNamespace(fitted=(logged,)))
    assert expected(task, fit, logged, Rules(), 1.0) == []
    assert [r.name for r in seen] == ["next", "next+"]
    np.testing.assert_allclose(seen[1].signals["x"], at + 0.5)


def test_nothing_is_said_where_columns_do_not_tell_the_place() -> None:
    assert behind(FORTH_AND_BACK, told=False) == {}


def test_nothing_is_said_where_only_a_bent_parameter_stands_in_for_the_curve() -> None:
    """Its place is not told; a parameter that does what the whole curve does is bent by 40."""
    fitter, fit = curve_of(FORTH_AND_BACK, told=False)
    own = dict(zip((c.name for c in fit.point.coordinates), fit.point.theta, strict=True))
    columns = dict(fit.columns)
    for cell in fit.residuals:
        whole = sum(columns[cell, n] * t for n, t in own.items())
        columns[cell, "level"] = whole / 40.0
    level = Coordinate("level", 0.0, 1.0, effect=False, spread=1.0)
    point = Point((*fit.point.coordinates, level), np.append(fit.point.theta, 0.0), {})
    assert imitations(fitter, Fit(**{**vars(fit), "columns": columns, "point": point})) == []


def test_forms_without_a_curve_have_no_other_variable() -> None:
    fitter, fit = curve_of(ONE_WAY)
    effect = fit.hypothesis.effects[0][0]
    level = Form("level", (Parameter("friction.level", 0.0, 1.0, -9.0, 9.0),))
    bare = Fit(**{**vars(fit), "hypothesis": Hypothesis(((effect, level),))})
    assert imitations(fitter, bare) == []


@pytest.mark.parametrize(
    ("ways", "unknown"), [(ONE_WAY, (0.3, 0.45)), (FORTH_AND_BACK, (0.03, 0.05))]
)
def test_what_imitates_an_effect_is_weighed_beside_it(
    ways: dict[str, tuple[float, ...]], unknown: tuple[float, float]
) -> None:
    fitter, fit = curve_of(ways)
    chances = Chances(imitated=0.04)
    found = [Evidence(fit, -300.0)]
    others, notes = imitators(fitter, found, chances)
    made = decide(found, Outstanding(0.0), chances, imitators=others)
    assert unknown[0] < made.unknown < unknown[1]
    assert made.unknown - made.imitated == pytest.approx(0.04, abs=0.02)
    assert made.verdict == ("ambiguous" if ways is ONE_WAY else "identified")
    assert [n.split(":")[0] for n in notes] == ["friction_position/x"] * (ways is ONE_WAY)


def test_something_unknown_that_is_weighed_is_believed_beside_the_other_effects() -> None:
    weighed = [(("lag/x", "curve/x"), -300.0), (("lag/x", UNKNOWN), -300.0)]
    found = beliefs(weighed, Outstanding(-1.0), (), Chances(imitated=0.0))
    assert found[frozenset({"lag/x"}), True] == pytest.approx(0.5, abs=1e-3)
    assert sum(found.values()) == pytest.approx(1.0)
