"""A small plant of the tests: an actuator, a mass on it and a spring that is neutral."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from pneugantry.engine.plant import Nuisance, Plant, Signal

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


def _cart(folder: Path, name: str = "cart", speed_sigma: float = 0.01) -> Plant:
    """The cart, its model written to a folder."""
    model = folder / "Toy.mo"
    model.write_text(MODEL, encoding="utf-8")
    signals = (Signal("force", "f", 0.01, "N"), Signal("speed", "v", speed_sigma, "m/s"))
    shares = [Nuisance(p, 0.02, relative=True, scales=True) for p in ("tau", "K", "m", "c")]
    return Plant(name, model, "Toy.Cart", ("u",), signals, {}, tuple(shares), {})


@pytest.fixture(scope="session")
def make_cart() -> Callable[..., Plant]:
    """(folder, name, sigma of the speed): the cart."""
    return _cart


@pytest.fixture(scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("parts")
