"""Smaller parts where runs leave most parameters as they are: the same figures, by less."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pneugantry.engine.plant import Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.build import build_views
from pneugantry.engine.views.pieces import Piece
from pneugantry.engine.views.subsystem import SubsystemView
from pneugantry.engine.views.synthetic import Nominal


@pytest.fixture
def views(cart: Plant, cache: Path) -> dict[str, SubsystemView]:
    measured = [s.name for s in cart.signals]
    made = build_views(cart, measured, cache, 2e-3, Rules(observer=0.008))
    return {",".join(v.signals): v for v in made}


@pytest.fixture
def record(cart: Plant, push: Record, cache: Path) -> Record:
    return Nominal(cart, ["f", "v"], cache).record(push)


def the_one_with(views: dict[str, SubsystemView], parameter: str) -> SubsystemView:
    return next(v for v in views.values() if v.depends_on(parameter) and v.part.of("state"))


JOBS: list[dict[str, float]] = [{}, {"c": 0.7}, {"c": 0.7, "spring": 0.4}, {"spring": 0.4}]


def test_pieces_compute_what_the_whole_does(
    views: dict[str, SubsystemView], record: Record
) -> None:
    view = the_one_with(views, "spring")
    whole = np.stack(view.residuals([(record, job) for job in JOBS]))
    view.prepare(["c"], {})
    view.prepare(["c"], {"spring": 0.4})
    assert np.abs(np.stack(view.residuals([(record, job) for job in JOBS])) - whole).max() < 1e-9
    assert np.ptp(whole[1] - whole[0]) > 1e-4
    assert np.ptp(whole[3] - whole[0]) > 1e-4


def test_a_part_is_loaded_once_by_whoever_asks_first(views: dict[str, SubsystemView]) -> None:
    whole = Piece(the_one_with(views, "spring").part)
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: whole.subsystem, range(8)))
    assert all(f is found[0] for f in found)


def served(view: SubsystemView, jobs: list[dict[str, float]], record: Record) -> list[set[str]]:
    """Parameters that the part of each job still has."""
    solver = {"solver.max_step", "solver.tolerance"}
    defaults = dict(view.defaults)
    return [set(view._pieces.smallest({**defaults, **job}).parameters) - solver for job in jobs]


def test_each_run_takes_the_smallest_piece_that_serves_it(
    views: dict[str, SubsystemView], record: Record
) -> None:
    view = the_one_with(views, "spring")
    everything = set(view.part.of("parameter")) - {"solver.max_step", "solver.tolerance"}
    assert served(view, JOBS, record) == [everything] * 4
    view.prepare(["c"], {})
    assert served(view, JOBS, record) == [{"c"}, {"c"}, everything, everything]
    view.prepare(["c"], {"spring": 0.4})
    assert served(view, JOBS, record) == [{"c"}, {"c"}, {"c"}, {"c"}]
    view.prepare(["c", "spring"], {})
    assert served(view, [{"spring": 0.5}], record) == [{"c", "spring"}]


def test_a_piece_is_made_once(
    views: dict[str, SubsystemView], monkeypatch: pytest.MonkeyPatch
) -> None:
    view, asked = the_one_with(views, "spring"), []
    made = view._pieces._again
    assert made is not None

    def counted(fixed: Any) -> Any:
        asked.append(dict(fixed))
        return made(fixed)

    monkeypatch.setattr(view._pieces, "_again", counted)
    for moving in (["c"], ["c", "unheard"], ["c"]):
        view.prepare(moving, {})
    assert len(asked) == 1
    assert "c" not in asked[0]


def test_runs_that_feel_the_same_are_simulated_once(
    views: dict[str, SubsystemView], record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    view, runs = the_one_with(views, "spring"), []
    subsystem = view._pieces.whole.subsystem
    made = subsystem.runs

    def counted(names: Any, values: Any, *rest: Any) -> Any:
        runs.append(len(values))
        return made(names, values, *rest)

    monkeypatch.setattr(subsystem, "runs", counted)
    found = view.residuals([(record, v) for v in 2 * ({}, {"c": 0.7})])
    assert runs == [2]
    assert np.array_equal(found[0], found[2])
    assert np.array_equal(found[1], found[3])
    assert not np.array_equal(found[0], found[1])
