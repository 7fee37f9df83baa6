"""What an effect is: a named change of a rig with one size, drawn log-uniformly, and shape
parameters beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pneugantry.truth.parameters import Rig

AXES = ("x", "z")
Parameters = dict[str, float]
# A build changes the rig in place, given axis index (0 when there is none), size and the draws of
# the shape.
Build = Callable[[Rig, int, float, np.random.Generator], Parameters]


@dataclass(frozen=True)
class Form:
    """One functional form of an effect. Size 0 leaves the rig as it was. `known`: the effect is in
    the catalogue.
    """

    effect: str
    form: str
    part: str  # valve, friction, contact, sensors, timing
    axes: tuple[str, ...]  # ("x", "z"), ("z",) or ("",)
    low: float  # smallest size drawn
    high: float  # largest size drawn
    unit: str
    build: Build
    known: bool = True

    def block(self, axis: str) -> str:
        """Block in the words of the gap report: valve_x, friction_z, contact, sensors, timing."""
        return f"{self.part}_{axis}" if self.part in ("valve", "friction") else self.part

    def draw_size(self, rng: np.random.Generator, least: float | None = None) -> float:
        """Log-uniform size between `least` (or `low`) and `high`."""
        return float(
            np.exp(rng.uniform(np.log(self.low if least is None else least), np.log(self.high)))
        )


@dataclass(frozen=True)
class Cause:
    """An effect as drawn: a form, an axis, a size, and the seed of the shape parameters."""

    form: Form
    axis: str
    size: float
    shape_seed: int

    def apply(self, rig: Rig) -> tuple[Rig, Parameters]:
        """(a changed copy of the rig, the parameters as drawn)."""
        out = rig.copy()
        if self.size == 0.0:
            return out, {}
        rng = np.random.default_rng(self.shape_seed)
        parameters = self.form.build(out, AXES.index(self.axis) if self.axis else 0, self.size, rng)
        return out, {name: float(value) for name, value in parameters.items()}

    def entry(self, rig: Rig) -> dict:
        """The cause as a label lists it."""
        return {
            "effect": self.form.effect,
            "axis": self.axis,
            "block": self.form.block(self.axis),
            "form": self.form.form,
            "size": self.size,
            "unit": self.form.unit,
            "parameters": self.apply(rig)[1],
        }


def either(rng: np.random.Generator) -> float:
    """-1 or 1."""
    return 1.0 if rng.random() < 0.5 else -1.0


def relative(rng: np.random.Generator, size: float) -> float:
    """Factor 1 + size or 1 / (1 + size)."""
    return 1.0 + size if rng.random() < 0.5 else 1.0 / (1.0 + size)
