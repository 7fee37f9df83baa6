"""A small plant of the tests: an actuator, a mass on it and a spring that is neutral."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pneugantry.engine.catalogue import Effect, Form, Parameter
from pneugantry.engine.plant import Nuisance, Plant, Record, Signal

MODEL = """package Toy
  model Cart
    parameter Real tau = 0.1;
    parameter Real K = 2.0;
    parameter Real m = 1.0;
    parameter Real c = 0.5;
    parameter Real spring = 0.0;
    parameter Real unused = 1.0;
    input Real u;
    output Real f(start = 0.0, fixed = true);
    output Real v(start = 0.0, fixed = true);
    output Real s(start = 0.0, fixed = true);
  equation
    tau * der(f) = K * u - f;
    m * der(v) = f - c * v - spring * s;
    der(s) = v;
  end Cart;
end Toy;
"""
SIGNALS = (Signal("force", "f", 0.01, "N"), Signal("speed", "v", 0.01, "m/s"))


@pytest.fixture(scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("parts")


@pytest.fixture(scope="session")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Plant:
    model = tmp_path_factory.mktemp("model") / "Toy.mo"
    model.write_text(MODEL, encoding="utf-8")
    shares = [Nuisance(p, 0.02, relative=True, scales=True) for p in ("tau", "K", "m", "c")]
    return Plant("cart", model, "Toy.Cart", ("u",), SIGNALS, {}, tuple(shares), {})


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
