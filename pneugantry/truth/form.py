"""What an effect is: a named change of a rig with one size, drawn log-uniformly, and shape
parameters beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pneugantry.truth.parameters import CHANNELS, Rig
from pneugantry.truth.sensors import FORCE_BESIDE, PARTNER

AXES = ("x", "z")
Parameters = dict[str, float]
# A build changes the rig in place, given axis index (0 when there is none), size and the draws of
# the shape.
Build = Callable[[Rig, int, float, np.random.Generator], Parameters]


@dataclass(frozen=True)
class Form:
    """One functional form of an effect. Size 0 leaves the rig as it was. `known`: the effect is in
    the catalogue. `regressors`: what the missing term is a function of, with {axis} for the axis;
    a build that draws them itself returns their places as parameters p and q. `formula`: its form,
    "" where it has none.
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
    regressors: tuple[str, ...] = ()
    formula: str = ""

    def blocks(self, axis: str) -> tuple[str, ...]:
        """Blocks in the words of the gap report: valve_x, friction_z, contact, sensors, timing; two
        where both axes have one cause.
        """
        if self.part not in ("valve", "friction"):
            return (self.part,)
        return tuple(f"{self.part}_{each}" for each in (axis or "xz"))

    def block(self, axis: str) -> str:
        """The first of `blocks`."""
        return self.blocks(axis)[0]

    def terms_of(self, axis: str, parameters: Parameters) -> tuple[str, ...]:
        """Regressors by name, of this axis."""
        chosen = [int(parameters[key]) for key in ("p", "q") if key in parameters]
        named = [self.regressors[j] for j in chosen] if chosen else self.regressors
        words = {"axis": axis}
        if "channel" in parameters:
            channel = int(parameters["channel"])
            places = {"own": channel, "partner": PARTNER[channel], "force": FORCE_BESIDE[channel]}
            words |= {key: CHANNELS[place] for key, place in places.items()}
        return tuple(name.format(**words) for name in named)

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
        parameters = self.apply(rig)[1]
        return {
            "effect": self.form.effect,
            "axis": self.axis,
            "known": self.form.known,
            "block": self.form.block(self.axis),
            "blocks": list(self.form.blocks(self.axis)),
            "form": self.form.form,
            "size": self.size,
            "unit": self.form.unit,
            "parameters": parameters,
            "regressors": list(self.form.terms_of(self.axis, parameters)),
            "formula": self.form.formula,
        }


def either(rng: np.random.Generator) -> float:
    """-1 or 1."""
    return 1.0 if rng.random() < 0.5 else -1.0


def relative(rng: np.random.Generator, size: float) -> float:
    """Factor 1 + size or 1 / (1 + size)."""
    return 1.0 + size if rng.random() < 0.5 else 1.0 / (1.0 + size)
