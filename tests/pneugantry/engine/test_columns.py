"""Derivatives by parameters, as difference quotients of the parts: how exact they can be had where
an axis sticks and slips.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager

import numpy as np
import pytest

from pneugantry.engine.plant import Array, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.build import build_views
from pneugantry.engine.views.subsystem import SubsystemView
from pneugantry.engine.views.synthetic import Nominal
from pneugantry.plants.gantry.describe import plant_of
from pyfmi_runner.build import cache_folder
from pyfmi_runner.log import MEASURED

STATIC, DYNAMIC, LEVEL, VISCOUS = (
    "axis_x.friction.F_s", "axis_x.friction.F_d", "axis_x.friction.level", "axis_x.C",
)  # fmt: skip


@pytest.fixture(scope="module")
def moved(
    without_optimisation: Callable[[], AbstractContextManager[None]],
) -> Iterator[tuple[SubsystemView, Record]]:
    """The x carriage's view, and a record in which it breaks away and stops many times. Its parts
    are compiled when a test runs them first: all tests of this file run within the context.
    """
    with without_optimisation():
        yield _moved()


def _moved() -> tuple[SubsystemView, Record]:
    plant, cache, time = plant_of(), cache_folder() / "parts", 2e-3 * np.arange(4000)
    swing = 0.68 + 0.16 * np.sin(2 * np.pi * 0.8 * time)  # V, about where friction lets go
    zero = np.zeros_like(time)
    inputs = dict.fromkeys(plant.inputs, zero) | {"u_x": swing}
    starts = {"axis_x.s_start": 0.95, "axis_z.s_start": 0.05, "contact.present": 0.0}
    bare = Record("swing", 2e-3, inputs, {s.name: zero for s in plant.signals}, starts)
    record = Nominal(plant, MEASURED, cache).record(bare)
    view = next(
        v for v in build_views(plant, MEASURED, cache, 2e-3, Rules()) if v.signals == ("v_x",)
    )
    return view, record


def column(moved: tuple[SubsystemView, Record], name: str, share: float) -> Array:
    """Central difference quotient by a relative change of a parameter."""
    view, record = moved
    nominal = view.defaults[name]
    jobs = [{name: nominal * (1 + share)}, {name: nominal * (1 - share)}]
    up, down = view.residuals([(record, job) for job in jobs])
    return np.asarray((up - down).ravel() / (2 * share))


def test_the_axis_sticks_and_slips(moved: tuple[SubsystemView, Record]) -> None:
    speed = moved[1].signals["v_x"]
    rests = np.abs(speed) < 0.01
    assert 0.1 < rests.mean() < 0.9
    assert np.count_nonzero(np.diff(rests)) > 10


def test_a_level_is_the_sum_of_what_it_multiplies(moved: tuple[SubsystemView, Record]) -> None:
    """Exact: level and forces enter as products only."""
    parts = sum(column(moved, n, 1e-8) for n in (STATIC, DYNAMIC))
    level = column(moved, LEVEL, 1e-8)
    assert np.linalg.norm(level) > 0.1
    assert np.linalg.norm(level - parts) < 1e-5 * np.linalg.norm(level)


@pytest.mark.parametrize("name", [STATIC, DYNAMIC, VISCOUS])
def test_columns_agree_over_three_orders_of_step(
    moved: tuple[SubsystemView, Record], name: str
) -> None:
    """All but one step: where an event passes from a row into the next, the solver's own error
    (1e-7 noise levels) shows once.
    """
    columns = [column(moved, name, share) for share in (1e-8, 1e-7, 1e-6, 1e-5)]
    middle = np.median(columns, axis=0)
    off = sorted(np.linalg.norm(c - middle) / np.linalg.norm(middle) for c in columns)
    assert off[-2] < 1e-6
    assert off[-1] < 1e-4
