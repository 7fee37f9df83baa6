"""Hypotheses and the coordinates in which they are fitted."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from pneugantry.engine.hypotheses.catalogue import Effect, Form, Parameter
from pneugantry.engine.plant import Nuisance

__all__ = ["Coordinate", "Forms", "Hypothesis", "effect_coordinate", "nuisance_coordinate"]

Forms = frozenset[tuple[str, str]]  # effects, each with its form


@dataclass(frozen=True)
class Hypothesis:
    """Effects at work, each in one of its forms. Empty: nuisances alone."""

    effects: tuple[tuple[Effect, Form], ...] = ()

    @property
    def keys(self) -> tuple[str, ...]:
        return tuple(e.key for e, _ in self.effects)

    @property
    def settings(self) -> dict[str, float]:
        return {n: v for _, form in self.effects for n, v in form.settings.items()}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(p for _, form in self.effects for p in form.parameters)

    @property
    def forms(self) -> Forms:
        """Names of its effects, each with that of its form, in whichever order they came."""
        return frozenset((e.key, f.name) for e, f in self.effects)

    def plus(self, effect: Effect, form: Form) -> Hypothesis:
        return Hypothesis((*self.effects, (effect, form)))

    def without(self, key: str) -> Hypothesis:
        return Hypothesis(tuple(x for x in self.effects if x[0].key != key))

    def beyond(self, other: Hypothesis) -> Hypothesis:
        """What only one of both has."""
        apart = self.forms ^ other.forms
        both = (*self.effects, *other.effects)
        return Hypothesis(tuple((e, f) for e, f in both if (e.key, f.name) in apart))


@dataclass(frozen=True)
class Coordinate:
    """One fitted quantity: value = centre + unit * theta, or centre * exp(unit * theta)."""

    parameter: str
    centre: float
    unit: float
    low: float = -math.inf
    high: float = math.inf
    logarithmic: bool = False
    record: str | None = None  # it belongs to this record alone
    effect: bool = False
    spread: float = 1.0  # prior standard deviation of theta
    scales: bool = False  # of a nuisance whose spread grows with the rig's tolerance
    none: float = 0.0  # theta without the effect
    step: float = 0.0  # of theta, between optima that lie side by side; 0: there are none

    @property
    def name(self) -> str:
        return self.parameter if self.record is None else f"{self.parameter}@{self.record}"

    def value(self, theta: float) -> float:
        if self.logarithmic:
            raw = self.centre * math.exp(max(min(self.unit * theta, 50.0), -50.0))
        else:
            raw = self.centre + self.unit * theta
        return min(max(raw, self.low), self.high)

    def theta(self, value: float) -> float:
        value = min(max(value, self.low), self.high)
        if self.logarithmic:
            return math.log(value / self.centre) / self.unit
        return (value - self.centre) / self.unit


def nuisance_coordinate(n: Nuisance, nominal: float, record: str | None) -> Coordinate:
    """`nominal`: the parameter's value without error. What is off by a share is fitted as its
    logarithm: where factors stand for one another (all forces, and the mass), the line along which
    nothing changes is straight then, and one step follows it.
    """
    if n.relative and nominal > 0:
        low = 0.05 * nominal
        return Coordinate(
            n.parameter, nominal, n.sigma, low, logarithmic=True, record=record, scales=n.scales
        )
    unit = n.sigma * abs(nominal) if n.relative else n.sigma
    return Coordinate(n.parameter, nominal, unit, record=record, scales=n.scales)


def effect_coordinate(
    p: Parameter, nominal: float, spread: float, described: bool = False
) -> Coordinate:
    """An effect's parameter; theta is 1 at its usual size, at exp(scale/neutral) times its centre
    if fitted as its logarithm. described: the nominal value is one that a plant's description sets,
    so that it is what holds without the effect, neutral or not.
    """
    made = _effect_coordinate(p, nominal, spread)
    return replace(made, none=made.theta(nominal)) if described else made


def _effect_coordinate(p: Parameter, nominal: float, spread: float) -> Coordinate:
    factor = abs(nominal) if p.relative else 1.0
    centre = nominal if p.relative else p.neutral
    low, high = p.low * factor, p.high * factor
    if p.positive or (p.relative and nominal > 0 and p.low > 0):
        return Coordinate(
            p.name,
            centre,
            p.scale if p.relative else p.scale / p.neutral,
            low,
            high,
            logarithmic=True,
            effect=True,
            spread=spread,
        )
    unit = p.scale * factor
    step = p.step / unit
    return Coordinate(p.name, centre, unit, low, high, effect=True, spread=spread, step=step)
