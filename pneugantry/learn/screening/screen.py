"""Which equation lacks a term, and of what variable: every pair of both is tried, as a smooth curve
beside all that was fitted. What a pair predicts of logs that its curve has not seen counts.

How the residuals reply to an addend is simulated once for each equation (see `reply`); variables,
curves and waves are then linear algebra.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.noise import Noise
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.threads import on_threads
from pneugantry.engine.views.simulation import Cell
from pneugantry.learn.curves.curve import SIZES, Basis, Knots, Wave, finer, knots_over, waves_of
from pneugantry.learn.curves.memory import MEMORIES, Memory, Remembered, Walks
from pneugantry.learn.equations.points import Opened, Point
from pneugantry.learn.screening.candidate import Candidate, Course, Screen
from pneugantry.learn.screening.groups import WAVE, Answers, Group
from pneugantry.learn.screening.linear import (
    Response,
    Trial,
    base_of,
    trial_of,
    trial_over,
)
from pneugantry.learn.screening.regressors import (
    TIME,
    Regressor,
    products_of,
    rates_of,
    regressors_of,
)
from pneugantry.learn.screening.waves import periods_of

__all__ = ["Screening"]

FEWEST = 3.0  # periods in the covered range, of a wave along a variable
LINES = 400  # such periods, at most
RESOLVED = 4.0  # blocks in a period, at least
FINE = 0.05  # step of the number of periods about the best one
PAIRS = 256  # waves that are tried at once


@dataclass(eq=False)
class Screening:
    """Every equation with every variable of its component, and time, beside a fit. records: those
    of the fit. noise: see `base_of`. views: only equations that reach one of these; None: all.
    """

    opened: Opened
    fit: Fit
    noise: Noise
    records: Sequence[Record]
    rules: Rules
    views: frozenset[str] | None = None
    _walks: Walks = field(default_factory=Walks)
    _sensed: dict[str, dict[str, Array]] = field(default_factory=dict)  # see `_simulated`

    def __post_init__(self) -> None:
        self.base = base_of(self.fit, self.noise, self.rules)
        self.values = {r.name: self.fit.values(r.name) for r in self.records}
        self.quiet = {r.name: self.opened.quiet(r) for r in self.records}
        self.periods = {r.name: r.period for r in self.records}
        self.answers = Answers(
            self.opened, self.base, self.records, self.quiet, self.values, self.views
        )

    def singles(self) -> Screen:
        """Variables by themselves."""
        return self._screen({r: v for r, v in self._series.items() if not r.rate})

    def products(self) -> Screen:
        """Variables times those that stand in the equation."""
        return self._screen(products_of(self._series))

    def _screen(self, tried: Mapping[Regressor, Mapping[str, Array]]) -> Screen:
        told = [*self.answers.responses, *self.answers.in_common]
        found = [c for own in on_threads(lambda t: self._of_group(*t, tried), told) for c in own]
        ordered = tuple(sorted(found, key=lambda c: -c.gain))
        return Screen(self.fit, ordered, self._series, len(found))

    @cached_property
    def _series(self) -> dict[Regressor, dict[str, Array]]:
        heads = {p: self.opened.variables(p) for g in self.answers.groups for p in g.heads}
        told = self.opened, self.records, self.values
        points = [p for g in self.answers.groups for p in g.points]
        return regressors_of(heads, *told) | rates_of(points, *told)

    def _of_group(
        self,
        group: Group,
        response: Response,
        tried: Mapping[Regressor, Mapping[str, Array]],
    ) -> list[Candidate]:
        """Every variable of the components whose equations do the same, in the equation in which
        it, or what it is times, stands already, where there is one.
        """
        found: list[Candidate] = []
        ratios: dict[tuple[str, str], float] = {}
        heads = group.heads
        for first in heads:
            for regressor, values in tried.items():
                head = group.head(first, regressor.times or regressor.name)
                once = regressor.name == TIME and not regressor.times
                if (once and first != heads[0]) or (first.shared and not once):
                    continue
                if self._usable(head, regressor):
                    own = response.times(group.factor(head))
                    course = self._course(head, regressor, values)
                    headed, product = group.of(head), (regressor.component, regressor.times)
                    if regressor.times and course.factors is not None:
                        if product not in ratios:
                            ratios[product] = self._ratio(own, course.factors)
                        headed = replace(headed, unit=headed.unit * ratios[product])
                    bases = self._bases(head, own, regressor, course)
                    pair = headed, own, regressor
                    found += [self._candidate(*pair, b, course) for b in bases]
        return found

    def _course(self, point: Point, regressor: Regressor, values: Mapping[str, Array]) -> Course:
        """What a sensor reads is taken as its view has it, less that sensor's noise: of its own
        readings that noise would be a function. But not where the view integrates and so drifts.
        """
        series, sensor = self._series, ""
        for name in (regressor.name, regressor.times):
            made = self._simulated(point) if name and point.is_read(name) else {}
            if made:
                read = Regressor(regressor.component, name)
                series, sensor = {**series, read: {**series[read], **made}}, point.equation.left
        values = series[regressor.plain] if sensor else values
        return Course(values, regressor.factors(series), self.periods, sensor)

    def _simulated(self, point: Point) -> dict[str, Array]:
        """What a sensor would read without noise by record, where a view computes it afresh."""
        read = point.equation.left
        if read not in self._sensed:
            made: dict[str, Array] = {}
            signal = next((s.name for s in self.opened.plant.signals if s.variable == read), "")
            for v in self.opened.views:
                if signal in v.signals and not v.remembers:
                    names = [r for r in self.quiet if (v.name, r) in self.base.white]
                    told = v.simulate([(self.quiet[r], self.values[r]) for r in names])
                    column = v.signals.index(signal)
                    made |= {r: t[:, column] for r, t in zip(names, told, strict=True)}
            self._sensed[read] = made
        return self._sensed[read]

    def _ratio(self, response: Response, factors: Mapping[str, Array]) -> float:
        """By how much less than a factor a wave of size 1 does to the residuals."""
        return self._of_wave(response, factors) / _strength(trial_of(response, factors))

    def _of_wave(self, response: Response, like: Mapping[str, Array]) -> float:
        """How much a wave of size 1 does to the residuals, over rows like those of series."""
        waves = {r: np.sin(WAVE * np.arange(len(f)) * self.periods[r]) for r, f in like.items()}
        return _strength(trial_of(response, waves))

    def _usable(self, point: Point, regressor: Regressor) -> bool:
        """Whether a term of an equation may be a function of a variable: not where what the
        equation lacks decides it, or what it is times.
        """
        if not regressor.within(point) or (regressor.fed and regressor.name not in dict(point.fed)):
            return False
        own = ("" if regressor.outside else regressor.name, regressor.times, regressor.speed)
        return not any(self.opened.decides(point, point.scope_prefix + n) for n in own if n)

    # -- variables

    def _bases(
        self, point: Point, response: Response, regressor: Regressor, course: Course
    ) -> list[Basis | Remembered]:
        """Curves of a variable in an equation: smooth, and along a state or time also with narrow
        features, and waves; and what memories make of it.
        """
        knots = self._knots(response, course)
        if knots is None:
            return []
        memories = self._memories(point, response, regressor, course)
        bases: list[Basis | Remembered] = [knots, *memories]
        if regressor.name == TIME:
            periods = periods_of(response, course.values, course.factors)
            phases = sorted({1, len(course.values)})
            bases += [Wave(p, n) for p in periods for n in phases]
        if not regressor.times and regressor.name == TIME:
            bases.append(finer(knots))
        elif not (regressor.times or regressor.fed) and self._moves(regressor):
            bases.append(finer(knots))
            bases += [Wave(p) for p in self._lines(point, response, course)]
        return bases

    def _knots(self, response: Response, course: Course) -> Knots | None:
        """Over the range in which an addend is felt, or residuals ask for one: a spring's rate of
        deflection while it touches nothing does not count, how fast it is hit does.
        """
        at, felt, asked = [], [], []
        for cell in response.products:
            told = response.says(cell, course.values)
            factor: Array | float = 1.0
            if course.factors is not None:
                factor = response.at(cell, course.factors) ** 2
            at.append(told[0])
            felt.append(factor * told[1])
            asked.append(factor * told[2])
        return knots_over(np.concatenate(at), [np.concatenate(felt), np.concatenate(asked)])

    def _memories(
        self, point: Point, response: Response, regressor: Regressor, course: Course
    ) -> list[Remembered]:
        """Each memory of a variable, with the parameters that do best."""
        if regressor.outside or not regressor.alone:
            return []
        over = {c: response.shapes(c, course.values)[:, 0] for c in response.replies}
        step = {c: response.replies[c].block * self.periods[c[1]] for c in over}
        low, high = np.quantile(np.concatenate(list(over.values())), (0.005, 0.995))
        length = max(step[c] * len(v) for c, v in over.items())
        found = []
        inert = not point.sensor and self.opened.is_speed(regressor.label)
        for memory in (m for m in MEMORIES if inert or not m.pushes):
            tried = memory.tried(float(high - low), max(step.values()), length)
            if tried:
                label = regressor.label, course.sensor
                best = self._best(self._walks, response, course, label, memory, tried)
                near = memory.near(best) if memory.near else ()
                if near:  # no other equation asks for these
                    best = self._best(Walks(), response, course, label, memory, near)
                found.append(Remembered(memory, best))
        return found

    def _best(
        self,
        walks: Walks,
        response: Response,
        course: Course,
        label: tuple[str, str],
        memory: Memory,
        tried: Sequence[tuple[float, ...]],
    ) -> tuple[float, ...]:
        """The parameters of a memory that make squares of residuals fall most."""
        made = {}
        for c, reply in response.replies.items():
            over, step = response.shapes(c, course.values)[:, 0], reply.block * self.periods[c[1]]
            made[c] = walks.of((*label, c[1]), memory, tried, over, step)
        return tried[int(np.argmax(trial_over(response, made).falls))]

    def _moves(self, regressor: Regressor) -> bool:
        """Whether a variable is a state, along which something may be narrow or repeat."""
        shape = self.opened.shape
        return not regressor.speed and shape.roots.get(regressor.label) in shape.states

    def _lines(self, point: Point, response: Response, course: Course) -> list[float]:
        """The periods of a variable along which residuals repeat most, of a sensor also those of
        its own view: many of one lie in its range, and blocks of rows resolve it.
        """
        values = list(course.values.values())
        low, high = np.quantile(np.concatenate(values), (0.005, 0.995))
        over = {c: response.shapes(c, course.values)[:, 0] for c in response.replies}
        moved = [np.abs(np.diff(v)) for v in over.values()]
        step = float(np.median(np.concatenate(moved)))
        span = float(high - low)
        most = min(LINES, span / max(RESOLVED * step, 1e-12))
        if most <= FEWEST:
            return []
        rough = np.arange(FEWEST, most, 0.5)
        every, signal = {c[0] for c in over}, self.opened.signal(point)
        of_sensor = {v for v in every if signal in self.answers.of_name[v].signals}
        found: dict[float, float] = {}
        for own in [every, of_sensor] if of_sensor and of_sensor < every else [every]:
            cells = {c: p for c, p in response.products.items() if c[0] in own}
            told = replace(response, products=cells)
            best = float(rough[np.argmax(_powers(told, over, span / rough))])
            near = np.arange(best - 0.5, best + 0.5 + FINE, FINE)
            period = span / float(near[np.argmax(_powers(told, over, span / near))])
            found.setdefault(best, period)
        return list(found.values())

    def _candidate(
        self,
        group: Group,
        response: Response,
        regressor: Regressor,
        basis: Basis | Remembered,
        course: Course,
    ) -> Candidate:
        trial, unit = trial_of(response, course.shapes(basis)), group.unit
        if isinstance(basis, Remembered):  # its coefficient is none of an addend's unit
            unit *= self._of_wave(response, course.values) / _strength(trial)
        sizes = [(unit * size, bend) for size in SIZES for bend in basis.bends]
        plain = {bend: basis.prior(1.0, bend) for bend in basis.bends}
        priors = [plain[bend] / size**2 for size, bend in sizes]
        best, answer = trial.best(priors)
        return Candidate(
            group.points[0],
            regressor,
            basis,
            answer,
            trial.gain(priors[best]),
            unit,
            *sizes[best],
            response=response.bare,
            course=course,
            alike=tuple(group.points[1:]),
        )


def _strength(trial: Trial) -> float:
    """How much one shape of size 1 does to the residuals: the root of its square."""
    return float(np.sqrt(sum(p.square[0, 0] for p in trial.sums.values()))) or 1.0


def _powers(response: Response, over: Mapping[Cell, Array], periods: Array) -> Array:
    """Falls of the squares of residuals with a wave of each period along a variable; over: its
    means over blocks of rows.
    """
    found: list[Array] = []
    for start in range(0, len(periods), PAIRS):
        shapes = {c: waves_of(v, periods[start : start + PAIRS]) for c, v in over.items()}
        square, pull = response.pairs(shapes)
        size = np.trace(square, axis1=1, axis2=2) + 1e-300
        told = np.linalg.solve(square + 1e-9 * size[:, None, None] * np.eye(2), pull[..., None])
        found.append((pull[..., None] * told).sum(axis=(1, 2)))
    return np.concatenate(found)
