"""Runs of views over records, dealt out to threads."""

from __future__ import annotations

import time
from collections.abc import Sequence
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from pneugantry.engine.hypotheses.catalogue import Parameter
from pneugantry.engine.hypotheses.hypothesis import effect_coordinate
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.simulation import Point, Simulation
from pneugantry.engine.views.view import Run, View


class Scale:
    """A view whose residual is a parameter."""

    name = "scale"
    sigmas = (2.0, 1e-3)

    def shows(self, record: Record) -> bool:
        return True

    def residuals(self, runs: Sequence[Run]) -> list[Array]:
        return [np.array([[v["p"]]]) for _, v in runs]


@pytest.mark.parametrize("counts", [(1, 0), (3, 40), (0, 0), (9, 70)])
def test_each_run_comes_back_in_its_place(counts: tuple[int, int]) -> None:
    """A cell without a job is none: what is tried about an end may be out of bounds altogether."""
    records = [SimpleNamespace(name=n, rows=10, period=0.1) for n in ("a", "b")]
    simulation = Simulation(
        [cast(View, Scale())], [cast(Record, record) for record in records], Rules()
    )
    jobs = {
        ("scale", r.name): [{"p": float(k)} for k in range(n)]
        for r, n in zip(records, counts, strict=True)
    }
    found = simulation.run(jobs)
    simulation.close()
    assert set(found) == {cell for cell, own in jobs.items() if own}
    for cell, made in found.items():
        assert [own[0, 0] for own in made] == [job["p"] for job in jobs[cell]]


def test_a_record_is_met_as_badly_as_its_sensors_are_noisy() -> None:
    """Signals of different units share a view: two of them three noises off."""
    record = cast(Record, SimpleNamespace(name="a", rows=10, period=0.1))
    simulation = Simulation([cast(View, Scale())], [record], Rules())
    residual = np.array([[6.0, 0.0], [np.nan, 3e-3]])
    assert simulation.misfit(("scale", "a"), residual) == pytest.approx(18.0)
    simulation.close()


@pytest.mark.parametrize(
    ("counts", "fewest"),
    [
        ({"a": [1] * 6}, 1),
        ({"a": [1] * 10, "b": [1] * 10}, 4),
        ({"a": [3] * 40}, 2),
        ({"a": [40] * 10}, 7),
    ],
)
def test_the_records_of_a_view_are_simulated_together(
    counts: dict[str, list[int]], fewest: int
) -> None:
    """In lanes that are full but for the last ones, in calls of 64 at most."""
    views, made = [Scale() for _ in counts], []
    for name, view in zip(counts, views, strict=True):
        view.name = name
    longest = max(map(len, counts.values()))
    records = [SimpleNamespace(name=str(k), rows=10, period=0.1) for k in range(longest)]

    def counted(runs: Sequence[Run]) -> list[Array]:
        made.append(len(runs))
        return [np.array([[v["p"]]]) for _, v in runs]

    for view in views:
        view.residuals = counted  # type: ignore[method-assign]
    simulation = Simulation(
        [cast(View, v) for v in views], [cast(Record, r) for r in records], Rules()
    )
    jobs = {
        (name, str(k)): [{"p": 0.0}] * n for name, own in counts.items() for k, n in enumerate(own)
    }
    simulation.run(jobs)
    simulation.close()
    assert sum(made) == sum(map(sum, counts.values()))
    assert fewest <= len(made) <= fewest + 5
    assert max(made) <= 64
    assert sum(n % 8 > 0 for n in made) <= len(counts)


def test_callers_side_by_side_share_calls() -> None:
    """While the threads are at work, what is asked for gathers."""
    view, made = Scale(), []

    def slow(runs: Sequence[Run]) -> list[Array]:
        time.sleep(0.02)
        made.append(len(runs))
        return [np.array([[v["p"]]]) for _, v in runs]

    view.residuals = slow  # type: ignore[method-assign]
    record = cast(Record, SimpleNamespace(name="r", rows=10, period=0.1))
    simulation = Simulation([cast(View, view)], [record], Rules())

    def ask(p: float) -> float:
        first = simulation.run({("scale", "r"): [{"p": p}]})["scale", "r"][0][0, 0]
        return float(simulation.run({("scale", "r"): [{"p": first + 1}]})["scale", "r"][0][0, 0])

    def nested(p: float) -> list[float]:
        return simulation.side_by_side(ask, [p, p + 10])

    found = simulation.side_by_side(nested, [float(k) for k in range(6)])
    simulation.close()
    assert found == [[k + 1, k + 11] for k in range(6)]
    assert sum(made) == 24
    assert len(made) < 18


def test_what_a_run_raises_its_caller_raises() -> None:
    view = Scale()
    record = cast(Record, SimpleNamespace(name="r", rows=10, period=0.1))
    simulation = Simulation([cast(View, view)], [record], Rules())
    with pytest.raises(KeyError):
        simulation.run({("scale", "r"): [{"q": 1.0}]})
    assert simulation.run({("scale", "r"): [{"p": 1.0}]})["scale", "r"][0] == 1.0
    simulation.close()


class Wave:
    """A view whose residual is a wave of some length."""

    name, remembers = "wave", False

    def shows(self, record: Record) -> bool:
        return True

    def depends_on(self, parameter: str) -> bool:
        return parameter == "length"

    def residuals(self, runs: Sequence[Run]) -> list[Array]:
        place = np.linspace(0, 1, 200)
        return [np.sin(2 * np.pi * place / v["length"])[:, None] for _, v in runs]


@pytest.mark.parametrize(("remembers", "exact"), [(False, True), (True, False)])
def test_columns_look_over_events_only_where_there_may_be_any(remembers: bool, exact: bool) -> None:
    """A long step in a wave's length is one over many waves."""
    view = Wave()
    view.remembers = remembers
    record = cast(Record, SimpleNamespace(name="a", rows=200, period=0.1))
    simulation = Simulation([cast(View, view)], [record], Rules())
    length = Parameter("length", 0.03, 0.02, 0.001, 1.0)
    point = Point((effect_coordinate(length, 0.0, 2.0),), np.zeros(1), {})
    cells = list(simulation.cells)
    _, columns = simulation.linearised(point, cells, {"length"}, fine=False)
    simulation.close()
    place = np.linspace(0, 1, 200)
    angle = 2 * np.pi * place / 0.03
    slope = -0.02 * np.cos(angle) * angle / 0.03
    error = np.abs(columns[cells[0], "length"][:, 0] - slope)
    assert (error.max() < 0.01 * np.abs(slope).max()) == exact


class Gate:
    """A view that reads one parameter, and others where it is above 1."""

    name, sigmas, remembers = "gate", (1.0,), False

    def __init__(self) -> None:
        self.made = 0

    def shows(self, record: Record) -> bool:
        return True

    def depends_on(self, parameter: str) -> bool:
        return True

    def residuals(self, runs: Sequence[Run]) -> list[Array]:
        self.made += len(runs)
        return [np.array([[v["g"] + (v["a"] + 2 * v["b"]) * (v["g"] > 1)]]) for _, v in runs]


class Mean(Gate):
    """A view that reads what its parameters are beyond their mean."""

    def residuals(self, runs: Sequence[Run]) -> list[Array]:
        self.made += len(runs)
        values = [np.array([v[k] for k in sorted(v)]) for _, v in runs]
        return [(v - v.mean())[:, None].round(9) for v in values]


def test_what_cancels_all_at_once_is_no_idle_point() -> None:
    record = cast(Record, SimpleNamespace(name="a", rows=10, period=0.1))
    simulation = Simulation([cast(View, Mean())], [record], Rules())
    point = {f"c{k:02}": 0.0 for k in range(40)}
    points = [point, *({**point, name: 0.1} for name in point)]
    (found,) = simulation.about([(("gate", "a"), points)])
    simulation.close()
    assert [int(np.argmax(r)) for r in found[1:]] == list(range(40))


def test_what_changed_nothing_is_moved_together() -> None:
    """And by itself again once it does; as many runs count as columns were asked for."""
    view = Gate()
    record = cast(Record, SimpleNamespace(name="a", rows=10, period=0.1))
    simulation = Simulation([cast(View, view)], [record], Rules())
    own = tuple(effect_coordinate(Parameter(n, 0.0, 1.0, -9.0, 9.0), 0.0, 2.0) for n in "gab")

    def columns(g: float) -> tuple[list[float], int, float]:
        point, before = Point(own, np.array([g, 0.0, 0.0]), {}), simulation.evaluations
        residuals = simulation.residuals(point, simulation.cells)
        view.made = 0
        found = simulation.columns(point, residuals, simulation.cells, set("gab"))
        slopes = [float(found[("gate", "a"), n][0, 0]) for n in "gab"]
        return slopes, view.made, simulation.evaluations - before

    told = [columns(g) for g in (0.0, 0.0, 5.0, 5.0, 0.0, 0.0)]
    simulation.close()
    for slopes, _, counted in told:
        assert counted == pytest.approx(4)
        assert slopes[0] == pytest.approx(1)
    assert [slopes[1:] for slopes, _, _ in told] == [
        pytest.approx([k, 2 * k]) for k in (0, 0, 1, 1, 0, 0)
    ]
    assert [made for _, made, _ in told] == [3, 2, 4, 3, 3, 2]


@pytest.mark.parametrize(("g", "made"), [(0.0, 3), (5.0, 53)])
def test_many_points_about_one_are_tried_at_once(g: float, made: int) -> None:
    view = Gate()
    record = cast(Record, SimpleNamespace(name="a", rows=10, period=0.1))
    simulation = Simulation([cast(View, view)], [record], Rules())
    point = {"g": g, "a": 0.0, "b": 0.0}
    points = [point, *({**point, "ab"[k % 2]: 0.1 * (k + 1)} for k in range(49))]
    found = simulation.about([(("gate", "a"), points), (("gate", "a"), points[:3])])
    spent = simulation.evaluations
    simulation.close()
    assert view.made == made + 3
    assert spent == pytest.approx(53)
    assert [len(runs) for runs in found] == [50, 3]
    for own, runs in zip((points, points[:3]), found, strict=True):
        each = [p["g"] + (p["a"] + 2 * p["b"]) * (g > 1) for p in own]
        assert [float(r[0, 0]) for r in runs] == pytest.approx(each)
