"""Fits hypotheses to records, with priors, and their evidence (Laplace's approximation)."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from modelica_fmu.errors import RunError
from pneugantry.engine.fitting.cell_noise import CellNoise
from pneugantry.engine.fitting.coordinates import Coordinates
from pneugantry.engine.fitting.descent import descend
from pneugantry.engine.fitting.descents import Descents
from pneugantry.engine.fitting.fit import (
    Fit,
    Lead,
    Race,
    as_of,
    borne,
    deviations,
    known_beside,
    occam,
    scaled,
    theta_in,
)
from pneugantry.engine.fitting.problem import (
    Parabola,
    Solution,
    inside,
    prior,
    standing,
)
from pneugantry.engine.fitting.surveys import ROUGH, Surveys, in_view
from pneugantry.engine.fitting.weighing import Weighing
from pneugantry.engine.hypotheses.catalogue import Effect
from pneugantry.engine.hypotheses.hypothesis import (
    Hypothesis,
)
from pneugantry.engine.plant import Plant, Record
from pneugantry.engine.recent import Recent
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.simulation import Cell, Point, Simulation
from pneugantry.engine.views.view import View

__all__ = ["FRESH", "Fitter"]

FRESH = 2  # times as large is a survey where other equations hold: nothing is known of their optima
FIRSTS = 3  # of many starts those from which a hypothesis is fitted near a base, it included
SIDES = 2  # of many starts those from which an effect is sized
LEGS = 2  # descents from afar, each from the end of the one before, undamped
FAR_OFF = 3.0  # spreads of the rig's tolerance from which on a deviation is much
OPEN = 16  # fits of which is kept what they leave
LED = 64  # and of which is kept where they lead
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
        self.coordinates = Coordinates(plant, self.simulation, rules)
        self.noise = CellNoise(plant, self.simulation, rules, level)
        self.surveys = Surveys(self.simulation, self.noise, rules)
        self.descents = Descents(self.simulation, self.noise, self.surveys, rules)
        self.since = 0.0  # evaluations that the effects took which have been found
        self.stands_out: Recent[list[str]] = Recent(OPEN)  # by fit, views (`selection.excess`)
        self._led: Recent[Fit] = Recent(LED)  # by a fit, where it leads, and whether thoroughly

    def close(self) -> None:
        self.simulation.close()

    def loud(self, fit: Fit) -> list[str]:
        """Views that tolerance or its effects move, in which a fit leaves more than noise, or not
        only because it has bent a parameter that they read (`bent`).
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
        """Views that read a parameter that a fit has bent so far that this alone is as likely
        something unknown as not; of many parameters some are a little beyond tolerance by chance.
        """
        off, views = deviations(fit.point), self.simulation.views
        far = [n for n, d in off.items() if abs(d) > self.rules.bent]
        return {c[0] for c in self.simulation.cells if any(map(views[c[0]].depends_on, far))}

    # -- fits

    def prepare(self, hypotheses: Sequence[Hypothesis]) -> None:
        """Before many simulations of them."""
        moving = self.coordinates.moving
        self.simulation.prepare([(moving(h.parameters), h.settings) for h in hypotheses])

    def prepare_any(self, base: Hypothesis, effects: Collection[Effect]) -> None:
        """Before simulations of a hypothesis with any of the effects that keep its equations."""
        forms = [f for e in effects for f in e.forms if not f.settings]
        every = (*base.parameters, *(p for f in forms for p in f.parameters))
        self.simulation.prepare([(self.coordinates.moving(every), base.settings)])

    def together(
        self, call: Callable[[T], Found], values: Sequence[T], hypotheses: Sequence[Hypothesis]
    ) -> list[Found]:
        """What a call makes of each value, in their order, side by side. hypotheses: that the calls
        simulate; all are prepared first, for what has been decides which part a run takes.
        """
        self.prepare(hypotheses)
        return self.simulation.side_by_side(call, values)

    def null(self) -> Fit:
        """Nuisances alone, under the tolerance that they show; not `again` thoroughly: few rigs
        need it. Raises RunError where no view can be simulated over any record.
        """
        coordinates = self.coordinates.of(Hypothesis(), self.rules.tolerance)
        self.prepare([Hypothesis()])
        start = Point(coordinates, np.zeros(len(coordinates)), {})
        known, cells = prior(coordinates), tuple(self.simulation.cells)
        residuals, columns = self.simulation.linearised(start, cells, set(known.names), fine=False)
        if not any(np.isfinite(r).all() for r in residuals.values()):
            raise RunError(
                "the model stops over every log: what drives it, or its starts, are wrong"
            )
        solution = self.descents.by_view([Solution(start, residuals, columns)], known, cells)
        solution = self.descents.jointly(solution, known, cells)
        scale = self._tolerance(solution.point)
        point = scaled(solution.point, scale)
        known = prior(point.coordinates)
        solution = replace(solution, point=point, settled=False)
        solution = self.descents.renewed(solution, known, cells, 1)
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
        race: Race | None = None,
        thorough: bool = True,
        fresh: int = FRESH,
    ) -> Fit:
        """A hypothesis near `base`: views that its effects do not touch are their parabolas there.
        starts: values of effect parameters to start from, too. race: the best of its rivals so
        far, behind which less is tried, and what does not come near given up. thorough: views above
        the noise are surveyed, too; they always are under other equations than the base's, by
        surveys `fresh` times as large.
        """
        own, known, cells = self.beside_base(hypothesis, base)
        firsts = self.firsts(hypothesis, base, starts, cells)
        if len(firsts) > FIRSTS:
            ranked = sorted(firsts[1:], key=lambda s: self._beside(s, base, known, cells))
            firsts = [firsts[0], *ranked[: FIRSTS - 1]]
        another = hypothesis.settings and hypothesis.settings != base.hypothesis.settings
        rivals = [as_of(f, own) for f in (base, *([race.ahead] if race else []))]
        share = fresh if another else int(thorough)
        near = race is not None and race.worth >= 1
        solution = self.descents.by_view(firsts, known, cells, rivals, share, near)
        best = min(firsts, key=lambda s: self._beside(s, base, known, cells))
        before, after = (self._beside(s, base, known, cells) for s in (best, solution))
        ends = [solution] if after <= before else [best, solution]  # views may lead apart
        least = self._beside(base, base, known, cells) + self.rules.hopeless
        if min(before, after) < least:
            bar = self.bar_of(race, base, own, known, cells)
            ends = [self.descents.jointly(s, known, cells, bar) for s in ends]
        solution = ends[0]
        if len(ends) > 1:
            solution = min(ends, key=lambda s: self._beside(s, base, known, cells))
        return self._finished(hypothesis, solution, known, base.scale, base)

    def bar_of(
        self, race: Race | None, base: Fit, own: Point, known: Parabola, cells: Sequence[Cell]
    ) -> float:
        """What a fit in some cells has to come below in a race (`standing`)."""
        if race is None:
            return math.inf
        problem = self.surveys.problem(cells, known)
        start, ahead = (standing(problem, as_of(f, own)) for f in (base, race.ahead))
        return start - race.worth * max(start - ahead, 0.0) + self.rules.hopeless

    def firsts(
        self,
        hypothesis: Hypothesis,
        base: Fit,
        starts: Sequence[Mapping[str, float]],
        cells: Sequence[Cell],
    ) -> list[Solution]:
        """Where a hypothesis starts in some cells: from the base, and from values besides."""
        coordinates = self.coordinates.of(hypothesis, base.scale)
        columns = {k: c for k, c in base.columns.items() if k[0] in cells}
        wanted = {c.name for c in coordinates if c.effect}
        if hypothesis.settings != base.hypothesis.settings:  # other equations, other columns
            columns, wanted = {}, {c.name for c in coordinates}

        def first(values: Mapping[str, float]) -> Solution:
            point = self.coordinates.first(hypothesis, base, values)
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
            first = self.coordinates.first(hypothesis, base, values)
            point = self.descents.sized(first, known, cells)
            residuals, columns = self.simulation.linearised(point, cells, set(known.names))
            solution = Solution(point, residuals, columns)
            for _ in range(LEGS):
                solution = descend(problem, solution, None, ROUGH)
            return solution

        ends = self.simulation.side_by_side(down, starts)
        solution = min(ends, key=lambda s: standing(problem, s))
        if standing(problem, solution) < standing(problem, as_of(base, solution.point)):
            solution = self.descents.jointly(solution, known, cells)
        return self._finished(hypothesis, solution, known, base.scale, base)

    def lead(
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
        points = [self.coordinates.first(hypothesis, base, s) for s in starts]
        best, total = -math.inf, 0.0
        values: Mapping[str, float] = {}
        for view in dict.fromkeys(c[0] for c in cells):
            own = [c for c in cells if c[0] == view and c in touched]
            if not own:
                continue
            problem = self.surveys.problem(own, known, fine=False)
            level = standing(problem, as_of(base, points[0]))
            few = [s.point for s in self.surveys.ranked(problem, points, own)[:SIDES]]
            ends = [self.descents.sized(p, known, own) for p in few]
            sized = self.surveys.ranked(problem, ends, own)
            end = self.surveys.raced(
                problem, self.surveys.coarsely(problem, sized[0].point), math.inf
            )
            gain = level - standing(problem, end)
            total += gain
            if gain > best:
                best, values = gain, end.point.values(None)
        return Lead(total, values)

    def beside_base(
        self, hypothesis: Hypothesis, base: Fit
    ) -> tuple[Point, Parabola, tuple[Cell, ...]]:
        """Where a hypothesis starts from a base, what is known of it besides, and the cells that
        effects touch in which the two differ; the others are their parabolas at the base.
        """
        own = self.coordinates.first(hypothesis, base, {})
        self.prepare([hypothesis])
        touched = set(self.coordinates.touched(hypothesis.beyond(base.hypothesis)))
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
        Where a fit has led is not asked twice; thoroughly serves for either.
        """
        led = None if thorough else self._led.get((fit, True))
        return led or self._led.of((fit, thorough), lambda: self._again(fit, thorough))

    def _again(self, fit: Fit, thorough: bool) -> Fit:
        cells = tuple(self.simulation.cells)
        whole = prior(fit.point.coordinates)
        solution = self._reached(fit, whole, cells)
        led = self.descents.polished if thorough else self.descents.jointly
        made = self._ended(fit, led(solution, whole, cells))
        if thorough or made.evidence < fit.evidence + self.rules.entry:
            return made
        at = Solution(made.point, made.residuals, made.columns, tangents=made.tangents)
        other = self._ended(fit, self.descents.polished(at, whole, cells))
        return min(made, other, key=lambda f: f.evidence)

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
        return min(end, held, key=lambda s: self.descents.cost(s, known, fit.noise))

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
        solution = self.descents.renewed(solution, whole, cells, self.rules.renewals)
        return self._finished(fit.hypothesis, solution, whole, fit.scale)

    def in_more_records(self, fit: Fit) -> Fit:
        """A fit of some of these records where it stands, in all that read its effects."""
        coordinates = self.coordinates.of(fit.hypothesis, fit.scale)
        point = Point(coordinates, theta_in(fit.point, coordinates), fit.point.settings)
        self.prepare([fit.hypothesis])
        whole = prior(coordinates)
        cells = [c for c in self.coordinates.touched(fit.hypothesis) if c not in fit.noise]
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
        solution = self.descents.renewed(solution, whole, cells, self.rules.renewals)
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
            view: self.descents.parabola(in_view(solution, view), colour)
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
