"""Fits hypotheses to records, with priors, and their evidence (Laplace's approximation)."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from pneugantry.engine import noise
from pneugantry.engine.catalogue import Effect, Form, Parameter
from pneugantry.engine.descent import (
    FAILED,
    LARGE,
    Parabola,
    Problem,
    Solution,
    Tangent,
    Weighing,
    descend,
    foretold,
    inside,
    newton,
    prior,
    probed,
    standing,
)
from pneugantry.engine.hypothesis import (
    Coordinate,
    Hypothesis,
    effect_coordinate,
    nuisance_coordinate,
)
from pneugantry.engine.noise import Noise, Whitener, doubted
from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.sensors import PREFIX, neutral
from pneugantry.engine.simulation import Cell, Columns, Point, Residuals, Simulation
from pneugantry.engine.synthetic import changes_of, noisy
from pneugantry.engine.views import View

__all__ = ["FRESH", "Fit", "Fitter", "Lead", "Scouts", "deviations", "fallen"]

DAMPED = (0.0, 1e-3, 1e-2, 0.1, 1.0)  # steps to the least of the views' parabolas that are tried
SIZES = (2.0, 5.0, 10.0)  # of a survey's points, in prior spreads of tolerance
BESIDE = 0.4  # share of these sizes beside an effect, which takes the rest
FRESH = 2  # times as large is a survey where other equations hold: nothing is known of their optima
WINNOWED = 8  # of a survey's points one is simulated over all records
SIDES = 2  # of many starts those from which an effect is sized
SIZED = 4  # steps of an effect's size alone, at most
LEGS = 2  # descents from afar, each from the end of the one before, undamped
FAR_OFF = 3.0  # spreads of the rig's tolerance from which on a deviation is much
OTHER = 0.05  # change of the logarithm of a rig's tolerance from which on it is another
ROUGH = 8.0  # fall of -2 log posterior that ends a descent of which another follows
T = TypeVar("T")
Found = TypeVar("Found")


@dataclass(frozen=True, eq=False)
class _End:
    """Where a view by itself came to."""

    problem: Problem
    solution: Solution
    lowest: float  # of what is known there, too
    contends: bool  # with what is known


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

    @property
    def keys(self) -> tuple[str, ...]:
        return self.hypothesis.keys

    @property
    def evidence(self) -> float:
        """-2 log evidence; smaller is better."""
        return sum(float(s.sum()) for s in self.stretches.values()) + self.cost

    def negligible(self, rules: Rules) -> list[str]:
        """Effects of a size that is none, whatever evidence it brings: where noise enters a view
        with its inputs, the best size of an effect that averages them is not nothing.
        """
        pairs = zip(self.point.coordinates, self.point.theta, strict=True)
        at = {c.parameter: abs(float(t) - c.none) for c, t in pairs if c.effect}
        return [
            e.key
            for e, form in self.hypothesis.effects
            if not form.settings and all(at[p.name] < rules.negligible for p in form.parameters)
        ]

    def gain(self, base: Fit, rules: Rules) -> float:
        """Fall of -2 log evidence from `base` to here, that of the likelihood `doubted`: changes
        of a stretch that are immaterial count as none; no more than the evidence itself falls.
        """
        sizes = {c: base.residuals[c].size for c in base.stretches}
        sure = base.cost - self.cost + fallen(base.stretches, self.stretches, sizes, rules)
        return min(sure, base.evidence - self.evidence)

    def values(self, record: str | None) -> dict[str, float]:
        """Parameters of a record; None: those of no record in particular."""
        return self.point.values(record)

    def dropped(self, kept: Collection[str]) -> Array:
        """Values of theta (coordinates,) where effects that are not kept are neutral: the others
        move as the covariance tells.
        """
        theta = self.point.theta
        gone = [i for i, c in enumerate(self.point.coordinates) if c.name not in kept and c.effect]
        if not gone:
            return theta
        among = self.covariance[np.ix_(gone, gone)]
        off = theta[gone] - [self.point.coordinates[i].none for i in gone]
        return np.asarray(theta - self.covariance[:, gone] @ np.linalg.solve(among, off))

    def sigma(self, name: str) -> float:
        """Standard deviation of a coordinate's theta."""
        index = [c.name for c in self.point.coordinates].index(name)
        return float(np.sqrt(self.covariance[index, index]))


class Fitter:
    """One plant, its views and its records."""

    def __init__(
        self,
        plant: Plant,
        views: Sequence[View],
        records: Sequence[Record],
        rules: Rules,
        level: float = 1.0,
    ) -> None:
        """level: how much noisier the rig's sensors are than quoted, until a fit has told."""
        self.plant, self.rules = plant, rules
        self.simulation = Simulation(views, records, rules)
        self.nominal = _nominal(plant, views)
        self._floors: dict[Cell, tuple[Whitener, ...]] = {}
        self._erring = {cell: self._quoted_errors(cell) for cell in self.simulation.cells}
        self.level = level

    def close(self) -> None:
        self.simulation.close()

    # -- coordinates

    def neutral(self, name: str) -> float:
        """Value of a parameter without any effect."""
        return neutral(name) if name.startswith(PREFIX) else self.nominal.get(name, 0.0)

    def of_effect(self, p: Parameter) -> Coordinate:
        """The coordinate of an effect's parameter."""
        described = p.name in self.plant.parameters
        return effect_coordinate(p, self.neutral(p.name), self.rules.effect_prior, described)

    def readable(self, form: Form) -> bool:
        """Whether some view reads a parameter of a form."""
        return any(self.simulation.reads(p.name) for p in form.parameters)

    def touched(self, hypothesis: Hypothesis) -> list[Cell]:
        """Cells whose view reads anything of a hypothesis' effects."""
        read = {view for _, form in hypothesis.effects for view in self.readers(form)}
        return [c for c in self.simulation.cells if c[0] in read]

    def readers(self, form: Form) -> set[str]:
        """Views that read anything of a form."""
        names = {p.name for p in form.parameters} | set(form.settings)
        views = self.simulation.views
        return {c[0] for c in self.simulation.cells if any(map(views[c[0]].depends_on, names))}

    def coordinates(self, hypothesis: Hypothesis, scale: float) -> tuple[Coordinate, ...]:
        """Nuisances, then effects; an effect's parameter is no nuisance besides, and one that two
        effects share is one.
        """
        own = {p.name: p for p in reversed(hypothesis.parameters)}
        effects = [self.of_effect(p) for p in own.values()]
        taken = {c.parameter for c in effects}
        rest = [c for c in self.nuisances() if c.parameter not in taken]
        return (*(replace(c, spread=scale) if c.scales else c for c in rest), *effects)

    def nuisances(self) -> list[Coordinate]:
        """Coordinates of what every rig has somewhat off."""
        made = []
        for n in self.plant.nuisances:
            if not n.per_record:
                if self.simulation.reads(n.parameter):
                    made.append(nuisance_coordinate(n, self.neutral(n.parameter), None))
                continue
            for name, record in self.simulation.records.items():
                if n.parameter in record.parameters and self.simulation.reads(n.parameter, name):
                    made.append(nuisance_coordinate(n, record.parameters[n.parameter], name))
        return made

    def loud(self, fit: Fit) -> list[str]:
        """Views that tolerance or its effects move, in which a fit leaves more than noise, or not
        only because it has bent a parameter that they read far beyond tolerance.
        """
        known, bent = prior(fit.point.coordinates), self.bent(fit)
        solution = Solution(fit.point, fit.residuals, {})
        parts = {v: _only(solution, v) for v in dict.fromkeys(c[0] for c in self.simulation.cells)}
        return [
            v
            for v, p in parts.items()
            if v in bent or not self._quiet(self._problem(p.residuals, known), p)
        ]

    @staticmethod
    def far_off(fit: Fit) -> set[str]:
        """Coordinates that a fit has bent far beyond tolerance."""
        return {n for n, off in deviations(fit.point).items() if abs(off) > FAR_OFF}

    def bent(self, fit: Fit) -> set[str]:
        """Views that read a parameter that a fit has bent far beyond tolerance."""
        far, views = self.far_off(fit), self.simulation.views
        return {c[0] for c in self.simulation.cells if any(map(views[c[0]].depends_on, far))}

    def afresh(self, base: Fit) -> Fit:
        """A base whose nuisances are back at their nominal values, linearised there; those of one
        record stay. Of a fit it has no more than that.
        """
        theta = base.point.theta.copy()
        for i, c in enumerate(base.point.coordinates):
            if not c.effect and c.record is None:
                theta[i] = 0.0
        point, cells = base.point.moved(theta), tuple(self.simulation.cells)
        names = {c.name for c in point.coordinates}
        residuals, columns = self.simulation.linearised(point, cells, names, fine=False)
        bare = replace(base, settled=False, tangents={})
        return replace(bare, point=point, residuals=residuals, columns=columns)

    def unseen(self, fit: Fit) -> list[Coordinate]:
        """Of what every rig has off and no record shows: it keeps its prior."""
        known = {c.parameter for c in fit.point.coordinates}
        left = [n for n in self.plant.nuisances if not n.per_record and n.parameter not in known]
        made = [nuisance_coordinate(n, self.neutral(n.parameter), None) for n in left]
        return [replace(c, spread=fit.scale) if c.scales else c for c in made]

    # -- fits

    def prepare(self, hypotheses: Sequence[Hypothesis]) -> None:
        """Before many simulations of them."""
        self.simulation.prepare([(self._moving(h.parameters), h.settings) for h in hypotheses])

    def prepare_any(self, base: Hypothesis, effects: Collection[Effect]) -> None:
        """Before simulations of a hypothesis with any of the effects that keep its equations."""
        forms = [f for e in effects for f in e.forms if not f.settings]
        every = (*base.parameters, *(p for f in forms for p in f.parameters))
        self.simulation.prepare([(self._moving(every), base.settings)])

    def together(
        self, call: Callable[[T], Found], values: Sequence[T], hypotheses: Sequence[Hypothesis]
    ) -> list[Found]:
        """What a call makes of each value, in their order, side by side. hypotheses: that the calls
        simulate; all are prepared first, for what has been decides which part a run takes.
        """
        self.prepare(hypotheses)
        return self.simulation.side_by_side(call, values)

    def _moving(self, parameters: Iterable[Parameter]) -> set[str]:
        """Of effects, and what every rig has somewhat off."""
        return {*(p.name for p in parameters), *(n.parameter for n in self.plant.nuisances)}

    def null(self) -> Fit:
        """Nuisances alone, under the tolerance that they show; not `again` thoroughly: few rigs
        need it.
        """
        coordinates = self.coordinates(Hypothesis(), self.rules.tolerance)
        self.prepare([Hypothesis()])
        start = Point(coordinates, np.zeros(len(coordinates)), {})
        known, cells = prior(coordinates), tuple(self.simulation.cells)
        residuals, columns = self.simulation.linearised(start, cells, set(known.names), fine=False)
        solution = self._by_view([Solution(start, residuals, columns)], known, cells)
        solution = self._jointly(solution, known, cells)
        scale = self._tolerance(solution.point)
        point = _scaled(solution.point, scale)
        known = prior(point.coordinates)
        solution = replace(solution, point=point, settled=False)
        solution = self._renewed(solution, known, cells, 1)
        return self._finished(Hypothesis(), solution, known, scale)

    def _tolerance(self, point: Point) -> float:
        """Spread of a rig's deviations, in units of what its description gives: that is worth
        `tolerance_weight` parameters, and one that stands out counts as three times it.
        """
        theta = np.array(
            [t for c, t in zip(point.coordinates, point.theta, strict=True) if c.scales]
        )
        weight = self.rules.tolerance_weight
        squares = float(np.minimum(theta**2, 9.0).sum())
        return math.sqrt((weight + squares) / (weight + len(theta)))

    def explore(
        self,
        hypothesis: Hypothesis,
        base: Fit,
        starts: Sequence[Mapping[str, float]] = (),
        ahead: Fit | None = None,
        thorough: bool = True,
        fresh: int = FRESH,
    ) -> Fit:
        """A hypothesis near `base`: views that its effects do not touch are their parabolas there.
        starts: values of effect parameters to start from, too. ahead: the best of its rivals so
        far, behind which less is tried. thorough: views above the noise are surveyed, too; they
        always are under other equations than the base's, by surveys `fresh` times as large.
        """
        own, known, cells = self._beside_base(hypothesis, base)
        firsts = self._firsts(hypothesis, base, starts, cells)
        another = hypothesis.settings and hypothesis.settings != base.hypothesis.settings
        rivals = [_as_of(f, own) for f in (base, ahead) if f is not None]
        share = fresh if another else int(thorough)
        solution = self._by_view(firsts, known, cells, rivals, share)
        best = min(firsts, key=lambda s: self._beside(s, base, known, cells))
        before, after = (self._beside(s, base, known, cells) for s in (best, solution))
        if after > before:  # where the views lead apart is worse than where one of them stood
            solution, after = best, before
        if after - self._beside(base, base, known, cells) < self.rules.hopeless:
            solution = self._jointly(solution, known, cells)
        return self._finished(hypothesis, solution, known, base.scale, base)

    def _firsts(
        self,
        hypothesis: Hypothesis,
        base: Fit,
        starts: Sequence[Mapping[str, float]],
        cells: Sequence[Cell],
    ) -> list[Solution]:
        """Where a hypothesis starts in some cells: from the base, and from values besides."""
        coordinates = self.coordinates(hypothesis, base.scale)
        columns = {k: c for k, c in base.columns.items() if k[0] in cells}
        wanted = {c.name for c in coordinates if c.effect}
        if hypothesis.settings != base.hypothesis.settings:  # other equations, other columns
            columns, wanted = {}, {c.name for c in coordinates}

        def first(values: Mapping[str, float]) -> Solution:
            point = self._first(hypothesis, base, values)
            residuals, own = self.simulation.linearised(point, cells, wanted)
            return Solution(point, residuals, {**columns, **own})

        return self.simulation.side_by_side(first, ({}, *starts))

    def from_afar(
        self, hypothesis: Hypothesis, base: Fit, starts: Sequence[Mapping[str, float]]
    ) -> Fit:
        """A hypothesis from values far from the base, the best of its starts; views as of
        `explore`. Its effects are sized first. Then all descend together under white noise as
        large as what they leave: the widest basin.
        """
        _, known, cells = self._beside_base(hypothesis, base)
        problem = self._problem(cells, known)

        def down(values: Mapping[str, float]) -> Solution:
            point = self._sized(self._first(hypothesis, base, values), known, cells)
            residuals, columns = self.simulation.linearised(point, cells, set(known.names))
            solution = Solution(point, residuals, columns)
            for _ in range(LEGS):
                solution = descend(problem, solution, None, ROUGH)
            return solution

        ends = self.simulation.side_by_side(down, starts)
        solution = min(ends, key=lambda s: standing(problem, s))
        if standing(problem, solution) < standing(problem, _as_of(base, solution.point)):
            solution = self._jointly(solution, known, cells)
        return self._finished(hypothesis, solution, known, base.scale, base)

    def ahead(
        self,
        hypothesis: Hypothesis,
        base: Fit,
        starts: Sequence[Mapping[str, float]],
        cells: Sequence[Cell],
    ) -> Lead:
        """How far below a base a hypothesis comes in some cells, those of each view together and by
        themselves, from values far from it, the best of them once its effects are sized: -2 log
        posterior under white noise of the residuals' own size; and where it stands then.
        """
        _, known, touched = self._beside_base(hypothesis, base)
        points, best, total = [self._first(hypothesis, base, s) for s in starts], -math.inf, 0.0
        values: Mapping[str, float] = {}
        for view in dict.fromkeys(c[0] for c in cells):
            own = [c for c in cells if c[0] == view and c in touched]
            if not own:
                continue
            problem = self._problem(own, known, fine=False)
            level = standing(problem, _as_of(base, points[0]))
            few = [s.point for s in self._ranked(problem, points, own)[:SIDES]]
            sized = self._ranked(problem, [self._sized(p, known, own) for p in few], own)
            end = self._raced(problem, self._coarsely(problem, sized[0].point), math.inf)
            gain = level - standing(problem, end)
            total += gain
            if gain > best:
                best, values = gain, end.point.values(None)
        return Lead(total, values)

    def _sized(self, start: Point, known: Parabola, cells: Sequence[Cell]) -> Point:
        """Effects, and what is of one record, fitted beside tolerance as it is: free to move, that
        would make up for an effect of which the size is not known yet.
        """
        free = [i for i, c in enumerate(start.coordinates) if c.effect or c.record is not None]
        own = tuple(start.coordinates[i] for i in free)
        point = Point(own, start.theta[free], start.values(None))
        names = {c.name for c in own}
        problem = self._problem(cells, known.of(names, start.theta), fine=False)
        found = self.simulation.linearised(point, cells, names, fine=False)
        end = descend(
            problem, Solution(point, *found), None, ROUGH, lambda steps, at: steps >= SIZED
        )
        theta = start.theta.copy()
        theta[free] = end.point.theta
        return start.moved(theta)

    def _beside_base(
        self, hypothesis: Hypothesis, base: Fit
    ) -> tuple[Point, Parabola, tuple[Cell, ...]]:
        """Where a hypothesis starts from a base, what is known of it besides, and the cells that
        effects touch in which the two differ; the others are their parabolas at the base.
        """
        own = self._first(hypothesis, base, {})
        self.prepare([hypothesis])
        touched = set(self.touched(hypothesis.beyond(base.hypothesis)))
        cells = tuple(c for c in self.simulation.cells if c in touched)
        return own, _known_beside(own.coordinates, base, {c[0] for c in cells}), cells

    def _beside(
        self, found: Solution | Fit, base: Fit, known: Parabola, cells: Sequence[Cell]
    ) -> float:
        """-2 log posterior of some cells under the noise that a base has."""
        costs = Weighing(base.noise, self.rules).costs({c: found.residuals[c] for c in cells})
        among = {c.name: t for c, t in zip(found.point.coordinates, found.point.theta, strict=True)}
        theta = np.array([among.get(n, 0.0) for n in known.names])
        return sum(costs.values()) + known.cost(theta)

    def again(self, fit: Fit, thorough: bool = False) -> Fit:
        """The same hypothesis from where a fit ended, all views together. thorough: points about
        the end are tried, too; they always are where it is worse than the fit had it: a little of
        what views share has moved, and a view that was left as it stood meets an event otherwise.
        """
        cells = tuple(self.simulation.cells)
        whole = prior(fit.point.coordinates)
        residuals = fit.residuals
        if not fit.settled:
            residuals = self.simulation.residuals(fit.point, cells)
        solution = Solution(fit.point, residuals, fit.columns, fit.settled, fit.tangents)
        made = self._ended(
            fit, (self._polished if thorough else self._jointly)(solution, whole, cells)
        )
        if thorough or made.evidence < fit.evidence + self.rules.entry:
            return made
        at = Solution(made.point, made.residuals, made.columns, tangents=made.tangents)
        return min(
            made, self._ended(fit, self._polished(at, whole, cells)), key=lambda f: f.evidence
        )

    def _ended(self, fit: Fit, solution: Solution) -> Fit:
        """The hypothesis of a fit where all views together have led."""
        whole, cells = prior(fit.point.coordinates), tuple(self.simulation.cells)
        solution = self._renewed(solution, whole, cells, self.rules.renewals)
        return self._finished(fit.hypothesis, solution, whole, fit.scale)

    def tolerance_of(self, fit: Fit) -> float:
        """Spread of the rig's tolerance by a fit; what it had where that is hardly another."""
        scale = self._tolerance(fit.point)
        return scale if abs(math.log(scale / fit.scale)) > OTHER else fit.scale

    def rescaled(self, fit: Fit, scale: float) -> Fit:
        """A fit under another tolerance, from where it ended."""
        if scale == fit.scale:
            return fit
        cells = tuple(self.simulation.cells)
        point = _scaled(fit.point, scale)
        whole = prior(point.coordinates)
        solution = Solution(point, fit.residuals, fit.columns, tangents=fit.tangents)
        solution = self._renewed(solution, whole, cells, self.rules.renewals)
        return self._finished(fit.hypothesis, solution, whole, scale)

    def under(self, fit: Fit, scale: float) -> Fit:
        """The same where it ended: what another tolerance makes of its evidence."""
        if scale == fit.scale:
            return fit
        points = fit.point, _scaled(fit.point, scale)
        bends = [sum(x**2 for x in deviations(p).values()) for p in points]
        (before, _), (after, covariance) = (_occam(p.coordinates, fit.parabolas) for p in points)
        cost = fit.cost + self.rules.tolerated * (bends[1] - bends[0]) + after - before
        return replace(fit, point=points[1], scale=scale, covariance=covariance, cost=cost)

    def _polished(self, start: Solution, known: Parabola, cells: Sequence[Cell]) -> Solution:
        """Jointly, and again from the best point about where that ends, until none is better.

        An event that a simulation misses (a break-away) shows in no derivative.
        """
        solution = self._jointly(start, known, cells)
        for _ in range(self.rules.turns):
            colour = self.coloured(solution.residuals)
            turned = probed(self._problem(cells, known), solution, colour)
            if turned is None:
                break
            turned = self._descended(turned, known, cells)
            fall = self._cost(solution, known, colour) - self._cost(turned, known, colour)
            if fall > 0:
                solution = turned
            if fall < self.rules.entry:
                break
        return solution

    def _cost(self, solution: Solution, known: Parabola, colour: Noise) -> float:
        costs = Weighing(colour, self.rules).costs(solution.residuals)
        return sum(costs.values()) + known.cost(solution.point.theta)

    def _by_view(
        self,
        starts: Sequence[Solution],
        known: Parabola,
        cells: Sequence[Cell],
        rivals: Sequence[Solution] = (),
        share: int = 1,
    ) -> Solution:
        """Each view by itself, by steps that look over events, then where they agree best. rivals:
        solutions that are known; a descent far behind the first is given up, what ends hopelessly
        behind any is not surveyed. Where none is known, ends are made exact. share: of surveys, how
        much larger they are; 0: none.
        """
        start = starts[0]
        views = [
            view
            for view in dict.fromkeys(c[0] for c in cells)
            if any(k[0][0] == view for k in start.columns)
        ]
        ends = self._ends(starts, known, cells, rivals, views)
        if not rivals:
            self.level = self._loudness([e.solution.residuals for e in ends])

        def ended(end: _End) -> Solution:
            solution = end.solution
            if share > 1 or (share == 1 and end.contends):
                lowest = end.lowest if rivals else None
                solution = self._surveyed(end.problem, starts, solution, lowest, share)
            return solution if rivals else self._finely(end.problem, solution)

        return self._agreed(start, self.simulation.side_by_side(ended, ends), known, cells)

    def _finely(self, problem: Problem, end: Solution) -> Solution:
        """A view's end, along the valleys that columns which look over events do not show."""
        start = self._with_columns(end, problem.prior, problem.cells)
        return descend(replace(problem, fine=True), start, None, ROUGH)

    def _agreed(
        self, start: Solution, ends: Sequence[Solution], known: Parabola, cells: Sequence[Cell]
    ) -> Solution:
        """The best of some points between the ends of single views: each coordinate as the view has
        it that knows it best, and steps from there towards the least of the sum of the parabolas.
        The whole step may follow valleys of several views beyond where these are straight.
        """
        total, columns, tangents = known, dict(start.columns), dict(start.tangents)
        at, most = start.point.theta.copy(), np.zeros(len(known.names))
        for end in ends:
            parabola = self._parabola(end, self.coloured(end.residuals)).among(known.names)
            sure = np.diag(parabola.square)
            at = np.where(sure > most, end.point.theta, at)
            most = np.maximum(sure, most)
            total = total.plus(parabola)
            columns |= end.columns
            tangents |= end.tangents
        between = start.point.moved(at)
        slope, scale = total.square @ at - total.pull, np.diag(np.diag(total.square))
        points = [between, *(newton(between, total.square + d * scale, slope) for d in DAMPED)]
        problem = self._problem(cells, known)
        best = self._ranked(problem, points, cells)[0]
        if standing(problem, best) >= FAILED:
            return start
        return Solution(best.point, best.residuals, columns, tangents=tangents)

    def _ends(
        self,
        starts: Sequence[Solution],
        known: Parabola,
        cells: Sequence[Cell],
        rivals: Sequence[Solution],
        views: Sequence[str],
    ) -> list[_End]:
        """Of each view by itself the least that a descent from a start comes to. All views descend
        from the first at once, then from the others, which race what that came to.
        """
        problems = {
            v: self._problem([c for c in cells if c[0] == v], known, fine=False) for v in views
        }
        bars = {v: [standing(p, _only(r, v)) for r in rivals] for v, p in problems.items()}

        def down(task: tuple[str, Solution, float]) -> tuple[float, Solution]:
            view, start, bar = task
            end = self._raced(problems[view], _only(start, view), bar)
            return standing(problems[view], end), end

        base = {v: bars[v][0] if rivals else math.inf for v in views}
        tasks = [(v, starts[0], base[v]) for v in views]
        first = dict(zip(views, self.simulation.side_by_side(down, tasks), strict=True))
        tasks = [(v, s, min(base[v], first[v][0])) for v in views for s in starts[1:]]
        others = self.simulation.side_by_side(down, tasks)
        found = []
        for v in views:
            own = [first[v], *(end for t, end in zip(tasks, others, strict=True) if t[0] == v)]
            least, solution = min(own, key=lambda e: e[0])
            contends = least - min(bars[v], default=math.inf) < self.rules.hopeless
            found.append(_End(problems[v], solution, min(base[v], least), contends))
        return found

    def _loudness(self, of_views: Sequence[Residuals]) -> float:
        """How much noisier the rig's sensors are than quoted: that of most of them. A coarse
        converter at rest is no quiet sensor.
        """
        sizes = [
            noise.spread([w])
            for residuals in of_views
            for w in self._white(residuals, {c: self.floor(c) for c in residuals}).values()
        ]
        least = 1.0 if any(s.step for s in self.plant.signals) else self.rules.quietest
        return float(np.clip(np.median(sizes or [1.0]), least, noise.NOISIEST))

    def _raced(self, problem: Problem, start: Solution, bar: float) -> Solution:
        """A view's descent by steps that look over events, given up where it is farther above a
        bar than `patience` falls like its last.
        """
        last = math.inf

        def behind(steps: int, solution: Solution) -> bool:
            nonlocal last
            before, last = last, standing(problem, solution)
            return steps > 1 and last - bar > self.rules.patience * (before - last)

        return descend(problem, start, None, ROUGH, behind)

    def _surveyed(
        self,
        problem: Problem,
        starts: Sequence[Solution],
        found: Solution,
        bar: float | None,
        share: int = 1,
    ) -> Solution:
        """The least of a view's descents: found, and those from the best of many points, where it
        stands above the noise: stick-slip has many optima. Points are tried in parts: once a
        descent from afar comes to the same end, there is but one. Where something is known already
        (a bar), the record that is met worst tells, by itself, which descents are worth the others.
        """
        best, least = found, standing(problem, found)
        if not self.rules.followed or self._quiet(problem, found):
            return best
        worst = self._worst(problem, starts[0])
        alone = self._problem([worst], problem.prior, fine=False)
        near = math.inf
        if bar is not None and len(problem.cells) > 1:
            near = standing(alone, self._raced(alone, _in_cell(found, worst), math.inf))
        for points in self._scattered(problem, starts, share):
            start = self._foremost(problem, points, worst).point
            if near < math.inf:
                there = self._raced(alone, self._coarsely(alone, start), near)
                ahead = near - standing(alone, there)
                if abs(ahead) < ROUGH:
                    break
                if ahead < 0:
                    continue
                start = there.point
            lowest = least if bar is None else min(bar, least)
            other = self._raced(problem, self._coarsely(problem, start), lowest)
            before, cost = least, standing(problem, other)
            if cost < least:
                best, least = other, cost
            if abs(cost - before) < ROUGH:
                break
        return best

    def _coarsely(self, problem: Problem, point: Point) -> Solution:
        """A point with residuals, and columns that look over events."""
        names = set(problem.prior.names)
        found = self.simulation.linearised(point, problem.cells, names, fine=False)
        return Solution(point, *found)

    def _scattered(
        self, problem: Problem, starts: Sequence[Solution], share: int
    ) -> list[list[Point]]:
        """Points drawn over a view's tolerance, and over effects about where they start, in as many
        parts as are to be followed.
        """
        count, draw = share * self.rules.survey, np.random.default_rng(0)
        among = [(i, c) for i, c in enumerate(starts[0].point.coordinates) if self._in(c, problem)]
        tolerance, effects = [i for i, c in among if c.scales], [i for i, c in among if c.effect]
        theta = np.array([starts[k % len(starts)].point.theta for k in range(count)])
        size = np.resize(np.array(SIZES), count)[:, None] * (BESIDE if effects else 1.0)
        theta[:, tolerance] = size * draw.standard_normal((count, len(tolerance)))
        theta[:, effects] += draw.standard_normal((count, len(effects)))
        points = [inside(starts[0].point.moved(t)) for t in theta]
        parts = np.array_split(np.arange(count), share * self.rules.followed)
        return [[points[i] for i in part] for part in parts]

    @staticmethod
    def _worst(problem: Problem, at: Solution) -> Cell:
        """The cell whose record is met worst."""
        return max(problem.cells, key=lambda c: float(np.nansum(at.residuals[c] ** 2)))

    def _foremost(self, problem: Problem, points: Sequence[Point], worst: Cell) -> Solution:
        """The best of some points, without columns. One cell tells which of them are simulated in
        the others.
        """
        few = self._ranked(problem, points, [worst])[: max(len(points) // WINNOWED, 1)]
        return self._ranked(problem, [s.point for s in few], problem.cells)[0]

    def _ranked(
        self, problem: Problem, points: Sequence[Point], cells: Sequence[Cell]
    ) -> list[Solution]:
        """Points by how they stand in some cells, the best first; without columns."""
        runs = self.simulation.run({c: [p.values(c[1]) for p in points] for c in cells})
        made = [
            Solution(point, {c: own[i] for c, own in runs.items()}, {})
            for i, point in enumerate(points)
        ]
        return sorted(made, key=lambda s: standing(problem, s))

    def _quiet(self, problem: Problem, found: Solution) -> bool:
        """Whether a view's residuals are no more than the sensors' noise, in each record and in
        all, or nothing that is off by a share or an effect's moves them.
        """
        if not any(c.scales or c.effect for c in found.point.coordinates if self._in(c, problem)):
            return True
        white = self._white(found.residuals, {c: self.floor(c) for c in problem.cells})
        signals = [[w for (_, k), w in white.items() if k == c] for c in {k for _, k in white}]
        most, rules = self.rules.quiet * self.level, self.rules
        return not any(
            noise.surely_above(most, rows, rules.doubt)
            for rows in (*signals, *([w] for w in white.values()))
        ) and all(
            noise.loss(w[np.abs(w) > LARGE] / self.level, rules.tails).sum() < rules.hopeless
            for w in white.values()
        )

    def _by_stretch(self, cell: Cell, terms: Array) -> Array:
        """Sums of a cell's terms (rows,) by stretch of its record."""
        parts = np.array_split(terms, self.pieces(cell, len(terms)))
        return np.array([p.sum() for p in parts])

    def pieces(self, cell: Cell, rows: int) -> int:
        """Stretches into which so many rows of a cell are parted, `Rules.block` long."""
        view, record = self.simulation.views[cell[0]], self.simulation.records[cell[1]]
        length = max(4, round(self.rules.block / (record.period * view.decimation)))
        return max(1, rows // length)

    def floor(self, cell: Cell) -> tuple[Whitener, ...]:
        """Colour and size of the sensors' quoted noise, brought through a view once."""
        if cell not in self._floors:
            view, record = self.simulation.views[cell[0]], self.simulation.records[cell[1]]
            values: dict[str, float] = dict(record.parameters)
            changes = changes_of(view, record, [noisy(self.plant, record)], values)
            self._floors[cell] = tuple(
                known or noise.coloured([c[:, i] for c in changes], sigma, math.inf)
                for i, (sigma, known) in enumerate(zip(view.sigmas, self.erring(cell), strict=True))
            )
        return self._floors[cell]

    def erring(self, cell: Cell) -> tuple[Whitener | None, ...]:
        """Of each signal of a cell's view: noise with the quoted error of a right model; None where
        none is quoted.
        """
        return self._erring[cell]

    def erring_in(self, view: str) -> tuple[Whitener | None, ...]:
        """The same in a view's first record."""
        none = (None,) * len(self.simulation.views[view].signals)
        return next((own for cell, own in self._erring.items() if cell[0] == view), none)

    def _quoted_errors(self, cell: Cell) -> tuple[Whitener | None, ...]:
        view, record = self.simulation.views[cell[0]], self.simulation.records[cell[1]]
        row = record.period * view.decimation
        signals = {s.name: s for s in self.plant.signals}
        return tuple(
            noise.quoted(sigma, own.error, own.lasting / row) if own and own.error > 0 else None
            for sigma, own in zip(view.sigmas, map(signals.get, view.signals), strict=True)
        )

    @staticmethod
    def _white(residuals: Residuals, floors: Noise) -> dict[tuple[Cell, int], Array]:
        """Residuals in units of the noise that is brought through, whitened by its colour."""
        return {
            (cell, c): w(r[:, c])
            for cell, r in residuals.items()
            if np.isfinite(r).all()
            for c, w in enumerate(floors[cell])
        }

    def plain(self, residuals: Residuals) -> Noise:
        """Noise of the colour that the sensors' has behind the views, in each view of its
        residuals' own size: what is missing is no noise.
        """
        floors = {c: self.floor(c) for c in residuals}
        white, found = self._white(residuals, floors), {}
        for cell, own in floors.items():
            rows = [
                [w for (other, k), w in white.items() if (other[0], k) == (cell[0], c)]
                for c in range(len(own))
            ]
            sizes = [max(noise.spread(r), 1.0) for r in rows]
            found[cell] = tuple(
                Whitener(w.coefficients, w.sigma * size) for w, size in zip(own, sizes, strict=True)
            )
        return found

    def _in(self, c: Coordinate, problem: Problem) -> bool:
        return any(self.simulation.in_cell(c, cell) for cell in problem.cells)

    def _jointly(self, start: Solution, known: Parabola, cells: Sequence[Cell]) -> Solution:
        """All views together, from new columns on."""
        if start.settled:
            return start
        return self._descended(self._with_columns(start, known, cells), known, cells)

    def _descended(self, start: Solution, known: Parabola, cells: Sequence[Cell]) -> Solution:
        """All views together, under the colour that their residuals have."""
        problem, solution = self._problem(cells, known), start
        for fall in (ROUGH, self.rules.converged):
            before = solution.point
            solution = descend(problem, solution, self.coloured(solution.residuals), fall)
            if solution.point is before:
                break
        return solution

    def _renewed(
        self, start: Solution, known: Parabola, cells: Sequence[Cell], times: int
    ) -> Solution:
        """Converged with columns of where it is, on which score tests and the covariance rest; the
        noise's colour follows. times: at most.
        """
        if start.settled:
            return start
        solution = self._with_columns(start, known, cells)
        for _ in range(times):
            colour, at = self.coloured(solution.residuals), solution
            solution = descend(self._problem(cells, known), at, colour, self.rules.converged)
            if solution.point is at.point:
                return replace(solution, settled=True)
            solution = self._with_columns(solution, known, cells)
            before, after = (self._cost(s, known, colour) for s in (at, solution))
            if before - after < self.rules.entry:
                break
        return solution

    def _with_columns(self, at: Solution, known: Parabola, cells: Sequence[Cell]) -> Solution:
        """With columns by small steps in some cells. Those serve on that foretell from where they
        were made what is there, to less than what all cells together may miss of a fall.
        """
        least = self.rules.converged / len(cells)
        old = [c for c in cells if not self._missed(at, c) < least]
        columns = self.simulation.columns(at.point, at.residuals, old, set(known.names))
        return at.with_columns(columns, old, fine=True)

    def _missed(self, at: Solution, cell: Cell) -> float:
        """By how much the columns of a cell miss what is there, squared in noise levels."""
        tangent = at.tangents.get(cell)
        own = [c for c in at.point.coordinates if self.simulation.in_cell(c, cell)]
        if tangent is None or any((cell, c.name) not in at.columns for c in own):
            return math.inf
        moved = at.point.theta - _told(tangent.point, at.point.coordinates)
        there = replace(at, residuals={cell: tangent.residual})
        missed = at.residuals[cell] - foretold(there, [cell], moved)[cell]
        colour = self._colour(cell, at.residuals[cell])
        white = np.concatenate([w(missed[:, i]) for i, w in enumerate(colour)])
        return float(white @ white)

    def _problem(self, cells: Collection[Cell], known: Parabola, fine: bool = True) -> Problem:
        return Problem(self.simulation, self.rules, tuple(cells), known, fine)

    def _first(self, hypothesis: Hypothesis, base: Fit, starts: Mapping[str, float]) -> Point:
        coordinates = self.coordinates(hypothesis, base.scale)
        at = base.dropped({c.name for c in coordinates})
        theta = _told(base.point.moved(at), coordinates)
        for i, c in enumerate(coordinates):
            if c.parameter in starts:
                theta[i] = c.theta(starts[c.parameter])
        return Point(coordinates, theta, hypothesis.settings)

    # -- noise and evidence

    def quoted(self) -> dict[str, tuple[Whitener, ...]]:
        """White noise as the sensors are said to have, with the quoted errors of a right model."""
        return {
            name: tuple(
                known or Whitener(np.zeros(0), s)
                for s, known in zip(view.sigmas, self.erring_in(name), strict=True)
            )
            for name, view in self.simulation.views.items()
        }

    def coloured(self, residuals: Residuals) -> Noise:
        return {cell: self._colour(cell, r) for cell, r in residuals.items()}

    def _colour(self, cell: Cell, residual: Array) -> tuple[Whitener, ...]:
        finite, found = bool(np.isfinite(residual).all()), []
        for c, sigma in enumerate(self.simulation.views[cell[0]].sigmas):
            known, own = self.erring(cell)[c], residual[:, c]
            if known is not None:
                found.append(noise.grown(known, own) if finite else known)
                continue
            least, slow = self.rules.quietest * sigma, self.rules.slowest * sigma
            found.append(noise.coloured([own] if finite else [], least, slow))
        return tuple(found)

    def _parabola(self, solution: Solution, of_views: Noise) -> Parabola:
        """-2 log likelihood of some cells about where a descent ended."""
        normal, gradient = Weighing(of_views, self.rules).normal(
            solution.point, solution.residuals, solution.columns
        )
        moved = [c.name for c in solution.point.coordinates]
        index = [i for i, n in enumerate(moved) if normal[i, i] > 0]
        square = normal[np.ix_(index, index)]
        pull = square @ solution.point.theta[index] - gradient[index]
        return Parabola(tuple(moved[i] for i in index), square, pull)

    def _finished(
        self,
        hypothesis: Hypothesis,
        solution: Solution,
        known: Parabola,
        scale: float,
        base: Fit | None = None,
    ) -> Fit:
        """`base`: where the cells come from that were left as they are."""
        point, colour = solution.point, self.coloured(solution.residuals)
        parabolas = {
            view: self._parabola(_only(solution, view), colour)
            for view in dict.fromkeys(c[0] for c in colour)
        }
        stretches = {c: self.stretches(c, r, colour[c]) for c, r in solution.residuals.items()}
        cost = known.cost(point.theta)
        cost += (self.rules.tolerated - 1) * sum(x**2 for x in deviations(point).values())
        if base is not None:
            left = {v: p for v, p in base.parabolas.items() if v not in parabolas}
            at = dict(zip((c.name for c in base.point.coordinates), base.point.theta, strict=True))
            cost -= sum(p.cost(np.array([at[n] for n in p.names])) for p in left.values())
            solution = Solution(
                point,
                {**base.residuals, **solution.residuals},
                {**base.columns, **solution.columns},
                tangents={**base.tangents, **solution.tangents},
            )
            colour, parabolas = {**base.noise, **colour}, {**left, **parabolas}
            stretches = {**base.stretches, **stretches}
        occam, covariance = _occam(point.coordinates, parabolas)
        order = sum(len(w.coefficients) for ws in colour.values() for w in ws)
        rows = sum(r.size for r in solution.residuals.values())
        return Fit(
            hypothesis,
            point,
            solution.residuals,
            solution.columns,
            colour,
            parabolas,
            covariance,
            scale,
            stretches,
            cost + occam + order * math.log(max(rows, 2)),
            base is None,
            solution.settled,
            solution.tangents,
        )

    def stretches(self, cell: Cell, residual: Array, of_view: Sequence[Whitener]) -> Array:
        """-2 log likelihood of a cell, by stretch of its record."""
        found = [np.zeros(0)]
        for c, w in enumerate(of_view):
            terms = noise.loss(w(residual[:, c]), self.rules.tails) + 2 * math.log(w.sigma)
            found.append(self._by_stretch(cell, np.nan_to_num(terms, nan=FAILED, posinf=FAILED)))
        return np.concatenate(found)


class Scouts:
    """What hypotheses gain over a base in some views, each of them fitted by itself: more than in
    all together. It tells which are worth a fit.
    """

    def __init__(self, fitter: Fitter, base: Fit, views: Collection[str]) -> None:
        self.fitter, self._base, self._views = fitter, base, frozenset(views)

    def gains(
        self, tried: Sequence[tuple[Hypothesis, Sequence[Mapping[str, float]]]]
    ) -> list[float]:
        """Of each hypothesis the fall of -2 log posterior, from the base and from values."""
        fitter, together = self.fitter, self.fitter.simulation.side_by_side
        fitter.prepare([h for h, _ in tried])
        cells = [fitter._beside_base(h, self._base)[2] for h, _ in tried]
        touched = [frozenset(c[0] for c in own) for own in cells]
        levels = dict.fromkeys((v, t) for t in touched for v in sorted(t & self._views))
        found = dict(zip(levels, together(lambda k: self._level(*k), [*levels]), strict=True))
        return together(lambda each: self._gain(*each, found), tried)

    def _gain(
        self,
        hypothesis: Hypothesis,
        starts: Sequence[Mapping[str, float]],
        levels: Mapping[tuple[str, frozenset[str]], float],
    ) -> float:
        fitter, base = self.fitter, self._base
        _, known, cells = fitter._beside_base(hypothesis, base)
        touched = frozenset(c[0] for c in cells)
        own = [c for c in cells if c[0] in self._views]
        firsts, gain = fitter._firsts(hypothesis, base, starts, own), 0.0
        for view in dict.fromkeys(c[0] for c in own):
            problem = fitter._problem([c for c in own if c[0] == view], known, fine=False)
            least = levels[view, touched]
            for first in firsts:
                end = standing(problem, fitter._raced(problem, _only(first, view), least))
                gain, least = gain + max(least - end, 0.0), min(least, end)
        return gain

    def _level(self, view: str, touched: frozenset[str]) -> float:
        """Where the base comes to in a view by itself, other views as parabolas but for those that
        are touched.
        """
        base, fitter = self._base, self.fitter
        known = _known_beside(base.point.coordinates, base, touched)
        cells = [c for c in fitter.simulation.cells if c[0] == view]
        alone = fitter._problem(cells, known, fine=False)
        start = _only(Solution(base.point, base.residuals, base.columns), view)
        return standing(alone, fitter._raced(alone, start, math.inf))


def _occam(
    coordinates: Sequence[Coordinate], parabolas: Mapping[str, Parabola]
) -> tuple[float, Array]:
    """Occam factor of what was fitted, as -2 log, and the covariance of theta."""
    own = prior(coordinates)
    normal = sum((p.among(own.names).square for p in parabolas.values()), own.square)
    spread = np.array([c.spread for c in coordinates])
    factor = float(np.linalg.slogdet(normal * np.outer(spread, spread))[1])
    return factor, np.asarray(np.linalg.inv(normal), dtype=np.float64)


def _known_beside(
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


def _scaled(point: Point, scale: float) -> Point:
    """The same under another tolerance of the rig."""
    own = (replace(c, spread=scale) if c.scales else c for c in point.coordinates)
    return replace(point, coordinates=tuple(own))


def _told(point: Point, coordinates: Sequence[Coordinate]) -> Array:
    """Theta (coordinates,) of a point in other coordinates; without an effect where it has none."""
    known = {c.name: (c, t) for c, t in zip(point.coordinates, point.theta, strict=True)}
    theta = np.array([c.none for c in coordinates])
    for i, c in enumerate(coordinates):
        if c.name in known:
            old, at = known[c.name]
            theta[i] = at if old == c else c.theta(old.value(at))
    return theta


def _as_of(fit: Fit, point: Point) -> Solution:
    """What a fit leaves, in the coordinates of another point."""
    return Solution(point.moved(_told(fit.point, point.coordinates)), fit.residuals, {})


def _only(solution: Solution, view: str) -> Solution:
    """The part of one view."""
    return Solution(
        solution.point,
        {c: r for c, r in solution.residuals.items() if c[0] == view},
        {k: c for k, c in solution.columns.items() if k[0][0] == view},
        tangents={c: t for c, t in solution.tangents.items() if c[0] == view},
    )


def _in_cell(solution: Solution, cell: Cell) -> Solution:
    """The part of one cell."""
    columns = {k: c for k, c in solution.columns.items() if k[0] == cell}
    return Solution(solution.point, {cell: solution.residuals[cell]}, columns)


def _nominal(plant: Plant, views: Sequence[View]) -> dict[str, float]:
    """Values of the model's parameters."""
    known: dict[str, float] = {}
    for view in views:
        known.update(view.defaults)
    return {**known, **plant.parameters}
