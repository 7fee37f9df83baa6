"""Which equation lacks a term, and of what variable: every pair of both is tried, as a smooth curve
beside all that was fitted. What a pair predicts of logs that its curve has not seen counts.

How the residuals reply to an addend is simulated once for each equation (see `reply`); variables,
curves and waves are then linear algebra.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from pneugantry.learn.equations.points import Opened, OpenedView, Point
from pneugantry.learn.screening.linear import (
    Base,
    Estimate,
    Response,
    Trial,
    base_of,
    response_of,
    together,
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
from pneugantry.learn.screening.reply import Pulses, Reply, blocks_of, both_ways, reply_of
from pneugantry.learn.screening.waves import periods_of

__all__ = ["Candidate", "Course", "Screen", "Screening"]

WAVE = 9.0  # rad/s, of the term that probes an equation
FIRST = 1e-3  # its size at first
PROBES = 3
NEAR = 5.0  # factor by which its answer may miss one noise level
PULSE = 10.0  # size of a first pulse, in units of the wave's
PULSES = 24  # simulations of a record for an equation's reply, at most
WORK = 1e6  # rows of all of them, at most
FEWEST = 3.0  # periods in the covered range, of a wave along a variable
LINES = 400  # such periods, at most
RESOLVED = 4.0  # blocks in a period, at least
FINE = 0.05  # step of the number of periods about the best one
ALIKE = 0.97  # cosine of the answers to one term from which on two equations are one
PAIRS = 256  # waves that are tried at once


@dataclass(frozen=True, eq=False)
class Course:
    """A regressor over the records."""

    values: Mapping[str, Array]
    factors: Mapping[str, Array] | None  # by which its term is multiplied
    periods: Mapping[str, float] = field(default_factory=dict)  # of rows, s
    sensor: str = ""  # whose view has it, where it is not what is measured

    def shapes(self, basis: Basis | Remembered) -> dict[str, Array]:
        """Shapes (rows, coefficients) of each record."""
        if isinstance(basis, Remembered):
            found = {r: basis.walked(v, self.periods[r]) for r, v in self.values.items()}
        else:
            found = {r: basis.shapes(v) for r, v in self.values.items()}
        if isinstance(basis, Wave) and basis.phases > 1:
            found = {r: _among(s, k, basis.phases) for k, (r, s) in enumerate(found.items())}
        own = self.factors
        return found if own is None else {r: s * own[r][:, None] for r, s in found.items()}


@dataclass(frozen=True, eq=False)
class Candidate:
    """A curve of a variable in an equation."""

    point: Point
    regressor: Regressor
    basis: Basis | Remembered
    answer: Estimate  # coefficients of the curve: of the addend, or of what its factor is times
    gain: float  # of -2 log density of logs left out
    unit: float  # of the curve: the size that changes residuals by one noise level
    size: float  # of the curve's prior, in its own unit
    bend: float  # its further parameter, see `Basis.bends`
    response: Response  # without its products
    course: Course
    alike: tuple[Point, ...] = ()  # equations whose addend does the same

    @property
    def base(self) -> Base:
        """What it was tried beside."""
        return self.response.base

    @property
    def columns(self) -> dict[Cell, Array]:
        """Of its coefficients, whitened."""
        return self.response.columns(self.course.shapes(self.basis))


@dataclass(frozen=True, eq=False)
class Screen:
    """All that was tried, the best first."""

    fit: Fit
    candidates: tuple[Candidate, ...]
    series: Mapping[Regressor, Mapping[str, Array]]  # by record
    tried: int = 0  # curves


@dataclass(frozen=True, eq=False)
class _Group:
    """Equations whose addends do the same."""

    points: list[Point]
    cells: tuple[Cell, ...]
    answer: Array  # of the first one to a slow wave, of length 1
    unit: float
    factors: list[float]  # times what the first one does

    @property
    def heads(self) -> list[Point]:
        """The first equation of each component, and of each sensor of it."""
        found: dict[tuple[str, bool], Point] = {}
        for point in self.points:
            found.setdefault((point.scope, point.sensor), point)
        return list(found.values())

    def head(self, like: Point, variable: str) -> Point:
        """The first equation of a component in which a variable stands, or else of all of its."""
        own = [p for p in self.points if (p.scope, p.sensor) == (like.scope, like.sensor)]
        return next((p for p in own if p.reads(variable)), own[0])

    def factor(self, point: Point) -> float:
        return self.factors[self.points.index(point)]

    def of(self, point: Point) -> _Group:
        """The same with another equation first."""
        rest = [p for p in self.points if p != point]
        factor = self.factor(point)
        order = [point, *rest]
        factors = [self.factor(p) / factor for p in order]
        return _Group(order, self.cells, self.answer, self.unit / abs(factor), factors)


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
    _zero: dict[Cell, Array] = field(default_factory=dict)
    _walks: Walks = field(default_factory=Walks)
    _sensed: dict[str, dict[str, Array]] = field(default_factory=dict)  # see `_simulated`

    def __post_init__(self) -> None:
        self.base = base_of(self.fit, self.noise, self.rules)
        self.values = {r.name: self.fit.values(r.name) for r in self.records}
        self.quiet = {r.name: self.opened.quiet(r) for r in self.records}
        self.periods = {r.name: r.period for r in self.records}
        self.of_name = {v.name: v for v in self.opened.views}

    def singles(self) -> Screen:
        """Variables by themselves."""
        return self._screen({r: v for r, v in self._series.items() if not r.rate})

    def products(self) -> Screen:
        """Variables times those that stand in the equation."""
        return self._screen(products_of(self._series))

    def _screen(self, tried: Mapping[Regressor, Mapping[str, Array]]) -> Screen:
        told = [*self._responses, *self._in_common]
        found = [c for own in on_threads(lambda t: self._of_group(*t, tried), told) for c in own]
        ordered = tuple(sorted(found, key=lambda c: -c.gain))
        return Screen(self.fit, ordered, self._series, len(found))

    @cached_property
    def _series(self) -> dict[Regressor, dict[str, Array]]:
        heads = {p: self.opened.variables(p) for g in self._groups for p in g.heads}
        told = self.opened, self.records, self.values
        points = [p for g in self._groups for p in g.points]
        return regressors_of(heads, *told) | rates_of(points, *told)

    @cached_property
    def _responses(self) -> list[tuple[_Group, Response]]:
        """Of equations that answer; two records are simulated at a time."""
        asked = [(g, self.of_name[v], r) for g in self._groups for v, r in self._asked(g)]
        told = on_threads(lambda each: self._reply(*each), asked)
        found: list[tuple[_Group, Response]] = []
        for group in self._groups:
            known = {
                (v.name, r.name): reply
                for (g, v, r), reply in zip(asked, told, strict=True)
                if g is group and reply is not None
            }
            if known:
                found.append((group, response_of(self.base, known)))
        return found

    @cached_property
    def _in_common(self) -> list[tuple[_Group, Response]]:
        """What several components have in common, where each one answers in cells of its own."""
        found: list[tuple[_Group, Response]] = []
        for point in self.opened.shared:
            own = [(g, r.times(g.factor(p))) for p in point.members for g, r in self._of_point(p)]
            cells = [c for _, r in own for c in r.replies]
            if len(own) == len(point.members) and len(cells) == len(set(cells)):
                first = own[0][0].of(point.members[0])
                group = _Group([point], tuple(cells), first.answer, first.unit, [1.0])
                found.append((group, together([r for _, r in own])))
        return found

    def _of_point(self, point: Point) -> list[tuple[_Group, Response]]:
        return [(g, r) for g, r in self._responses if point in g.points]

    def _asked(self, group: _Group) -> list[tuple[str, Record]]:
        return [(v, r) for v, name in group.cells for r in self.records if r.name == name]

    def _of_group(
        self,
        group: _Group,
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

    # -- equations

    @cached_property
    def _groups(self) -> list[_Group]:
        """Equations that residuals answer to, those that answer alike together, a balance first."""
        groups: list[_Group] = []
        for point in sorted(self.opened.points, key=lambda p: not p.balance):
            reached = {v.name for v in self.opened.readers(point)}
            if self.views is not None and not reached & self.views:
                continue  # no need to simulate
            group = self._probed(point)
            answers = {c[0] for c in group.cells} if group else set()
            if group is None or (self.views is not None and not answers & self.views):
                continue
            for other in groups:
                same = group.cells == other.cells and len(group.answer) == len(other.answer)
                cosine = float(group.answer @ other.answer) if same else 0.0
                if abs(cosine) > ALIKE:
                    other.points.append(point)
                    other.factors.append(float(np.sign(cosine)) * other.unit / group.unit)
                    break
            else:
                groups.append(group)
        return groups

    def _probed(self, point: Point) -> _Group | None:
        """An equation's answer to a slow wave in the first record that answers, the one with the
        largest residuals first.
        """
        sizes = {
            r.name: sum(float(w @ w) for c, w in self.base.white.items() if c[1] == r.name)
            for r in self.records
        }
        for record in sorted(self.records, key=lambda r: -sizes[r.name]):
            cells, answer, unit = self._probe(point, record)
            if unit > 0:
                names = {c[0] for c in cells}
                every = tuple(c for c in sorted(self.base.white) if c[0] in names)
                return _Group([point], every, answer, unit, [1.0])
        return None

    def _probe(self, point: Point, record: Record) -> tuple[list[Cell], Array, float]:
        """Cells that answer, their answers one behind the other (of length 1), and the size that
        changes them by one noise level; 0: nothing answers.
        """
        wave = np.sin(WAVE * np.arange(record.rows) * record.period)
        views = [v for v in self.opened.readers(point) if (v.name, record.name) in self.base.white]
        size = FIRST
        for _ in range(PROBES):
            told: dict[Cell, Array] = {}
            for view in views:
                cell = (view.name, record.name)
                change = self._answers(view, record, point)([size * wave])[0]
                told[cell] = self.base.whitened(cell, change)
            rms = max((float(np.sqrt(np.mean(t**2))) for t in told.values()), default=0.0)
            if not 0.0 < rms < np.inf:
                return [], np.zeros(0), 0.0
            if 1 / NEAR < rms < NEAR:
                break
            size /= rms
        cells = sorted(c for c in told if np.any(told[c]))
        whole = np.concatenate([told[c] for c in cells])
        return cells, whole / np.linalg.norm(whole), size / rms

    def _answers(
        self, view: OpenedView, record: Record, point: Point
    ) -> Callable[[Sequence[Array]], Array]:
        """Changes of a view's residual (n, rows, signals) with series of an addend, either way."""
        quiet, own = self.quiet[record.name], self.values[record.name]
        cell, signal = (view.name, record.name), self.opened.signal(point)
        if cell not in self._zero:
            self._zero[cell] = view.answers(quiet, own, [{}])[0]

        def answer(series: Sequence[Array]) -> Array:
            fed = [{point.variable: s} for s in series]
            return np.asarray(view.answers(quiet, own, fed) - self._zero[cell])

        def misread(series: Sequence[Array]) -> Array:
            read = quiet.signals
            true = [{**read, signal: read[signal] - s} for s in series]
            # a view tells records by their names
            runs = [(replace(quiet, name=f"{k}", signals=t), own) for k, t in enumerate(true)]
            changes = np.stack(view.residuals(runs)) - self._zero[cell]
            view.forget()
            return changes

        return both_ways(misread if signal else answer)

    def _reply(self, group: _Group, view: OpenedView, record: Record) -> Reply | None:
        cell, block = (view.name, record.name), blocks_of(view, record)
        height = record.rows // view.decimation
        sigma = np.array([w.sigma for w in self.base.weighing.noise[cell]])
        most = int(np.clip(WORK / record.rows, 3, PULSES))
        pulses = Pulses(cell, record.rows, height, block, block // view.decimation, sigma, most)
        answer = self._answers(view, record, group.points[0])
        return reply_of(pulses, answer, PULSE * group.unit)

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
        of_sensor = {v for v in every if signal in self.of_name[v].signals}
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
        group: _Group,
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


def _among(shapes: Array, k: int, count: int) -> Array:
    """Shapes (rows, n) as the k-th of so many records' own ones."""
    n = shapes.shape[1]
    return np.pad(shapes, ((0, 0), (n * k, n * (count - 1 - k))))


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
