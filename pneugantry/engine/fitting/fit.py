"""Fits: a hypothesis at its best point, as frozen data, and what is computed from it alone."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pneugantry.engine.fitting.noise import Noise, doubted
from pneugantry.engine.fitting.problem import Parabola, Solution, Tangent, prior
from pneugantry.engine.hypotheses.hypothesis import Coordinate, Hypothesis
from pneugantry.engine.plant import Array
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.simulation import Cell, Columns, Point, Residuals

__all__ = [
    "Fit",
    "Lead",
    "Race",
    "as_of",
    "borne",
    "deviations",
    "fallen",
    "known_beside",
    "occam",
    "scaled",
    "theta_in",
]


@dataclass(frozen=True, eq=False)
class Lead:
    """How much a hypothesis gains in some cells, and where."""

    gain: float  # of -2 log posterior
    values: Mapping[str, float]  # parameters, of no record in particular


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis fitted."""

    hypothesis: Hypothesis
    point: Point
    residuals: Residuals
    columns: Columns
    noise: Noise
    parabolas: Mapping[str, Parabola]  # -2 log likelihood by view
    covariance: Array  # of theta
    scale: float  # of the rig's tolerance
    stretches: Mapping[Cell, Array]  # -2 log likelihood by stretch of a record
    cost: float  # priors, Occam factor and order of the noise
    whole: bool = False  # all views were fitted together, none left as its parabola
    settled: bool = False  # as of `Solution`
    tangents: Mapping[Cell, Tangent] = field(default_factory=dict)  # as of `Solution`
    left: Mapping[str, Point] = field(default_factory=dict)  # views that are parabolas about these

    @property
    def keys(self) -> tuple[str, ...]:
        return self.hypothesis.keys

    @cached_property
    def evidence(self) -> float:
        """-2 log evidence; smaller is better."""
        return sum(float(s.sum()) for s in self.stretches.values()) + self.cost

    def gain(self, base: Fit, rules: Rules) -> float:
        """Fall of -2 log evidence from `base` to here, that of the likelihood `doubted`: changes
        of a stretch that are immaterial count as none; no more than the evidence itself falls.
        """
        sizes = {c: base.residuals[c].size for c in base.stretches}
        sure = base.cost - self.cost + fallen(base.stretches, self.stretches, sizes, rules)
        return min(sure, base.evidence - self.evidence)

    def sure_fall(self, rival: Fit, temper: float) -> float:
        """Fall of -2 log evidence from a rival with as many effects to here, as a sure one that
        tells as much. Over other stretches the fall would scatter, by how they differ; so does how
        likely either is (`Chances.temper`), whose mean this gives (MacKay 1992, Neural Computation
        4, 720). Neither is the simpler one that is kept until the other surely is better.
        """
        by = [c - self.stretches[cell] for cell, c in rival.stretches.items()]
        falls = np.concatenate(by) if by else np.zeros(0)
        scatter = float(falls @ falls) / (2 * temper) ** 2
        return (rival.evidence - self.evidence) / math.sqrt(1 + math.pi / 8 * scatter)

    def values(self, record: str | None) -> dict[str, float]:
        """Parameters of a record; None: those of no record in particular."""
        return self.point.values(record)

    @property
    def nominal(self) -> dict[str, float]:
        """What every rig has off, as if nothing were; what is of one record is left out."""
        rest = (c for c in self.point.coordinates if not c.effect and c.record is None)
        return {c.parameter: c.value(0.0) for c in rest}

    def held(self, at: Mapping[str, float]) -> Array:
        """Values of theta (coordinates,) where some are given: the others move as the covariance
        tells.
        """
        theta = self.point.theta
        index = [i for i, c in enumerate(self.point.coordinates) if c.name in at]
        if not index:
            return theta
        among = self.covariance[np.ix_(index, index)]
        off = [at[self.point.coordinates[i].name] - theta[i] for i in index]
        return np.asarray(theta + self.covariance[:, index] @ np.linalg.solve(among, off))

    def dropped(self, kept: Collection[str]) -> Array:
        """The same where effects that are not kept are neutral."""
        gone = (c for c in self.point.coordinates if c.name not in kept and c.effect)
        return self.held({c.name: c.none for c in gone})

    def tempered(self, temper: float) -> Fit:
        """The same with a covariance for which evidence counts by a share, as for the decision: two
        values of a parameter are told apart by what tells two effects apart. temper: as of
        `Chances`.
        """
        parabolas = {
            v: Parabola(p.names, p.square / temper, p.pull / temper)
            for v, p in self.parabolas.items()
        }
        return replace(self, covariance=occam(self.point.coordinates, parabolas)[1])

    def sigma(self, name: str) -> float:
        """Standard deviation of a coordinate's theta."""
        index = [c.name for c in self.point.coordinates].index(name)
        return float(np.sqrt(self.covariance[index, index]))


def occam(
    coordinates: Sequence[Coordinate], parabolas: Mapping[str, Parabola]
) -> tuple[float, Array]:
    """Occam factor of what was fitted, as -2 log, and the covariance of theta."""
    own = prior(coordinates)
    normal = sum((p.among(own.names).square for p in parabolas.values()), own.square)
    spread = np.array([c.spread for c in coordinates])
    factor = float(np.linalg.slogdet(normal * np.outer(spread, spread))[1])
    return factor, np.asarray(np.linalg.inv(normal), dtype=np.float64)


def known_beside(
    coordinates: Sequence[Coordinate], base: Fit, touched: Collection[str]
) -> Parabola:
    """The prior, and a base's parabolas of the views that are not touched."""
    known = prior(coordinates)
    for view, parabola in base.parabolas.items():
        if view not in touched:
            known = known.plus(parabola)
    return known


def fallen(
    before: Mapping[Cell, Array],
    after: Mapping[Cell, Array],
    sizes: Mapping[Cell, int],
    rules: Rules,
) -> float:
    """Fall of -2 log likelihood by stretch, less its doubt and what is immaterial in as many rows.
    sizes: values in each cell's residual.
    """
    falls = [np.zeros(0)]
    for cell, cost in before.items():
        fall, least = cost - after[cell], rules.material**2 * sizes[cell] / len(cost)
        falls.append(fall - np.clip(fall, -least, least))
    return doubted(np.concatenate(falls), rules.doubt)


def deviations(point: Point) -> dict[str, float]:
    """Deviations that tolerance is to explain, in spreads of the rig's tolerance."""
    pairs = zip(point.coordinates, point.theta, strict=True)
    return {c.name: float(theta) / c.spread for c, theta in pairs if c.scales}


def borne(point: Point) -> float:
    """-2 log prior of what every rig has somewhat off."""
    pairs = zip(point.coordinates, point.theta, strict=True)
    return sum(float(theta / c.spread) ** 2 for c, theta in pairs if not c.effect)


def scaled(point: Point, scale: float) -> Point:
    """The same under another tolerance of the rig."""
    own = (replace(c, spread=scale) if c.scales else c for c in point.coordinates)
    return replace(point, coordinates=tuple(own))


def theta_in(point: Point, coordinates: Sequence[Coordinate]) -> Array:
    """Theta (coordinates,) of a point in other coordinates; without an effect where it has none."""
    known = {c.name: (c, t) for c, t in zip(point.coordinates, point.theta, strict=True)}
    theta = np.array([c.none for c in coordinates])
    for i, c in enumerate(coordinates):
        if c.name in known:
            old, at = known[c.name]
            theta[i] = at if old == c else c.theta(old.value(at))
    return theta


@dataclass(frozen=True, eq=False)
class Race:
    """What a hypothesis is held against while it is fitted."""

    ahead: Fit  # the best of its rivals so far
    worth: float  # share of what that one falls below the base, which this must have in sight


def as_of(fit: Fit, point: Point) -> Solution:
    """What a fit leaves, in the coordinates of another point."""
    return Solution(point.moved(theta_in(fit.point, point.coordinates)), fit.residuals, {})
