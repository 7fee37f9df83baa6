"""How well fits predict a record that they have not seen.

What a fit leaves of its parameters (their normal distribution) is the prior on the new record,
and so is the rig's scatter of what belongs to one record alone. The evidence of the new record
under them counts whatever a fit has bent to its own records against it.

A fit counts its rows as independent of each other and its plant as right, so that its distribution
is too narrow where the plant is not quite right. By how much is the same for all rivals: by what
lets the best of them predict best. Each by its own would let a wrong one buy itself free.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from pneugantry.engine.fitting.descent import descend
from pneugantry.engine.fitting.fit import Fit, fallen
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.fitting.noise import Noise
from pneugantry.engine.fitting.problem import Parabola, Problem, Solution, newton
from pneugantry.engine.fitting.surveys import ROUGH
from pneugantry.engine.fitting.weighing import Weighing
from pneugantry.engine.hypotheses.hypothesis import Coordinate
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.selection.excess import Excess, excess_of, floors_of
from pneugantry.engine.views.simulation import Cell, Point
from pneugantry.engine.views.view import View

__all__ = ["Prediction", "PredictiveScore", "Predictor", "Unseen"]

WIDER = tuple(float(w) for w in 10 ** (np.arange(7) / 2))  # times a fit's covariance
WIDENED = 4  # at most


@dataclass(frozen=True, eq=False)
class PredictiveScore:
    """What records that a fit has not seen say of it, in -2 log evidence."""

    price: float = 0.0  # prior with Occam's factor
    stretches: Mapping[Cell, Array] = field(default_factory=dict)  # of the likelihood
    sizes: Mapping[Cell, int] = field(default_factory=dict)  # values in each cell

    @property
    def cost(self) -> float:
        return self.price + sum(float(s.sum()) for s in self.stretches.values())

    def beside(self, other: PredictiveScore) -> PredictiveScore:
        """Of two records."""
        stretches, sizes = {**self.stretches, **other.stretches}, {**self.sizes, **other.sizes}
        return PredictiveScore(self.price + other.price, stretches, sizes)

    def fall(self, to: PredictiveScore, rules: Rules) -> float:
        """To another fit's, less its doubt and what is immaterial."""
        sure = fallen(self.stretches, to.stretches, self.sizes, rules)
        return self.price - to.price + sure


@dataclass(frozen=True, eq=False)
class Prediction:
    """A record as a fit has it: where the parameters go, and what that costs."""

    fit: Fit
    wider: float  # times the fit's covariance
    solution: Solution
    normal: Array  # J'WJ and J'Wr there
    gradient: Array
    misfit: float  # -2 log likelihood
    price: float  # prior with Occam's factor

    @property
    def cost(self) -> float:
        return self.misfit + self.price


class Predictor:
    """One record beside fits to others. It keeps what it has found of each fit, for who is compared
    changes. plain: under noise of the sensors' own colour, not of what the first of them leaves.
    """

    def __init__(
        self, fitter: Fitter, views: Sequence[View], record: Record, *, plain: bool = False
    ) -> None:
        self.fitter = Fitter(fitter.plant, views, (record,), fitter.rules)
        self.plain = plain
        self._began: dict[Fit, tuple[Solution, Solution]] = {}
        self._narrow: dict[tuple[Fit, Fit], Prediction] = {}  # by a fit, and who leaves the noise

    def close(self) -> None:
        self.fitter.close()

    def gains(self, fits: Sequence[Fit], base: Fit) -> list[float]:
        """Falls of -2 log evidence from that of a base. The first fit, the likeliest, is held
        against the base and the others against it, each fall less its doubt and what is immaterial:
        where it missed one event, that tells nothing of the others.
        """
        found, of_views = self.predictions([base, *fits])
        before, first, *others = (self._score(f, of_views) for f in found)
        rules = self.fitter.rules
        gain = before.fall(first, rules)
        return [gain, *(gain + first.fall(other, rules) for other in others)]

    def score(self, fit: Fit, of_views: Noise | None = None) -> tuple[PredictiveScore, Noise]:
        """What the record says of one fit; and the noise under which it does, None: what it leaves
        itself.
        """
        (found,), noise_of_views = self.predictions([fit], of_views)
        return self._score(found, noise_of_views), noise_of_views

    def excess(self, fit: Fit, level: float) -> Excess:
        """What a fit leaves in the views of the record, as far as it may move there. level: as of
        `Excess`.
        """
        (found,), _ = self.predictions([fit])
        left = {c: r for c, r in found.solution.residuals.items() if np.isfinite(r).all()}
        there = replace(fit, point=found.solution.point, residuals=left)
        return excess_of(self.fitter, there, floors_of(self.fitter, there), level)

    def told(self, fit: Fit) -> Record:
        """The record with what it has of its own as its views tell it, beside all else as the fit
        has it: without that a replay of its inputs alone would begin elsewhere.
        """
        sim, (record,) = self.fitter.simulation, self.fitter.simulation.records.values()
        wanted = {n.parameter for n in self.fitter.plant.nuisances if n.read}
        if not wanted:
            return record
        self.fitter.prepare([fit.hypothesis])
        point, known = self._known(fit, 1.0)
        pairs = enumerate(point.coordinates)
        free = [i for i, c in pairs if c.record is not None and c.parameter in wanted]
        if not free:
            return record
        own, cells = tuple(point.coordinates[i] for i in free), tuple(sim.cells)
        names = {c.name for c in own}
        start = Point(own, point.theta[free], point.values(record.name))
        problem = Problem(sim, self.fitter.rules, cells, known.of(names, point.theta))
        solution = Solution(start, *sim.linearised(start, cells, names))
        end = descend(problem, solution, None, self.fitter.rules.converged).point
        read = {c.parameter: c.value(t) for c, t in zip(own, end.theta, strict=True)}
        return replace(record, parameters={**record.parameters, **read}, told=frozenset(read))

    def predictions(
        self, fits: Sequence[Fit], of_views: Noise | None = None
    ) -> tuple[list[Prediction], Noise]:
        """Each fit's, equally wide, under the noise that the first leaves, if not another one."""
        self.fitter.prepare([f.hypothesis for f in fits])
        together = self.fitter.simulation.side_by_side
        new = [f for f in fits if f not in self._began]
        self._began |= zip(new, together(self._starts, new), strict=True)
        narrow = self._narrow if of_views is None else {}
        if of_views is None:
            noise_of = self.fitter.noise.plain if self.plain else self.fitter.noise.coloured
            of_views = noise_of(self._began[fits[0]][1].residuals)
        narrowly = partial(self._predicted, 1.0, of_views)
        new = [f for f in fits if (f, fits[0]) not in narrow]
        narrow |= {(f, fits[0]): p for f, p in zip(new, together(narrowly, new), strict=True)}
        found = [narrow[f, fits[0]] for f in fits]
        for _ in range(WIDENED):
            hoped = {w: min(self._on_paper(f, w) for f in found) for w in WIDER}
            wider, least = min(hoped, key=lambda w: hoped[w]), min(f.cost for f in found)
            if hoped[wider] > hoped[found[0].wider] - self.fitter.rules.entry:
                break
            tried = together(partial(self._wider, wider, of_views), found)
            if min(f.cost for f in tried) >= least:
                break
            found = tried
        return found, of_views

    def _starts(self, fit: Fit) -> tuple[Solution, Solution]:
        """As the fit has it, and where that leads under white noise."""
        sim, rules = self.fitter.simulation, self.fitter.rules
        cells = tuple(sim.cells)
        point, known = self._known(fit, 1.0)
        start = Solution(point, *sim.linearised(point, cells, set(known.names)))
        return start, descend(Problem(sim, rules, cells, known), start, None, ROUGH)

    def _predicted(
        self, wider: float, of_views: Noise, fit: Fit, starts: Sequence[Solution] = ()
    ) -> Prediction:
        """starts: where its descents begin, if not where the fit has them."""
        sim, rules = self.fitter.simulation, self.fitter.rules
        _, known = self._known(fit, wider)
        problem, weighing = Problem(sim, rules, tuple(sim.cells), known), Weighing(of_views, rules)

        def misfit(s: Solution) -> float:
            return sum(weighing.costs(s.residuals).values())

        begun = starts or self._began[fit]
        ends = [descend(problem, s, of_views, rules.converged) for s in begun]
        end = min(ends, key=lambda s: misfit(s) + known.cost(s.point.theta))
        normal, gradient = weighing.normal(end.point, end.residuals, end.columns)
        price = _price(end.point.theta, known, normal)
        return Prediction(fit, wider, end, normal, gradient, misfit(end), price)

    def _wider(self, wider: float, of_views: Noise, found: Prediction) -> Prediction:
        """The same with another width, from where it ended."""
        return self._predicted(wider, of_views, found.fit, [found.solution])

    def _on_paper(self, found: Prediction, wider: float) -> float:
        """What it costs with another width, were it as straight as its columns."""
        _, known = self._known(found.fit, wider)
        point, normal, gradient = found.solution.point, found.normal, found.gradient
        theta, square = point.theta, known.square + normal
        slope = known.square @ theta - known.pull + gradient
        end = newton(point, square, slope).theta
        step = end - theta
        misfit = found.misfit + float(step @ (2 * gradient + normal @ step))
        return misfit + _price(end, known, normal)

    def _known(self, fit: Fit, wider: float) -> tuple[Point, Parabola]:
        """Coordinates of the record, where the fit has them, and what the fit says of them."""
        coordinates = self.fitter.coordinates.of(fit.hypothesis, fit.scale)
        told = {p for r in self.fitter.simulation.records.values() for p in r.told}
        at = {c.name: i for i, c in enumerate(fit.point.coordinates)}
        shared = [i for i, c in enumerate(coordinates) if c.name in at]
        index = [at[coordinates[i].name] for i in shared]
        square = np.diag([c.spread**-2.0 for c in coordinates])
        theta = np.array([0.0 for _ in coordinates])
        theta[shared] = fit.point.theta[index]
        square[np.ix_(shared, shared)] = np.linalg.inv(wider * fit.covariance[np.ix_(index, index)])
        for i, c in enumerate(coordinates):
            if c.record is not None and c.parameter not in told:
                theta[i], square[i, i] = _of_one_record(fit, c)
        point = Point(coordinates, theta, fit.hypothesis.settings)
        return point, Parabola(tuple(c.name for c in coordinates), square, square @ theta)

    def _score(self, found: Prediction, of_views: Noise) -> PredictiveScore:
        left = found.solution.residuals
        by_stretch = {c: self.fitter.noise.stretches(c, r, of_views[c]) for c, r in left.items()}
        return PredictiveScore(found.price, by_stretch, {c: r.size for c, r in left.items()})


class Unseen:
    """All records that no fit saw."""

    def __init__(self, fitter: Fitter, views: Sequence[View], records: Sequence[Record]) -> None:
        self._predictors = tuple(Predictor(fitter, views, record) for record in records)

    def close(self) -> None:
        for predictor in self._predictors:
            predictor.close()

    def gains(self, fits: Sequence[Fit], base: Fit) -> list[float]:
        """As of `Predictor`, summed over the records."""
        each = [p.gains(fits, base) for p in self._predictors if fits]
        return [sum(own) for own in zip(*each, strict=True)] if each else [0.0 for _ in fits]

    def told(self, fit: Fit) -> Record | None:
        """As of `Predictor`, of the first record, if any."""
        return self._predictors[0].told(fit) if self._predictors else None

    def excesses(self, fit: Fit, level: float) -> list[Excess]:
        """As of `Predictor`, of each record."""
        return [p.excess(fit, level) for p in self._predictors]


def _price(theta: Array, known: Parabola, normal: Array) -> float:
    """Of what is known, and Occam's factor."""
    change = theta - known.least()
    occam = float(np.linalg.slogdet(known.square + normal)[1])
    occam -= float(np.linalg.slogdet(known.square)[1])
    return float(change @ known.square @ change) + occam


def _of_one_record(fit: Fit, own: Coordinate) -> tuple[float, float]:
    """What the fitted records say of another one's own coordinate: mean and precision of theta."""
    pairs = zip(fit.point.coordinates, fit.point.theta, strict=True)
    found = np.array([t for c, t in pairs if c.parameter == own.parameter and c.record is not None])
    prior = own.spread**2
    if len(found) == 0:
        return 0.0, 1 / prior
    scatter = float(found.var(ddof=1)) if len(found) > 1 else prior
    share = prior / (prior + scatter / len(found))
    spread = scatter * (1 + 1 / len(found))
    return share * float(found.mean()), 1 / min(max(spread, prior / 100), prior)
