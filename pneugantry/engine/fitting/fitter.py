"""Fits hypotheses to records, with priors, and their evidence (Laplace's approximation)."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from modelica_fmu.errors import RunError
from pneugantry.engine.fitting.cell_noise import CellNoise
from pneugantry.engine.fitting.descent import descend
from pneugantry.engine.fitting.fit import (
    Fit,
    Lead,
    as_of,
    borne,
    deviations,
    known_beside,
    occam,
    scaled,
    theta_in,
)
from pneugantry.engine.fitting.noise import Noise
from pneugantry.engine.fitting.probing import probed
from pneugantry.engine.fitting.problem import (
    Parabola,
    Problem,
    Solution,
    inside,
    newton,
    predicted,
    prior,
    standing,
)
from pneugantry.engine.fitting.surveys import ROUGH, End, Surveys, in_view
from pneugantry.engine.fitting.weighing import FAILED, Weighing
from pneugantry.engine.hypotheses.catalogue import Effect, Form, Parameter
from pneugantry.engine.hypotheses.hypothesis import (
    Coordinate,
    Hypothesis,
    effect_coordinate,
    nuisance_coordinate,
)
from pneugantry.engine.plant import Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.signals.commands import outside
from pneugantry.engine.signals.sensors import neutral
from pneugantry.engine.views.simulation import Cell, Point, Simulation
from pneugantry.engine.views.view import View

__all__ = ["FRESH", "Fitter"]

DAMPED = (0.0, 1e-3, 1e-2, 0.1, 1.0)  # steps to the least of the views' parabolas that are tried
FRESH = 2  # times as large is a survey where other equations hold: nothing is known of their optima
FIRSTS = 3  # of many starts those from which a hypothesis is fitted near a base, it included
SIDES = 2  # of many starts those from which an effect is sized
SIZED = 4  # steps of an effect's size alone, at most
LEGS = 2  # descents from afar, each from the end of the one before, undamped
FAR_OFF = 3.0  # spreads of the rig's tolerance from which on a deviation is much
OTHER = 0.05  # change of the logarithm of a rig's tolerance from which on it is another
T = TypeVar("T")
Found = TypeVar("Found")


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
        self.noise = CellNoise(plant, self.simulation, rules, level)
        self.surveys = Surveys(self.simulation, self.noise, rules)
        self.since = 0.0  # evaluations that the effects took which have been found

    def close(self) -> None:
        self.simulation.close()

    # -- coordinates

    def neutral(self, name: str) -> float:
        """Value of a parameter without any effect."""
        return neutral(name) if outside(name) else self.nominal.get(name, 0.0)

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
        parts = {
            v: in_view(solution, v) for v in dict.fromkeys(c[0] for c in self.simulation.cells)
        }
        return [
            v
            for v, p in parts.items()
            if v in bent or not self.surveys.quiet(self.surveys.problem(p.residuals, known), p)
        ]

    @staticmethod
    def far_off(fit: Fit) -> set[str]:
        """Coordinates that a fit has bent far beyond tolerance."""
        return {n for n, off in deviations(fit.point).items() if abs(off) > FAR_OFF}

    def negligible(self, fit: Fit) -> list[str]:
        """Effects of a size that is none, whatever evidence they bring: where noise enters a view
        with its inputs, the best size of an effect that averages them is not nothing. What every
        rig has off makes no effect beside what it alone has.
        """
        usual = {n.parameter for n in self.plant.nuisances}
        pairs = zip(fit.point.coordinates, fit.point.theta, strict=True)
        at = {c.parameter: abs(float(t) - c.none) for c, t in pairs if c.effect}
        found = []
        for e, form in fit.hypothesis.effects:
            names = [p.name for p in form.parameters]
            own = [n for n in names if n not in usual] or names
            if not form.settings and all(at[n] < self.rules.negligible for n in own):
                found.append(e.key)
        return found

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
        need it. Raises RunError where no view can be simulated over any record.
        """
        coordinates = self.coordinates(Hypothesis(), self.rules.tolerance)
        self.prepare([Hypothesis()])
        start = Point(coordinates, np.zeros(len(coordinates)), {})
        known, cells = prior(coordinates), tuple(self.simulation.cells)
        residuals, columns = self.simulation.linearised(start, cells, set(known.names), fine=False)
        if not any(np.isfinite(r).all() for r in residuals.values()):
            raise RunError(
                "the model stops over every log: what drives it, or its starts, are wrong"
            )
        solution = self._by_view([Solution(start, residuals, columns)], known, cells)
        solution = self._jointly(solution, known, cells)
        scale = self._tolerance(solution.point)
        point = scaled(solution.point, scale)
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
        own, known, cells = self.beside_base(hypothesis, base)
        firsts = self.firsts(hypothesis, base, starts, cells)
        if len(firsts) > FIRSTS:
            ranked = sorted(firsts[1:], key=lambda s: self._beside(s, base, known, cells))
            firsts = [firsts[0], *ranked[: FIRSTS - 1]]
        another = hypothesis.settings and hypothesis.settings != base.hypothesis.settings
        rivals = [as_of(f, own) for f in (base, ahead) if f is not None]
        share = fresh if another else int(thorough)
        solution = self._by_view(firsts, known, cells, rivals, share)
        best = min(firsts, key=lambda s: self._beside(s, base, known, cells))
        before, after = (self._beside(s, base, known, cells) for s in (best, solution))
        if after > before:  # where the views lead apart is worse than where one of them stood
            solution, after = best, before
        if after - self._beside(base, base, known, cells) < self.rules.hopeless:
            solution = self._jointly(solution, known, cells)
        return self._finished(hypothesis, solution, known, base.scale, base)

    def firsts(
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
        _, known, cells = self.beside_base(hypothesis, base)
        problem = self.surveys.problem(cells, known)

        def down(values: Mapping[str, float]) -> Solution:
            point = self._sized(self._first(hypothesis, base, values), known, cells)
            residuals, columns = self.simulation.linearised(point, cells, set(known.names))
            solution = Solution(point, residuals, columns)
            for _ in range(LEGS):
                solution = descend(problem, solution, None, ROUGH)
            return solution

        ends = self.simulation.side_by_side(down, starts)
        solution = min(ends, key=lambda s: standing(problem, s))
        if standing(problem, solution) < standing(problem, as_of(base, solution.point)):
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
        _, known, touched = self.beside_base(hypothesis, base)
        points, best, total = [self._first(hypothesis, base, s) for s in starts], -math.inf, 0.0
        values: Mapping[str, float] = {}
        for view in dict.fromkeys(c[0] for c in cells):
            own = [c for c in cells if c[0] == view and c in touched]
            if not own:
                continue
            problem = self.surveys.problem(own, known, fine=False)
            level = standing(problem, as_of(base, points[0]))
            few = [s.point for s in self.surveys.ranked(problem, points, own)[:SIDES]]
            sized = self.surveys.ranked(problem, [self._sized(p, known, own) for p in few], own)
            end = self.surveys.raced(
                problem, self.surveys.coarsely(problem, sized[0].point), math.inf
            )
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
        problem = self.surveys.problem(cells, known.of(names, start.theta), fine=False)
        found = self.simulation.linearised(point, cells, names, fine=False)
        end = descend(
            problem, Solution(point, *found), None, ROUGH, lambda steps, at: steps >= SIZED
        )
        theta = start.theta.copy()
        theta[free] = end.point.theta
        return start.moved(theta)

    def beside_base(
        self, hypothesis: Hypothesis, base: Fit
    ) -> tuple[Point, Parabola, tuple[Cell, ...]]:
        """Where a hypothesis starts from a base, what is known of it besides, and the cells that
        effects touch in which the two differ; the others are their parabolas at the base.
        """
        own = self._first(hypothesis, base, {})
        self.prepare([hypothesis])
        touched = set(self.touched(hypothesis.beyond(base.hypothesis)))
        cells = tuple(c for c in self.simulation.cells if c in touched)
        return own, known_beside(own.coordinates, base, {c[0] for c in cells}), cells

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
        solution = self._reached(fit, whole, cells)
        made = self._ended(
            fit, (self._polished if thorough else self._jointly)(solution, whole, cells)
        )
        if thorough or made.evidence < fit.evidence + self.rules.entry:
            return made
        at = Solution(made.point, made.residuals, made.columns, tangents=made.tangents)
        return min(
            made, self._ended(fit, self._polished(at, whole, cells)), key=lambda f: f.evidence
        )

    def _reached(self, fit: Fit, known: Parabola, cells: Sequence[Cell]) -> Solution:
        """Where a fit ended, in all views. One that it left as a parabola may meet an event
        otherwise there: then what that view reads is held where it was, if all is better so.
        """
        if fit.settled:
            return Solution(fit.point, fit.residuals, fit.columns, True, fit.tangents)
        residuals = self.simulation.residuals(fit.point, cells)
        end = Solution(fit.point, residuals, fit.columns, tangents=fit.tangents)
        weighing = Weighing(fit.noise, self.rules)
        own = [c for c in cells if c[0] in fit.left]
        before, after = (weighing.costs({c: r[c] for c in own}) for r in (fit.residuals, residuals))
        worse = {v for v in before if after[v] - before[v] > self.rules.entry}
        if not worse:
            return end
        point = self._held(fit, worse)
        held = replace(end, point=point, residuals=self.simulation.residuals(point, cells))
        return min(end, held, key=lambda s: self._cost(s, known, fit.noise))

    def _held(self, fit: Fit, views: Collection[str]) -> Point:
        """A fit with what some views read where it was when they became parabolas."""
        coordinates, at = fit.point.coordinates, dict[str, float]()
        for cell in (c for c in self.simulation.cells if c[0] in views):
            theta = theta_in(fit.left[cell[0]], coordinates)
            read = zip(coordinates, theta, strict=True)
            at |= {c.name: t for c, t in read if self.simulation.in_cell(c, cell)}
        return inside(fit.point.moved(fit.held(at)))

    def _ended(self, fit: Fit, solution: Solution) -> Fit:
        """The hypothesis of a fit where all views together have led."""
        whole, cells = prior(fit.point.coordinates), tuple(self.simulation.cells)
        solution = self._renewed(solution, whole, cells, self.rules.renewals)
        return self._finished(fit.hypothesis, solution, whole, fit.scale)

    def in_more_records(self, fit: Fit) -> Fit:
        """A fit of some of these records where it stands, in all that read its effects."""
        coordinates = self.coordinates(fit.hypothesis, fit.scale)
        point = Point(coordinates, theta_in(fit.point, coordinates), fit.point.settings)
        self.prepare([fit.hypothesis])
        whole = prior(coordinates)
        cells = [c for c in self.touched(fit.hypothesis) if c not in fit.noise]
        residuals, columns = self.simulation.linearised(point, cells, set(whole.names))
        every = Solution(point, {**fit.residuals, **residuals}, {**fit.columns, **columns})
        return self._finished(fit.hypothesis, every, whole, fit.scale)

    def tolerance_of(self, fit: Fit) -> float:
        """Spread of the rig's tolerance by a fit; what it had where that is hardly another."""
        scale = self._tolerance(fit.point)
        return scale if abs(math.log(scale / fit.scale)) > OTHER else fit.scale

    def rescaled(self, fit: Fit, scale: float) -> Fit:
        """A fit under another tolerance, from where it ended."""
        if scale == fit.scale:
            return fit
        cells = tuple(self.simulation.cells)
        point = scaled(fit.point, scale)
        whole = prior(point.coordinates)
        solution = Solution(point, fit.residuals, fit.columns, tangents=fit.tangents)
        solution = self._renewed(solution, whole, cells, self.rules.renewals)
        return self._finished(fit.hypothesis, solution, whole, scale)

    def under(self, fit: Fit, scale: float) -> Fit:
        """The same where it ended: what another tolerance makes of its evidence."""
        if scale == fit.scale:
            return fit
        points = fit.point, scaled(fit.point, scale)
        bends = [sum(x**2 for x in deviations(p).values()) for p in points]
        (before, _), (after, covariance) = (occam(p.coordinates, fit.parabolas) for p in points)
        cost = fit.cost + self.rules.tolerated * (bends[1] - bends[0]) + after - before
        return replace(fit, point=points[1], scale=scale, covariance=covariance, cost=cost)

    def _polished(self, start: Solution, known: Parabola, cells: Sequence[Cell]) -> Solution:
        """Jointly, and again from the best point about where that ends, until none is better.

        An event that a simulation misses (a break-away) shows in no derivative.
        """
        solution = self._jointly(start, known, cells)
        for _ in range(self.rules.turns):
            colour = self.noise.coloured(solution.residuals)
            turned = probed(self.surveys.problem(cells, known), solution, colour)
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
        ends = self.surveys.ends(starts, known, cells, rivals, views)
        if not rivals:
            self.noise.level = self.noise.loudness([e.solution.residuals for e in ends])

        def ended(end: End) -> Solution:
            solution = end.solution
            if share > 1 or (share == 1 and end.contends):
                lowest = end.lowest if rivals else None
                solution = self.surveys.surveyed(end.problem, starts, solution, lowest, share)
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
            parabola = self._parabola(end, self.noise.coloured(end.residuals)).among(known.names)
            sure = np.diag(parabola.square)
            at = np.where(sure > most, end.point.theta, at)
            most = np.maximum(sure, most)
            total = total.plus(parabola)
            columns |= end.columns
            tangents |= end.tangents
        between = start.point.moved(at)
        slope, scale = total.square @ at - total.pull, np.diag(np.diag(total.square))
        points = [between, *(newton(between, total.square + d * scale, slope) for d in DAMPED)]
        problem = self.surveys.problem(cells, known)
        best = self.surveys.ranked(problem, points, cells)[0]
        if standing(problem, best) >= FAILED:
            return start
        return Solution(best.point, best.residuals, columns, tangents=tangents)

    def _jointly(self, start: Solution, known: Parabola, cells: Sequence[Cell]) -> Solution:
        """All views together, from new columns on."""
        if start.settled:
            return start
        return self._descended(self._with_columns(start, known, cells), known, cells)

    def _descended(self, start: Solution, known: Parabola, cells: Sequence[Cell]) -> Solution:
        """All views together, under the colour that their residuals have."""
        problem, solution = self.surveys.problem(cells, known), start
        for fall in (ROUGH, self.rules.converged):
            before = solution.point
            solution = descend(problem, solution, self.noise.coloured(solution.residuals), fall)
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
            colour, at = self.noise.coloured(solution.residuals), solution
            solution = descend(self.surveys.problem(cells, known), at, colour, self.rules.converged)
            if solution.point is at.point:
                return replace(solution, settled=True)
            solution = self._with_columns(solution, known, cells)
            before, after = (self._cost(s, known, colour) for s in (at, solution))
            if before - after < self.rules.entry:
                break
        return solution

    def _with_columns(self, at: Solution, known: Parabola, cells: Sequence[Cell]) -> Solution:
        """With columns by small steps in some cells. Those serve on that predict from where they
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
        moved = at.point.theta - theta_in(tangent.point, at.point.coordinates)
        there = replace(at, residuals={cell: tangent.residual})
        missed = at.residuals[cell] - predicted(there, [cell], moved)[cell]
        colour = self.noise.colour(cell, at.residuals[cell])
        white = np.concatenate([w(missed[:, i]) for i, w in enumerate(colour)])
        return float(white @ white)

    def _first(self, hypothesis: Hypothesis, base: Fit, starts: Mapping[str, float]) -> Point:
        coordinates = self.coordinates(hypothesis, base.scale)
        at = base.dropped({c.name for c in coordinates})
        theta = theta_in(base.point.moved(at), coordinates)
        for i, c in enumerate(coordinates):
            if c.parameter in starts:
                theta[i] = c.theta(starts[c.parameter])
        return Point(coordinates, theta, hypothesis.settings)

    # -- noise and evidence

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
        places: dict[str, Point] = {}
        point, colour = solution.point, self.noise.coloured(solution.residuals)
        parabolas = {
            view: self._parabola(in_view(solution, view), colour)
            for view in dict.fromkeys(c[0] for c in colour)
        }
        stretches = {
            c: self.noise.stretches(c, r, colour[c]) for c, r in solution.residuals.items()
        }
        cost = known.cost(point.theta)
        cost += (self.rules.tolerated - 1) * borne(point)
        if base is not None:
            left = {v: p for v, p in base.parabolas.items() if v not in parabolas}
            places = {v: base.left.get(v, base.point) for v in left}
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
        factor, covariance = occam(point.coordinates, parabolas)
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
            cost + factor + order * math.log(max(rows, 2)),
            base is None,
            solution.settled,
            solution.tangents,
            places,
        )


def _nominal(plant: Plant, views: Sequence[View]) -> dict[str, float]:
    """Values of the model's parameters."""
    known: dict[str, float] = {}
    for view in views:
        known.update(view.defaults)
    return {**known, **plant.parameters}
