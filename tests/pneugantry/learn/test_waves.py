"""Waves that run on between records."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from pneugantry.engine.plant import Array
from pneugantry.learn.curves.curve import Wave
from pneugantry.learn.curves.places import place_of
from pneugantry.learn.screening.candidate import Course
from pneugantry.learn.screening.linear import Products
from pneugantry.learn.screening.reply import means
from pneugantry.learn.screening.waves import periods_of

PERIOD, BLOCK, ROWS = 0.37, 10, 3000
TIMES = 0.002 * np.arange(ROWS)
PHASES = {"one": 0.4, "two": 2.1, "three": 4.4}


@dataclass
class Direct:
    """A response whose residuals are the addend's means, as `linear.Response`."""

    residuals: dict[str, Array]
    factor: float = -2.0
    replies: dict[tuple[str, str], object] = field(default_factory=dict)
    products: dict[tuple[str, str], dict[str, Products]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, r in self.residuals.items():
            n = ROWS // BLOCK
            self.replies["view", name] = object()
            own = Products(np.eye(n), np.zeros((0, n)), means(r, BLOCK)[:, 0])
            self.products["view", name] = {name: own}

    def shapes(self, cell: tuple[str, str], series: dict[str, Array]) -> Array:
        return means(series[cell[1]], BLOCK)


@pytest.mark.parametrize("period", [PERIOD, 2.6 * BLOCK * 0.002])
@pytest.mark.parametrize("of_time", [1.0, 1 + TIMES])
def test_a_period_is_found_in_records_that_begin_anywhere_within_it(of_time, period):
    noise = np.random.default_rng(0)
    records = {
        name: of_time * np.sin(2 * np.pi * TIMES / period + phase) + noise.normal(size=ROWS)
        for name, phase in PHASES.items()
    }
    factors = None if np.ndim(of_time) == 0 else dict.fromkeys(records, of_time)
    found = periods_of(Direct(records), dict.fromkeys(records, TIMES), factors)  # type: ignore[arg-type]
    assert found[0] == pytest.approx(period, rel=0.01)


def test_records_with_phases_of_their_own_have_columns_of_their_own():
    course = Course({"one": TIMES[:4], "two": TIMES[:5]}, None)
    shared, apart = course.shapes(Wave(PERIOD)), course.shapes(Wave(PERIOD, 2))
    assert [s.shape for s in apart.values()] == [(4, 4), (5, 4)]
    assert np.array_equal(apart["one"][:, :2], shared["one"])
    assert np.array_equal(apart["two"][:, 2:], shared["two"])
    assert not apart["one"][:, 2:].any()
    assert Wave(PERIOD, 2).prior(2.0, 1.0).shape == (4, 4)


class Sine:
    """Two views, of which one reads the place of a wave, as `Simulation`."""

    cells = (("hears", "new"), ("deaf", "new"))

    def __init__(self, place: float) -> None:
        self.place = place
        self.views = {name: self for name, _ in self.cells}

    def depends_on(self, name: str) -> bool:
        return name == "p3"

    def run(self, jobs):
        return {c: [self._left(v["p3"]) for v in runs] for c, runs in jobs.items()}

    def _left(self, place: float) -> Array:
        noise = np.random.default_rng(1).normal(size=ROWS)
        waves = [np.sin(2 * np.pi * (TIMES - p) / PERIOD) for p in (self.place, place)]
        return np.asarray(waves[0] - waves[1] + noise)[:, None]


@pytest.mark.parametrize("place", [0.01, 0.2, 0.36])
def test_a_record_tells_where_a_wave_stands_in_it(place):
    found = place_of(Sine(place), {"p1": 1.0}, "p3", PERIOD)  # type: ignore[arg-type]
    assert min(abs(found - place), PERIOD - abs(found - place)) < 0.01
