"""Residual views: the smallest part of the plant that computes a measured signal from inputs and
other measured signals, and what is left between both.

Positions and their speeds, where both are measured, are smoothed together. A part whose states
switch at events is held to its measured states by an observer of fixed gain, so that an event that
the model misses costs what it is worth and no more.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from modelica_fmu.batch import Correction, Course, Drive, Part, Subsystem
from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.engine.recent import Recent
from pneugantry.engine.signals.commands import PREFIX as OF_INPUTS
from pneugantry.engine.signals.commands import Lateness, acting, input_of, lateness, outside
from pneugantry.engine.signals.readings import Filtered, Readings
from pneugantry.engine.signals.sensors import PREFIX, read_with, sensed
from pneugantry.engine.views.model_parts import longest_step, part_of
from pneugantry.engine.views.pieces import Piece, Pieces
from pneugantry.engine.views.view import Run, Values

__all__ = ["RATE", "SubsystemView"]

Errors = tuple[tuple[str, float], ...]  # of sensors and inputs
_Felt = tuple[str, Errors, tuple[float, ...]]  # record, errors, parameters: what makes a run
LONGEST_STEP = 0.002  # s, of the solver; its tolerance bounds the error, rows read no finer
KEPT = 64  # drives that a view keeps, and inputs of its own
RATE = "der "  # before a signal's name: its rate, taken from its readings


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
    readings: Filtered = field(default_factory=Filtered)  # of all views of the plant

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
            self.readings,
        )
        self._parameters = frozenset(self.part.of("parameter"))
        self._read = {
            s.removeprefix(RATE)
            for s in (*self.sources.values(), *self.corrected.values())
            if s.removeprefix(RATE) not in self.plant.inputs
        }
        self._all = {*self._read, *self.signals}
        self._commanded = {s for s in self.sources.values() if s in self.plant.inputs}
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
        quoted = {s.name: s.sigma for s in self.plant.signals}
        return [quoted[s] for s in self.signals]

    def depends_on(self, parameter: str) -> bool:
        if parameter.startswith(PREFIX):
            return not self._all.isdisjoint(read_with(parameter))
        if parameter.startswith(OF_INPUTS):
            return input_of(parameter) in self._commanded
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

    def forget(self) -> None:
        """Drops what is kept of records, by all views with these readings: none is shown again."""
        self._drives.clear()
        self.readings.forget()

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
            error[: record.first] = 0.0
            if record.judged is not None and self.corrected:
                error[~record.judged] = 0.0
            result[:, c] = error[:end].reshape(-1, each) @ np.full(each, 1 / each)
        return result

    def simulate(self, runs: Sequence[Run]) -> list[Array]:
        """True signals (N, signals) of each run; those that feel the same are one."""
        records = {r.name: r for r, _ in runs}
        bases = {name: self._base(r) for name, r in records.items()}
        models = [
            bases[r.name] | {k: v for k, v in given.items() if not outside(k)} for r, given in runs
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
        longest = min(record.period, longest_step(record.period, LONGEST_STEP))
        base = {"solver.max_step": longest, **self.plant.settings, **self.plant.in_views}
        base |= {**self.plant.parameters, **record.parameters}
        return {k: v for k, v in base.items() if k in self._parameters}

    def _felt(self, piece: Piece, given: Values) -> Errors:
        """Errors of the sensors that a piece reads, and of its inputs."""
        read = {
            source.removeprefix(RATE)
            for name, source in (*self.sources.items(), *self.corrected.items())
            if name in piece.inputs or name in piece.states
        }
        errors = ((k, v) for k, v in given.items() if outside(k))
        return tuple(sorted((k, v) for k, v in errors if not read.isdisjoint(_moved_by(k))))

    def _drive(self, record: Record, piece: Piece, felt: Errors) -> Drive:
        """Inputs and corrected states of a piece, from a record with these errors."""
        key = (record, piece, felt)
        return self._drives.of(key, lambda: self._driven(record, piece, felt))

    def _driven(self, record: Record, piece: Piece, felt: Errors) -> Drive:
        errors, readings = dict(felt), self._readings
        inputs: dict[str, Course] = {}
        for name, source in self.sources.items():
            if name not in piece.inputs:
                continue
            if source in self.plant.inputs:
                inputs[name] = self._command(record, source, lateness(source, errors))
            else:
                made = readings.rate if source.startswith(RATE) else readings.value
                inputs[name] = made(source.removeprefix(RATE), record, errors)
        correction = None
        drawn = {state: s for state, s in self.corrected.items() if state in piece.states}
        if drawn:
            share = 1 - np.exp(-record.period / (self.observer))
            measured = [readings.value(s, record, errors).at for s in drawn.values()]
            correction = Correction(tuple(drawn), np.column_stack(measured), (share,) * len(drawn))
        return Drive(inputs, correction, record.rows)

    def _command(self, record: Record, name: str, late: Lateness) -> Course:
        """An input of the plant, where it acts so late."""

        def made() -> Course:
            held = acting(record, name, late)
            if isinstance(held, tuple) and not self.remembers:
                held = held[1].mean(axis=1)
            return Course.of(held)

        return self._commands.of((record, name, late), made)


def _moved_by(error: str) -> tuple[str, ...]:
    """The input, or the signals, that an error moves."""
    return (input_of(error),) if error.startswith(OF_INPUTS) else read_with(error)
