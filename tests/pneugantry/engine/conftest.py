"""The tests' cart, commands for it and a catalogue."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pneugantry.engine.hypotheses.catalogue import Effect, Form, Parameter
from pneugantry.engine.plant import Plant, Record


@pytest.fixture(scope="session")
def cart(tmp_path_factory: pytest.TempPathFactory, make_cart: Callable[..., Plant]) -> Plant:
    return make_cart(tmp_path_factory.mktemp("model"))


@pytest.fixture(scope="session")
def push() -> Record:
    """Commands alone: a sweep of 4 s."""
    time = 2e-3 * np.arange(2000)
    return Record("push", 2e-3, {"u": np.sin(2 * time * (1 + time))}, {}, {})


def effect(name: str, parameter: str, scale: float, neutral: float = 0.0, **more: bool) -> Effect:
    own = Parameter(parameter, neutral, scale, -1e6, 1e6, **more)
    return Effect(name, "", "cart", name, (Form("form", (own,)),))


@pytest.fixture(scope="session")
def catalogue() -> dict[str, Effect]:
    return {
        "spring": effect("spring", "spring", 0.5),
        "drag": effect("drag", "c", 0.3, relative=True),
        "gain": effect("gain", "K", 0.3, relative=True),
        "bias": effect("bias", "sensors.force.bias", 0.05),
        "nowhere": effect("nowhere", "unused", 0.5, 1.0),
    }
