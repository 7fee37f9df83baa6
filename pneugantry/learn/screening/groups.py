"""How residuals answer to an addend in each equation, simulated once; equations that they answer to
alike are one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pneugantry.engine.plant import Array, Record
from pneugantry.engine.threads import on_threads
from pneugantry.engine.views.simulation import Cell
from pneugantry.learn.equations.points import Opened, OpenedView, Point
from pneugantry.learn.screening.linear import Base, Response, response_of, together
from pneugantry.learn.screening.reply import Pulses, Reply, blocks_of, both_ways, reply_of

__all__ = ["WAVE", "Answers", "Group"]

WAVE = 9.0  # rad/s, of the term that probes an equation
FIRST = 1e-3  # its size at first
PROBES = 3
NEAR = 5.0  # factor by which its answer may miss one noise level
PULSE = 10.0  # size of a first pulse, in units of the wave's
PULSES = 24  # simulations of a record for an equation's reply, at most, each of them both ways
WORK = 1e6  # rows of all of them one way, at most
ALIKE = 0.97  # cosine of the answers to one term from which on two equations are one


@dataclass(frozen=True, eq=False)
class Group:
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

    def of(self, point: Point) -> Group:
        """The same with another equation first."""
        rest = [p for p in self.points if p != point]
        factor = self.factor(point)
        order = [point, *rest]
        factors = [self.factor(p) / factor for p in order]
        return Group(order, self.cells, self.answer, self.unit / abs(factor), factors)


@dataclass(eq=False)
class Answers:
    """What an addend does to what a fit leaves. quiet: records whose addends are 0, by name.
    values: of the fit, by record. views: only equations that reach one of these; None: all.
    """

    opened: Opened
    base: Base
    records: Sequence[Record]
    quiet: Mapping[str, Record]
    values: Mapping[str, Mapping[str, float]]
    views: frozenset[str] | None = None
    _zero: dict[Cell, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.of_name = {v.name: v for v in self.opened.views}

    @cached_property
    def groups(self) -> list[Group]:
        """Equations that residuals answer to, those that answer alike together, a balance first."""
        groups: list[Group] = []
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

    @cached_property
    def responses(self) -> list[tuple[Group, Response]]:
        """Of equations that answer; two records are simulated at a time."""
        asked = [(g, self.of_name[v], r) for g in self.groups for v, r in self._asked(g)]
        told = on_threads(lambda each: self._reply(*each), asked)
        found: list[tuple[Group, Response]] = []
        for group in self.groups:
            known = {
                (v.name, r.name): reply
                for (g, v, r), reply in zip(asked, told, strict=True)
                if g is group and reply is not None
            }
            if known:
                found.append((group, response_of(self.base, known)))
        return found

    @cached_property
    def in_common(self) -> list[tuple[Group, Response]]:
        """What several components have in common, where each one answers in cells of its own."""
        found: list[tuple[Group, Response]] = []
        for point in self.opened.shared:
            own = [(g, r.times(g.factor(p))) for p in point.members for g, r in self._of_point(p)]
            cells = [c for _, r in own for c in r.replies]
            if len(own) == len(point.members) and len(cells) == len(set(cells)):
                first = own[0][0].of(point.members[0])
                group = Group([point], tuple(cells), first.answer, first.unit, [1.0])
                found.append((group, together([r for _, r in own])))
        return found

    def _of_point(self, point: Point) -> list[tuple[Group, Response]]:
        return [(g, r) for g, r in self.responses if point in g.points]

    def _asked(self, group: Group) -> list[tuple[str, Record]]:
        return [(v, r) for v, name in group.cells for r in self.records if r.name == name]

    def _probed(self, point: Point) -> Group | None:
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
                return Group([point], every, answer, unit, [1.0])
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

    def _reply(self, group: Group, view: OpenedView, record: Record) -> Reply | None:
        cell, block = (view.name, record.name), blocks_of(view, record)
        height = record.rows // view.decimation
        sigma = np.array([w.sigma for w in self.base.weighing.noise[cell]])
        most = int(np.clip(WORK / record.rows, 3, PULSES))
        pulses = Pulses(cell, record.rows, height, block, block // view.decimation, sigma, most)
        answer = self._answers(view, record, group.points[0])
        return reply_of(pulses, answer, PULSE * group.unit)
