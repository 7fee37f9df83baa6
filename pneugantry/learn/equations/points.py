"""Where a missing term may enter: every equation of every component that a plant declares, and what
each sensor reads.

Each such equation gets one more addend, which is 0 in the plant and an input of the views: any
series of values can be fed to it, and the residuals answer.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np

from modelica_fmu.batch import Drive
from modelica_fmu.compiled import Structure
from modelica_fmu.files import write_atomically
from pneugantry.engine.plant import Array, Plant, Record, Signal
from pneugantry.engine.signals.readings import Filtered
from pneugantry.engine.signals.sensors import PREFIX
from pneugantry.engine.views.model_parts import part_of
from pneugantry.engine.views.subsystem import RATE, SubsystemView
from pneugantry.engine.views.view import View
from pneugantry.learn.equations.sources import (
    Addition,
    Declared,
    EquationText,
    components_of,
    declared_in,
    equations_of,
    with_additions,
)

__all__ = [
    "Opened",
    "Point",
    "Shared",
    "named_again",
    "opened",
    "recut",
    "signal_at",
    "stored",
    "written",
]

Values = Mapping[str, float]
Series = Mapping[str, Array]
NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*$")


@dataclass(frozen=True)
class Shared:
    """The same equation of several components of the plant's own class, which a common cause
    reaches: what is added is one and the same.
    """

    components: tuple[str, ...]
    declared: tuple[Declared, ...]
    section: int  # of the plant's own equations: offset into the file's text


@dataclass(frozen=True)
class Point:
    """An equation of one component, or of several with a common cause."""

    component: str  # path of the component; "" for the plant's own class
    equation: EquationText
    sensor: bool = False  # whether it says what a sensor reads
    shared: Shared | None = None  # by the first component and others
    declared: Declared | None = None  # its component, where a class of the file declares it
    fed: tuple[tuple[str, str], ...] = field(default=(), compare=False)  # measured states that the
    # class that declares its component has and the component has not: in the whole plant, and as
    # that class calls them; of one of several components with a common cause none; of a sensor what
    # others read

    @property
    def name(self) -> str:
        """The addend's own name within its class."""
        return f"missing_{self.equation.number}"

    @property
    def prefix(self) -> str:
        """Of the component's variables in the whole plant."""
        return f"{self.component}." if self.component else ""

    @property
    def variable(self) -> str:
        """The addend in the whole plant."""
        return self.prefix + self.name

    @property
    def members(self) -> tuple[Point, ...]:
        """It for each of its components."""
        if self.shared is None:
            return (self,)
        named = zip(self.shared.components, self.shared.declared, strict=True)
        return tuple(replace(self, component=c, shared=None, declared=d, fed=()) for c, d in named)

    def given(self, variable: str) -> str:
        """What it is fed of the whole plant, as the class that declares its component calls it."""
        return dict(self.fed)[variable]

    @property
    def scope(self) -> str:
        """Path of the component whose variables a term may be a function of: what a sensor reads is
        one of these.
        """
        path = self.equation.right.strip().rpartition(".")[0]
        return self.prefix + path if self.sensor else self.component

    @property
    def scope_prefix(self) -> str:
        """Of the scope's variables in the whole plant."""
        return f"{self.scope}." if self.scope else ""

    @property
    def rate(self) -> str:
        """Its left-hand side, where that is how fast a state changes times what is inert: a mass or
        a capacity that varies is a share of it. "": it is none, or says no more than what is whose
        rate.
        """
        left = " ".join(self.equation.left.split())
        return left if "der(" in left and not NAME.match(self.equation.right.strip()) else ""

    @property
    def rate_variable(self) -> str:
        """What its left-hand side is without the addend, in the whole plant."""
        return f"{self.variable}_rate"

    @property
    def left(self) -> str:
        """What its equation computes, as its class calls it."""
        return self.equation.left

    def spelt(self, variable: str) -> str:
        """A variable of the scope, as the equation's class calls it; or its left-hand side."""
        if variable and variable == self.rate:
            return f"({variable})"
        path = self.scope.removeprefix(self.prefix) if self.sensor else ""
        return f"{path}.{variable}" if path else variable

    def is_read(self, variable: str) -> bool:
        """Whether a variable of the scope is what its sensor reads."""
        return self.sensor and self.spelt(variable) == self.equation.right.strip()

    @property
    def balance(self) -> bool:
        """Whether it is solved for no variable of its own: a balance, or a state's rate."""
        return not NAME.match(self.equation.left)

    def reads(self, variable: str) -> bool:
        """Whether a variable of the scope stands on its right-hand side, or is its left one."""
        if variable and variable == self.rate:
            return True
        word = rf"(?<![\w.]){re.escape(self.spelt(variable))}(?![\w.])"
        return re.search(word, self.equation.right) is not None

    @property
    def text(self) -> str:
        """The equation as a reader knows it."""
        return f"{self.equation.left} = {' '.join(self.equation.right.split())}"


@dataclass(eq=False)
class OpenedView(SubsystemView):
    """A view whose equations have an addend each."""

    addends: frozenset[str] = frozenset()  # inputs that are 0 where nothing is fed to them

    def answers(self, record: Record, values: Values, fed: Sequence[Series]) -> Array:
        """Residuals (len(fed), rows, signals) of a record under each set of series: addend ->
        (rows,), the same ones in each. What is measured is smoothed once for all of them.
        """
        own = {k: v for k, v in values.items() if self.depends_on(k)}
        base = {**self.plant.settings, **self.plant.parameters, **record.parameters, **own}
        model = {k: v for k, v in base.items() if k in self._parameters}
        piece = self._pieces.smallest(model)
        drive = self._drive(record, piece, self._felt(piece, own))
        names = sorted(piece.parameters.intersection(model))
        table = np.array([[model[n] for n in names]])
        variables = {s.name: s.variable for s in self.plant.signals}
        outputs = [variables[n] for n in self.signals]
        known = {n: c for n, c in drive.inputs.items() if n not in self.addends}
        drives = [
            Drive(
                {**known, **{n: v for n, v in series.items() if n in drive.inputs}},
                drive.correction,
            )
            for series in fed
        ]
        runs, which = np.repeat(table, len(fed), axis=0), range(len(fed))
        made = piece.subsystem.runs(names, runs, drives, outputs, record.period, which)
        return np.stack([self.error(record, simulated, own) for simulated in made])


@dataclass(frozen=True, eq=False)
class Opened:
    """A plant whose equations have an addend each."""

    plant: Plant  # the addends are inputs of it
    points: tuple[Point, ...]
    views: tuple[OpenedView, ...]
    shape: Structure
    deciders: Mapping[str, frozenset[str]]  # of each variable, no state between
    cache: Path
    shared: tuple[Point, ...] = ()  # equations that several components have

    def is_speed(self, variable: str) -> bool:
        """Whether a variable of the whole plant is a state that is another state's rate."""
        shape = self.shape
        return shape.roots.get(variable) in shape.states & set(shape.rates.values())

    def decides(self, point: Point, variable: str) -> bool:
        """Whether what an equation lacks decides a variable at once: as a function of that it would
        explain itself.
        """
        return point.variable in self.deciders.get(variable, ())

    def readers(self, point: Point) -> list[OpenedView]:
        """Views that an addend reaches; of a sensor's error those that take its readings as known,
        too.
        """
        signal = self.signal(point)
        if signal:
            return [v for v in self.views if v.depends_on(f"{PREFIX}{signal}.bias")]
        return self.fed(point)

    def fed(self, point: Point) -> list[OpenedView]:
        """Views whose equations have an addend."""
        own = {p.variable for p in point.members}
        return [v for v in self.views if own.intersection(v.part.of("input"))]

    def signal(self, point: Point) -> str:
        """The one whose sensor's error an addend is; "": it is none."""
        return signal_at(self.plant, point)

    def block(self, point: Point) -> str:
        """Block of the answer that a point lies in."""
        if point.sensor:
            return PREFIX.removesuffix(".")
        path = point.component
        paths = [p for p in self.plant.blocks if path == p or path.startswith(p + ".")]
        if paths:
            return self.plant.blocks[max(paths, key=len)]
        readers = self.readers(point)
        return path or (readers[0].blocks[0] if readers else self.plant.name)

    def quiet(self, record: Record) -> Record:
        """A record whose addends are 0."""
        zero = np.zeros(record.rows)
        inputs = {**record.inputs, **{p.variable: zero for p in self.points}}
        return replace(record, inputs=inputs)

    def variables(self, point: Point) -> list[str]:
        """Real variables of its scope that change with time, each under one name."""
        prefix = point.scope_prefix
        addends = {p.variable for p in self.points}
        found: dict[str, str] = {}
        for name, root in sorted(self.shape.roots.items()):
            own = name.startswith(prefix) and "." not in name[len(prefix) :]
            if own and name in self.shape.numbers - addends and "[" not in name:
                found.setdefault(root, name)
        return sorted(found.values())

    def series(
        self,
        names: Sequence[str],
        records: Sequence[Record],
        values: Mapping[str, Mapping[str, float]],
    ) -> dict[str, Array]:
        """Variables over records: (rows, names) by record, computed from what is measured. values:
        parameters by record.
        """
        like = self.views[0]
        known = _known(self.plant, self.shape)
        addends = [p.variable for p in self.points]
        part = part_of(self.plant, list(names), sorted([*known, *addends]), self.cache)
        sources = {n: known.get(n, n) for n in part.of("input")}
        signals = tuple(Signal(f"{n} ", n, 1.0) for n in names)
        view = replace(
            like,
            name="variables",
            signals=tuple(s.name for s in signals),
            sigmas=(1.0,) * len(names),
            plant=replace(self.plant, signals=(*self.plant.signals, *signals)),
            part=part,
            sources=sources,
            corrected={},
            cut_at=None,
        )
        own = {
            r: {k: v for k, v in given.items() if view.depends_on(k)} for r, given in values.items()
        }
        made = view.simulate([(self.quiet(r), own[r.name]) for r in records])
        return {r.name: found for r, found in zip(records, made, strict=True)}


def _known(plant: Plant, shape: Structure) -> dict[str, str]:
    """Variables that are measured, or whose rate is: root -> signal, or RATE + signal."""
    known = {shape.roots[s.variable]: s.name for s in plant.signals}
    for root, name in list(known.items()):
        rate = shape.rates.get(root)
        if rate is not None:
            known.setdefault(rate, RATE + name)
    return known


def opened(plant: Plant, views: Sequence[View], cache: Path) -> Opened:
    """The plant with an addend in each equation of its components that computes a number from
    others, and in what its sensors read: not in others that only name a variable again. Views of
    another kind are left out.
    """
    from modelica_fmu.cut import deciders, structure  # the compiler is loaded where it has to work

    shape = structure(plant.model, plant.class_name)
    points = tuple(_points(plant, shape))
    model = written(plant, {p.equation: _open(p) for p in points}, cache)
    names = tuple(p.variable for p in points)
    made = replace(plant, model=model, inputs=(*plant.inputs, *names))
    cut_views = tuple(
        _opened_view(v, made, names, cache) for v in views if isinstance(v, SubsystemView)
    )
    decided = deciders(model, plant.class_name)
    return Opened(made, points, cut_views, shape, decided, cache, tuple(_shared(plant, points)))


def _open(point: Point) -> Addition:
    declared, equations = f"  Real {point.name};", f"    {point.name} = 0;"
    if point.rate:
        declared += f"\n  Real {point.name}_rate;"
        equations += f"\n    {point.name}_rate = {point.equation.right};"
    return Addition(declared, point.name, equations)


def recut(
    view: SubsystemView, plant: Plant, cache: Path, further: Sequence[str] = ()
) -> SubsystemView:
    """A view cut from another plant's model at the same variables, and at further ones. It shows
    the same records, whatever the other model remembers besides.
    """
    known = [n for n, source in view.sources.items() if source not in plant.inputs]
    outputs = [next(s.variable for s in plant.signals if s.name == n) for n in view.signals]
    cut_at = tuple(sorted([*known, *further]))
    part = part_of(plant, outputs, cut_at, cache)
    sources = {n: view.sources.get(n, n) for n in part.of("input")}
    same = replace(view, memory=view.remembers)
    return replace(same, plant=plant, part=part, sources=sources, cut_at=cut_at)


def _opened_view(
    view: SubsystemView, plant: Plant, names: Sequence[str], cache: Path
) -> OpenedView:
    made = replace(recut(view, plant, cache, names), readings=Filtered())  # it forgets
    own = {f.name: getattr(made, f.name) for f in fields(made)}
    return OpenedView(**own, addends=frozenset(names))


def _points(plant: Plant, shape: Structure) -> list[Point]:
    equations = equations_of(plant.model)
    read = {s.variable for s in plant.signals}
    components = components_of(plant.model, plant.class_name)
    declared = declared_in(plant.model, components)
    found = []
    for component, classes in components.items():
        place = declared.get(component)
        fed = _fed(plant, shape, component) if place else ()
        for e in equations:
            if e.of_class not in classes:
                continue
            if _computes(e, component, shape):
                found.append(Point(component, e, declared=place, fed=fed))
            elif not component and e.left in read and named_again(e):
                sensor = Point(component, e, sensor=True)
                found.append(replace(sensor, fed=_elsewhere(plant, shape, sensor.scope)))
    return found


def _fed(plant: Plant, shape: Structure, component: str) -> tuple[tuple[str, str], ...]:
    """Measured states that a component lacks and the class that declares it can give to it."""
    path = component.rpartition(".")[0]
    around, own = _roots_of(shape, path), _roots_of(shape, component)
    if not path:
        around |= {shape.roots[s.variable]: s.variable for s in plant.signals}
    lacked = [s.variable for s in plant.signals if "[" not in s.variable]
    lacked = [n for n in lacked if shape.roots[n] in shape.states - own.keys()]
    return tuple((n, around[shape.roots[n]]) for n in lacked if shape.roots[n] in around)


def signal_at(plant: Plant, point: Point) -> str:
    """The one whose sensor's error an addend is; "": it is none."""
    signals = plant.signals if point.sensor else ()
    return next((s.name for s in signals if s.variable == point.equation.left), "")


def _elsewhere(plant: Plant, shape: Structure, scope: str) -> tuple[tuple[str, str], ...]:
    """What other sensors read outside of a component: one may leak into another."""
    if not scope:  # all is inside
        return ()
    own = {root for name, root in shape.roots.items() if name.startswith(f"{scope}.")}
    read = [s.variable for s in plant.signals if "[" not in s.variable]
    return tuple((n, n) for n in read if shape.roots[n] not in own)


def _roots_of(shape: Structure, path: str) -> dict[str, str]:
    """Variables of a component, as its class calls them, by their root."""
    prefix = f"{path}." if path else ""
    own = [n for n in shape.roots if n.startswith(prefix) and n in shape.numbers]
    names = {n: n.removeprefix(prefix) for n in sorted(own)}
    return {shape.roots[n]: name for n, name in names.items() if not set(".[") & set(name)}


def _shared(plant: Plant, points: Sequence[Point]) -> list[Point]:
    """Equations that several components of the plant's own class have."""
    of_plant = tuple(plant.class_name.split("."))
    section = next((e.section for e in equations_of(plant.model) if e.of_class == of_plant), None)
    if section is None:
        return []
    same: dict[EquationText, list[Point]] = {}
    for point in points:
        if point.declared is not None and "." not in point.component:
            same.setdefault(point.equation, []).append(point)
    found = []
    for members in (m for m in same.values() if len(m) > 1):
        paths = tuple(p.component for p in members)
        shared = Shared(paths, tuple(p.declared for p in members if p.declared), section)
        found.append(replace(members[0], shared=shared, fed=()))
    return found


def named_again(e: EquationText) -> bool:
    """Whether an equation only names a variable again."""
    return NAME.match(e.right.strip()) is not None


def _computes(e: EquationText, component: str, shape: Structure) -> bool:
    """Whether an equation computes a real number from more than one other variable's name."""
    if named_again(e) or re.fullmatch(r"[-+\d.eE]+", e.right.strip()):
        return False
    if e.kind in ("Boolean", "Integer", "String"):
        return False
    prefix = f"{component}." if component else ""
    left = re.sub(r"^der\((.*)\)$", r"\1", e.left.replace(" ", ""))
    return not NAME.match(left) or prefix + left in shape.roots


def written(plant: Plant, additions: Mapping[EquationText, Addition], folder: Path) -> Path:
    """The plant's Modelica file with the additions, in a folder of its own."""
    return stored(plant, with_additions(plant.model.read_text(encoding="utf-8"), additions), folder)


def stored(plant: Plant, text: str, folder: Path) -> Path:
    """The plant's Modelica file with another text, in a folder of its own."""
    key = hashlib.sha256(text.encode()).hexdigest()[:16]
    path = folder / "models" / key / plant.model.name
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    return path
