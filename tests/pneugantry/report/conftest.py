"""Diagnoses of a small plant, made once: what the pages of these tests show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pneugantry.engine.hypotheses.catalogue import Effect, Form, Parameter
from pneugantry.engine.plant import Data, Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found, run
from pneugantry.engine.task import Task
from pneugantry.engine.views.cuts import sharp_views
from pneugantry.engine.views.synthetic import Nominal

PERIOD, ROWS = 4e-3, 800
RULES = Rules(band=125.0, thinning=1)


def effect(name: str, parameter: str, scale: float, summary: str, *, relative: bool) -> Effect:
    own = Parameter(parameter, 0.0, scale, -1e3, 1e3, "N/m", relative=relative)
    return Effect(name, "", "cart", summary, (Form("linear", (own,)),))


CATALOGUE = {
    e.key: e
    for e in (
        effect("spring", "spring", 0.5, "a spring <that> pulls back", relative=False),
        effect("drag", "c", 0.3, "more friction", relative=True),
    )
}


def recorded(plant: Plant, cache: Path, name: str, seed: int, **rig: float) -> Record:
    """A rig with other parameters under a sweep, with noise as quoted."""
    time = PERIOD * np.arange(ROWS)
    bare = Record(name, PERIOD, {"u": np.sin((2 + seed) * time * (1 + time))}, {}, {})
    whole = Nominal(replace(plant, parameters=rig), ["f", "v"], cache).record(bare)
    draw = np.random.default_rng(seed)
    sigma = {s.name: s.sigma for s in plant.signals}
    noisy = {n: v + sigma[n] * draw.standard_normal(ROWS) for n, v in whole.signals.items()}
    return replace(whole, signals=noisy)


def diagnosed(plant: Plant, cache: Path, **rig: float) -> Found:
    """Two records fitted, one held out; the rig's parameters are off by `rig`."""
    names = ("sweep", "slow", "other")
    first, second, held = (recorded(plant, cache, n, i, **rig) for i, n in enumerate(names))
    views = sharp_views(plant, ["force", "speed"], cache, [first, second], RULES)
    data = Data((first, second), held)
    return run(Task(plant, views, data, CATALOGUE, cache, notes=("a note with <b>",)), RULES)


@pytest.fixture(scope="session")
def plant(tmp_path_factory: pytest.TempPathFactory, make_cart: Callable[..., Plant]) -> Plant:
    return make_cart(tmp_path_factory.mktemp("model"), "cart <7> & co", 2e-3)


@pytest.fixture(scope="session")
def found(plant: Plant, cache: Path) -> Found:
    """A spring that the catalogue has."""
    return diagnosed(plant, cache, spring=0.8, m=1.01)


@pytest.fixture(scope="session")
def sound(plant: Plant, cache: Path) -> Found:
    """Nothing wrong."""
    return diagnosed(plant, cache, m=1.01, K=1.99)
