"""Residual views: the smallest part of the plant that computes a measured signal from inputs and
other measured signals, and what is left between both.

Positions and their speeds, where both are measured, are smoothed together. A part whose states
switch at events is held to its measured states by an observer of fixed gain, so that an event that
the model misses costs what it is worth and no more.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from modelica_fmu.batch import (
    Correction,
    Course,
    Drive,
    Part,
    Subsystem,
    build_part,
    part_key,
    read_part,
)
from modelica_fmu.compiled import Structure
from modelica_fmu.errors import InputError
from pneugantry.engine.plant import Array, Plant, Record, Signal
from pneugantry.engine.recent import Recent
from pneugantry.engine.rules import Rules
from pneugantry.engine.signals.readings import Readings
from pneugantry.engine.signals.sensors import PREFIX, sensed, signal_of
from pneugantry.engine.threads import on_threads
from pneugantry.engine.views.pieces import Piece, Pieces

__all__ = [
    "Measured",
    "Run",
    "SubsystemView",
    "View",
    "build_views",
    "known_variables",
    "part_of",
    "view_beside",
]

Values = Mapping[str, float]
Run = tuple[Record, Values]  # over a record, with these parameters; the rest as usual
Errors = tuple[tuple[str, float], ...]  # of sensors
_Felt = tuple[str, Errors, tuple[float, ...]]  # record, errors, parameters: what makes a run
LONGEST_STEP = 0.002  # s, of the solver; its tolerance bounds the error, rows read no finer
KEPT = 64  # drives that a view keeps, and inputs of its own
RATE = "der "  # before a signal's name: its rate, taken from its readings


class View(Protocol):
    """Readings less what a part of the plant makes of the other readings."""

    name: str
    signals: tuple[str, ...]  # columns of the residual
    blocks: tuple[str, ...]  # of each of them
    sigmas: tuple[float, ...]  # quoted noise of a row of the residual
    decimation: int  # rows of the record that make one of the residual

    @property
    def defaults(self) -> Mapping[str, float]:
        """The model's own values of the parameters that it reads."""
        ...

    @property
    def remembers(self) -> bool:
        """Whether anything that happened keeps on: what has no memory has no event to miss."""
        ...

    def shows(self, record: Record) -> bool: ...

    def depends_on(self, parameter: str) -> bool: ...

    def prepare(self, moving: Collection[str], settings: Values) -> None:
        """Told before many runs in which `moving` may move, `settings` keep these values and other
        parameters the model's own.
        """

    def residuals(self, runs: Sequence[Run]) -> list[Array]:
        """(rows, signals) of each run in the signals' own units; NaN: it failed."""
        ...


@dataclass(eq=False)
class SubsystemView:
    """A part of the model, cut out at what is measured."""

    name: str
    signals: tuple[str, ...]
    blocks: tuple[str, ...]
    sigmas: tuple[float, ...]
    decimation: int
    plant: Plant
    part: Part
    sources: Mapping[str, str]  # input of the part -> input of the plant, signal, or RATE + signal
    corrected: Mapping[str, str]  # state -> signal
    pairs: Mapping[str, str]  # position -> speed, both measured
    observer: float  # s, time constant of the correction
    cut_at: tuple[str, ...] | None = None  # variables; None: it is not cut again
    subsystem: Subsystem | None = None  # None: that of the part
    memory: bool | None = None  # whether it remembers; None: whether the part has states

    def __post_init__(self) -> None:
        whole = Piece(self.part, subsystem=self.subsystem)
        self._pieces = Pieces(whole, self.defaults, self._again if self.cut_at else None)
        self._drives: Recent[Drive] = Recent(KEPT)
        self._commands: Recent[Course] = Recent(KEPT)
        self._readings = Readings(
            {s.name: s.sigma for s in self.plant.signals},
            self.pairs,
            frozenset(self.corrected.values()),
            self.remembers,
        )
        self._parameters = frozenset(self.part.of("parameter"))
        self._read = {
            s.removeprefix(RATE)
            for s in (*self.sources.values(), *self.corrected.values())
            if s.removeprefix(RATE) not in self.plant.inputs
        }
        self._all = {*self._read, *self.signals}
        self._names: dict[tuple[str, ...], tuple[str, ...]] = {}

    @property
    def known(self) -> frozenset[str]:
        """Measured signals that it takes as known."""
        return frozenset(self._read)

    @property
    def defaults(self) -> Mapping[str, float]:
        found = [v for v in self.part.variables if v.kind == "parameter"]
        return {v.name: v.start for v in found if v.start is not None}

    @property
    def remembers(self) -> bool:
        return bool(self.part.of("state")) if self.memory is None else self.memory

    def shows(self, record: Record) -> bool:
        if not self._all <= set(record.signals):
            return False
        if not self.remembers:
            return True
        quiet = [
            np.ptp(np.convolve(record.signals[s], np.ones(25) / 25, "valid")) < 3 * sigma
            for s, sigma in zip(self.signals, self._quoted(), strict=True)
        ]
        return not all(quiet)

    def _quoted(self) -> list[float]:
        return [s * np.sqrt(self.decimation) for s in self.sigmas]

    def depends_on(self, parameter: str) -> bool:
        if parameter.startswith(PREFIX):
            return signal_of(parameter) in self._all
        return parameter in self._parameters

    def _again(self, fixed: Values) -> Part:
        """The part with some parameters fixed, in the folder where it lies itself."""
        variables = {s.name: s.variable for s in self.plant.signals}
        outputs = [variables[n] for n in self.signals]
        cache = self.part.library.parent.parent
        return part_of(self.plant, outputs, self.cut_at or (), cache, fixed)

    def prepare(self, moving: Collection[str], settings: Values) -> None:
        given = {*self.plant.parameters, *self.plant.settings, *moving}
        self._pieces.prepare(given, settings)

    def residuals(self, runs: Sequence[Run]) -> list[Array]:
        own = [(r, {k: given[k] for k in self._own(given)}) for r, given in runs]
        made = zip(own, self.simulate(own), strict=True)
        return [self.error(record, simulated, given) for (record, given), simulated in made]

    def _own(self, given: Values) -> tuple[str, ...]:
        """Names of what it depends on."""
        every = tuple(given)
        if every not in self._names:
            self._names[every] = tuple(k for k in every if self.depends_on(k))
        return self._names[every]

    def error(self, record: Record, simulated: Array, values: Values) -> Array:
        """Residual (rows, signals) of true signals (N, signals) under sensors' errors. Means of the
        differences, not differences of means: these would have fewer digits (0129).
        """
        each, end = self.decimation, record.rows - record.rows % self.decimation
        result = np.empty((record.rows // each, len(self.signals)))
        for c, signal in enumerate(self.signals):
            error = record.signals[signal] - sensed(signal, simulated[:, c], record, values)
            if record.judged is not None and self.corrected:
                error[~record.judged] = 0.0
            result[:, c] = error[:end].reshape(-1, each) @ np.full(each, 1 / each)
        return result

    def simulate(self, runs: Sequence[Run]) -> list[Array]:
        """True signals (N, signals) of each run; those that feel the same are one."""
        records = {r.name: r for r, _ in runs}
        bases = {name: self._base(r) for name, r in records.items()}
        models = [
            bases[r.name] | {k: v for k, v in given.items() if not k.startswith(PREFIX)}
            for r, given in runs
        ]
        names = sorted({n for m in models for n in m})
        drives: dict[tuple[Piece, str, Errors], Drive] = {}
        groups: dict[tuple[Piece, float, int], dict[_Felt, list[int]]] = {}
        for i, ((record, given), model) in enumerate(zip(runs, models, strict=True)):
            piece = self._pieces.smallest(model)
            errors = self._felt(piece, given)
            key = piece, record.name, errors
            drive = drives[key] = drives.get(key) or self._drive(record, piece, errors)
            row = tuple(
                model.get(n, self._pieces.defaults.get(n, 0.0))
                for n in names
                if n in piece.parameters
            )
            group = groups.setdefault((piece, record.period, drive.parts), {})
            group.setdefault((record.name, errors, row), []).append(i)
        variables = {s.name: s.variable for s in self.plant.signals}
        result: list[Array] = [np.empty((0, 0))] * len(runs)
        for (piece, period, _), own in groups.items():
            driven = {k: i for i, k in enumerate(dict.fromkeys(felt[:2] for felt in own))}
            made = piece.subsystem.runs(
                [n for n in names if n in piece.parameters],
                np.array([row for _, _, row in own]),
                [drives[piece, *k] for k in driven],
                [variables[n] for n in self.signals],
                period,
                [driven[felt[:2]] for felt in own],
            )
            for run, members in zip(made, own.values(), strict=True):
                for i in members:
                    result[i] = run
        return result

    def _base(self, record: Record) -> dict[str, float]:
        """Parameters of the part over a record, where nothing moves."""
        longest = min(record.period, LONGEST_STEP)
        base = {"solver.max_step": longest, **self.plant.settings}
        base |= {**self.plant.parameters, **record.parameters}
        return {k: v for k, v in base.items() if k in self._parameters}

    def _felt(self, piece: Piece, given: Values) -> Errors:
        """Errors of the sensors that a piece reads."""
        read = {
            source.removeprefix(RATE)
            for name, source in (*self.sources.items(), *self.corrected.items())
            if name in piece.inputs or name in piece.states
        }
        sensors = ((k, v) for k, v in given.items() if k.startswith(PREFIX))
        return tuple(sorted((k, v) for k, v in sensors if signal_of(k) in read))

    def _drive(self, record: Record, piece: Piece, felt: Errors) -> Drive:
        """Inputs and corrected states of a piece, from a record whose sensors have these errors."""
        key = (record, piece, felt)
        return self._drives.of(key, lambda: self._driven(record, piece, felt))

    def _driven(self, record: Record, piece: Piece, felt: Errors) -> Drive:
        errors, readings = dict(felt), self._readings
        inputs: dict[str, Course] = {}
        for name, source in self.sources.items():
            if name not in piece.inputs:
                continue
            if source in self.plant.inputs:
                inputs[name] = self._command(record, source)
            else:
                made = readings.rate if source.startswith(RATE) else readings.value
                inputs[name] = made(source.removeprefix(RATE), record, errors)
        correction = None
        drawn = {state: s for state, s in self.corrected.items() if state in piece.states}
        if drawn:
            share = 1 - np.exp(-record.period / (self.observer))
            measured = [readings.value(s, record, errors).at for s in drawn.values()]
            correction = Correction(tuple(drawn), np.column_stack(measured), (share,) * len(drawn))
        return Drive(inputs, correction)

    def _command(self, record: Record, name: str) -> Course:
        """An input of the plant."""

        def made() -> Course:
            return Course.of(record.driving(name) if self.remembers else record.inputs[name])

        return self._commands.of((record, name), made)


@dataclass(frozen=True, eq=False)
class Measured:
    """What records hold of the signals, beside their names. coarse: signals that a signal's view
    does not take as known, for they are measured too coarsely. held: signals of each record; those
    share no view that some record holds one of without the other.
    """

    coarse: Mapping[str, frozenset[str]] = field(default_factory=dict)
    held: Sequence[Collection[str]] = ()


@dataclass(frozen=True, eq=False)
class _Sight:
    """What is measured of a plant, and how that hangs together."""

    plant: Plant
    shape: Structure
    signals: Mapping[str, Signal]  # measured, by name
    cache: Path
    coarse: Mapping[str, frozenset[str]] = field(default_factory=dict)  # see `Measured`

    def root(self, signal: str) -> str:
        return self.shape.roots[self.signals[signal].variable]

    @property
    def pairs(self) -> dict[str, str]:
        """Position -> its speed, where both are measured."""
        return {
            a: b
            for a in self.signals
            for b in self.signals
            if self.root(a) in self.shape.states
            and self.shape.rates.get(self.root(a)) == self.root(b)
        }


def build_views(
    plant: Plant,
    measured: Sequence[str],
    cache: Path,
    period: float,
    rules: Rules,
    known: Measured | None = None,
) -> list[SubsystemView]:
    """One view for each measured signal; signals that the same part computes share one.

    period: s, between a record's rows. Raises InputError for a signal whose variable the model
    lacks.
    """
    known = known or Measured()
    shape = _structure(plant, cache)
    signals = {s.name: s for s in plant.signals if s.name in measured}
    for signal in signals.values():
        if signal.variable not in shape.roots:
            raise InputError(
                f"{plant.class_name} has no variable of that name that changes with time",
                file=plant.model,
                field=signal.variable,
                hint=f"correct the variable of the signal {signal.name}",
            )
    sight = _Sight(plant, shape, signals, cache, known.coarse)
    decimation = max(1, round(1 / (rules.band * period)))
    grouped: dict[tuple[object, ...], list[str]] = {}
    for name, own in zip(signals, on_threads(lambda n: _cut(sight, [n]), signals), strict=True):
        where = tuple(name in held for held in known.held)
        grouped.setdefault((where, _same(*own)), []).append(name)
    return on_threads(lambda n: _view(sight, n, decimation, rules.observer), grouped.values())


def view_beside(plant: Plant, signal: str, cache: Path, like: SubsystemView) -> SubsystemView:
    """The view of one more signal, cut at all others of the plant, with another view's timing."""
    sight = _Sight(plant, _structure(plant, cache), {s.name: s for s in plant.signals}, cache)
    return _view(sight, [signal], like.decimation, like.observer)


def _view(sight: _Sight, names: Sequence[str], decimation: int, observer: float) -> SubsystemView:
    """The view of signals that one part computes."""
    part, sources, corrected = _cut(sight, names)
    return SubsystemView(
        name=sight.root(names[0]),
        signals=tuple(names),
        blocks=tuple(_block(sight.plant, sight.root(n)) for n in names),
        sigmas=tuple(float(sight.signals[n].sigma / np.sqrt(decimation)) for n in names),
        decimation=decimation,
        plant=sight.plant,
        part=part,
        sources=sources,
        corrected=corrected,
        pairs=sight.pairs,
        observer=observer,
        cut_at=tuple(sorted(_known(sight, names))),
    )


def _known(sight: _Sight, own: Sequence[str]) -> dict[str, str]:
    """Variables known to a view of the signals `own`: other signals, and rates of those that are
    states; but no state whose rate is one of `own`: it follows from it.
    """
    rates, roots = sight.shape.rates, {sight.root(o) for o in own}
    coarse = frozenset().union(*(sight.coarse.get(o, frozenset()) for o in own))
    known = {
        sight.root(other): other
        for other in sight.signals
        if other not in own and other not in coarse and rates.get(sight.root(other)) not in roots
    }
    for other in list(known.values()):
        rate = rates.get(sight.root(other))
        if rate is not None and rate not in known and rate not in roots:
            known[rate] = RATE + other
    return known


def _cut(sight: _Sight, own: Sequence[str]) -> tuple[Part, dict[str, str], dict[str, str]]:
    """The part that computes some signals; where its inputs come from; states that are measured,
    where some of them switch.
    """
    known = _known(sight, own)
    outputs = [sight.signals[n].variable for n in own]
    part = part_of(sight.plant, outputs, sorted(known), sight.cache)
    sources = {n: known.get(n, n) for n in part.of("input")}
    coarse = frozenset().union(*(sight.coarse.get(o, frozenset()) for o in own))
    signal = {sight.root(n): n for n in sight.signals if n not in coarse}
    corrected = {s: signal[s] for s in part.of("state") if s in signal}
    return part, sources, corrected if part.switching & set(corrected) else {}


def _same(
    part: Part, sources: Mapping[str, str], corrected: Mapping[str, str]
) -> tuple[object, ...]:
    """Equal for parts that one simulation computes."""
    if not part.of("state"):
        return tuple(sorted(part.of("parameter")))
    states = tuple(sorted(part.of("state")))
    return states, tuple(sorted(sources.items())), tuple(sorted(corrected.items()))


def part_of(
    plant: Plant,
    outputs: Sequence[str],
    known: Sequence[str],
    cache: Path,
    fixed: Values | None = None,
) -> Part:
    """The part that computes `outputs` from inputs and `known` variables, built once. fixed:
    parameters that are numbers in it.
    """
    what = (plant.class_name, list(outputs), list(known), sorted((fixed or {}).items()))
    key = part_key(plant.model, repr(what))
    part = read_part(cache, key)
    if part is None:
        from modelica_fmu.cut import cut  # the compiler is loaded where it has to work

        part = build_part(cut(plant.model, plant.class_name, outputs, known, fixed), cache, key)
    return part


def known_variables(plant: Plant, cache: Path) -> tuple[Mapping[str, str], frozenset[str]]:
    """Variable -> the one that it is another name of; those that are states."""
    shape = _structure(plant, cache)
    return shape.roots, shape.states


def _structure(plant: Plant, cache: Path) -> Structure:
    key = part_key(plant.model, f"structure of {plant.class_name}")
    path = cache / f"{key}.json"
    if path.is_file():
        told = json.loads(path.read_text(encoding="utf-8"))
        states, numbers = frozenset(told["states"]), frozenset(told["numbers"])
        return Structure(told["roots"], states, told["rates"], numbers, told["units"])
    from modelica_fmu.cut import structure

    shape = structure(plant.model, plant.class_name)
    path.parent.mkdir(parents=True, exist_ok=True)
    told = {
        "roots": dict(shape.roots),
        "states": sorted(shape.states),
        "rates": dict(shape.rates),
        "numbers": sorted(shape.numbers),
        "units": dict(shape.units),
    }
    path.write_text(json.dumps(told), encoding="utf-8")
    return shape


def _block(plant: Plant, variable: str) -> str:
    """Block of a variable: that of the longest component path it lies in that has one; else its
    component, or itself in a model without components.
    """
    paths = [p for p in plant.blocks if variable == p or variable.startswith(p + ".")]
    if paths:
        return plant.blocks[max(paths, key=len)]
    return variable.rpartition(".")[0] or variable
