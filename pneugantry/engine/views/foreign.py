"""Residual views of FMUs without source, of FMI 2.0 or 3.0 from any tool: an FMU is driven by the
record's inputs and by measured signals, and what it says is taken from what was measured.

An input that is neither is the output of another FMU, if one makes it: both then run in series.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from modelica_fmu.batch import Drive, Part, PartVariable, Subsystem
from modelica_fmu.errors import InputError, RunError
from pneugantry.engine.plant import Array, Plant, Record, straight
from pneugantry.engine.signals.commands import drives_of
from pneugantry.engine.views.subsystem import SubsystemView
from pyfmi_runner.driven import DrivenFmu
from pyfmi_runner.fmu import FmuFile

__all__ = [
    "ForeignFmu",
    "ForeignPlant",
    "ForeignSubsystem",
    "foreign_signals",
    "foreign_views",
    "parameters_read",
]

Inputs = Mapping[str, Array | tuple[Array, Array]]


@dataclass(frozen=True)
class ForeignFmu:
    """One FMU of a plant. Its parameters, and its outputs as variables of signals, are named with
    `prefix` before them, so that one file may stand for two components.
    """

    file: FmuFile
    block: str  # of the answer
    inputs: Mapping[str, str]  # input of the FMU -> input of the plant, or a signal
    outputs: Mapping[str, str]  # output of the FMU -> signal
    prefix: str = ""
    step: float | None = None  # s, longest communication step; None: one step a row


@dataclass(frozen=True)
class ForeignPlant(Plant):
    """A plant that is made of FMUs; `model` and `class_name` are those of the first one."""

    fmus: tuple[ForeignFmu, ...] = field(default=())


@dataclass(frozen=True, eq=False)
class _Stage:
    """An FMU in a series; `fed`: input that an FMU before it makes -> the signal that this is."""

    fmu: ForeignFmu
    driven: DrivenFmu
    outputs: tuple[str, ...]  # of the FMU, that somebody reads
    fed: Mapping[str, str]


class ForeignSubsystem(Subsystem):
    """FMUs in series, called as a part is. Threads may share it."""

    def __init__(self, stages: Sequence[_Stage]) -> None:
        self.stages = tuple(stages)

    def runs(
        self,
        names: Sequence[str],
        values: Array,
        drives: Sequence[Drive],
        outputs: Sequence[str],
        period: float,
        which: Sequence[int],
    ) -> list[Array]:
        """As a part's: outputs (N, outputs) of each run, NaN from where it failed on. Inputs are
        named "FMU's number.input". An FMU's states cannot be corrected: InputError.
        """
        values = np.atleast_2d(values)
        own = np.asarray(which)
        result: list[Array] = [np.empty((0, 0))] * len(values)
        for i, drive in enumerate(drives):
            runs = np.flatnonzero(own == i)
            made = self._driven(names, values[runs], drive, outputs, period)
            for run, found in zip(runs, made, strict=True):
                result[run] = found
        return result

    def _driven(
        self,
        names: Sequence[str],
        values: Array,
        drive: Drive,
        outputs: Sequence[str],
        period: float,
    ) -> Array:
        """Runs that are driven alike."""
        if drive.correction is not None:
            raise InputError("the states of an FMU cannot be corrected", field="observer")
        inputs = drive.inputs
        made: dict[str, Array] = {}  # signal -> (runs, N)
        for number, stage in enumerate(self.stages):
            own = {
                name: inputs[f"{number}.{name}"].values
                for name in stage.fmu.inputs
                if f"{number}.{name}" in inputs
            }
            at = [i for i, n in enumerate(names) if _own_name(stage.fmu, n) is not None]
            bare = [_own_name(stage.fmu, names[i]) or "" for i in at]
            clock = period, drive.rows
            found = _stage_runs(stage, bare, values[:, at], own, made, clock)
            for i, output in enumerate(stage.outputs):
                made[stage.fmu.outputs[output]] = found[:, :, i]
                made[stage.fmu.prefix + output] = found[:, :, i]
        return np.stack([made[o] for o in outputs], axis=2)


def _stage_runs(
    stage: _Stage,
    names: Sequence[str],
    values: Array,
    inputs: Inputs,
    made: Mapping[str, Array],
    clock: tuple[float, int],
) -> Array:
    """Runs of one FMU of a series; those that are fed alike, together. clock: s between two rows,
    and how many there are.
    """
    if not stage.fed:
        return stage.driven.run(names, values, inputs, stage.outputs, *clock)
    found = []
    for run in range(len(values)):
        fed = {n: straight(made[signal][run]) for n, signal in stage.fed.items()}
        row = values[run : run + 1]
        if all(np.isfinite(v[0]).all() for v in fed.values()):
            every = {**inputs, **fed}
            found.append(stage.driven.run(names, row, every, stage.outputs, *clock)[0])
        else:  # the FMU before it failed
            found.append(np.full((clock[1], len(stage.outputs)), np.nan))
    return np.stack(found)


def _own_name(fmu: ForeignFmu, name: str) -> str | None:
    """An FMU's own name of a plant's parameter; None: it has no such parameter."""
    bare = name.removeprefix(fmu.prefix)
    if not name.startswith(fmu.prefix) or bare not in fmu.file.variables:
        return None
    return bare if fmu.file.variables[bare].settable_before_start else None


def foreign_views(
    plant: ForeignPlant, measured: Sequence[str], period: float, band: float
) -> tuple[list[SubsystemView], list[str]]:
    """One view for each FMU with a measured output, and what could not be made, a sentence each.

    period: s, between a record's rows; band: Hz, up to which residuals are judged. An FMU's input
    that is not measured is taken from the FMU that makes it; where none does, or where FMUs feed
    each other in a ring, the view is left out. Raises InputError for a name that an FMU lacks.
    """
    for fmu in plant.fmus:
        _check(fmu)
    decimation = max(1, round(1 / (band * period)))
    driven = {id(f): DrivenFmu(f.file, f.step) for f in plant.fmus}
    found, notes = [], []
    for fmu in plant.fmus:
        signals = tuple(s for s in fmu.outputs.values() if s in measured)
        if not signals:
            continue
        try:
            series = _series(plant, fmu, measured, driven)
        except _Unfed as missing:
            notes.append(
                f"{fmu.file.path.name} is not judged: its input {missing} is not measured, and no "
                "FMU makes it from what is"
            )
            continue
        found.append(_view(plant, series, signals, decimation))
    return found, notes


class _Unfed(Exception):
    """An input that nothing feeds."""


def _series(
    plant: ForeignPlant, last: ForeignFmu, measured: Sequence[str], driven: Mapping[int, DrivenFmu]
) -> list[_Stage]:
    """The FMUs that make the inputs of one, in their order, and itself."""
    known = {*plant.inputs, *measured}
    makers = {signal: f for f in plant.fmus for signal in f.outputs.values()}
    order: list[ForeignFmu] = []

    def visit(fmu: ForeignFmu, path: tuple[ForeignFmu, ...]) -> None:
        for name, source in fmu.inputs.items():
            if source in known:
                continue
            before = makers.get(source)
            if before is None or any(before is p for p in (*path, fmu)):
                raise _Unfed(name)
            visit(before, (*path, fmu))
        if not any(fmu is f for f in order):
            order.append(fmu)

    visit(last, ())
    read = {s for f in order for s in f.inputs.values() if s not in known}
    read |= set(last.outputs.values()) & set(measured)
    return [
        _Stage(
            f,
            driven[id(f)],
            tuple(o for o, s in f.outputs.items() if s in read and (f is last or s not in known)),
            {n: s for n, s in f.inputs.items() if s not in known},
        )
        for f in order
    ]


def _view(
    plant: ForeignPlant, series: Sequence[_Stage], signals: tuple[str, ...], decimation: int
) -> SubsystemView:
    own = {s.name: s for s in plant.signals}
    last = series[-1].fmu
    return SubsystemView(
        name=last.prefix + last.file.path.stem + "." + ",".join(signals),
        signals=signals,
        blocks=(last.block,) * len(signals),
        sigmas=tuple(own[s].averaged(decimation) for s in signals),
        decimation=decimation,
        plant=plant,
        part=_part(series),
        sources={
            f"{i}.{n}": source
            for i, stage in enumerate(series)
            for n, source in stage.fmu.inputs.items()
            if n not in stage.fed
        },
        corrected={},
        pairs={},
        observer=0.0,
        subsystem=ForeignSubsystem(series),
    )


def foreign_signals(
    plant: ForeignPlant, record: Record, values: Sequence[Mapping[str, float]]
) -> tuple[tuple[str, ...], Array]:
    """Signals of a record that some FMU makes, and what all FMUs together make of them when the
    record's inputs alone drive them: (len(values), rows, signals), NaN from where a run failed on.
    Raises RunError where an FMU's input is made by nobody, or FMUs feed each other in a ring.
    """
    makers = {signal: f for f in plant.fmus for signal in f.outputs.values()}
    signals = tuple(s.name for s in plant.signals if s.name in record.signals and s.name in makers)
    driven = {id(f): DrivenFmu(f.file, f.step) for f in plant.fmus}
    stages: dict[int, _Stage] = {}
    for signal in signals:
        try:
            for stage in _series(plant, makers[signal], (), driven):
                stages.setdefault(id(stage.fmu), stage)
        except _Unfed as missing:
            raise RunError(
                f"{record.name} could not be replayed: no FMU, or only a ring of them, makes the "
                f"input {missing} on the way to {signal}"
            ) from None
    read = {s for stage in stages.values() for s in stage.fed.values()} | set(signals)
    series = [
        _Stage(s.fmu, s.driven, tuple(o for o, n in s.fmu.outputs.items() if n in read), s.fed)
        for s in stages.values()
    ]
    names, table = _set_table(plant, series, record, values)
    sources = {
        f"{i}.{n}": source
        for i, stage in enumerate(series)
        for n, source in stage.fmu.inputs.items()
        if n not in stage.fed
    }
    drives, which = drives_of(record, sources, values)
    try:
        made = ForeignSubsystem(series).runs(names, table, drives, signals, record.period, which)
    finally:
        for own in driven.values():
            own.close()
    return signals, np.stack(made)


def _set_table(
    plant: Plant, series: Sequence[_Stage], record: Record, values: Sequence[Mapping[str, float]]
) -> tuple[list[str], Array]:
    """What is set before the start: names, and a row for each of `values`."""
    base = {**plant.settings, **plant.parameters, **record.parameters}
    names: list[str] = []
    starts: list[float] = []
    for name in sorted({*base, *(n for given in values for n in given)}):
        for stage in series:
            own = _own_name(stage.fmu, name)
            if own is not None and name not in names:
                names.append(name)
                starts.append(base.get(name, stage.fmu.file.variables[own].start or 0.0))
    rows = [
        [float(given.get(n, start)) for n, start in zip(names, starts, strict=True)]
        for given in values
    ]
    return names, np.array(rows, dtype=float).reshape(len(values), len(names))


def _check(fmu: ForeignFmu) -> None:
    """Refuses names that are no inputs and outputs."""
    for names, wanted in ((fmu.inputs, ("input",)), (fmu.outputs, ("output", "local"))):
        for name in names:
            v = fmu.file.variables.get(name)
            if v is None or v.causality not in wanted:
                known = [n for n, v in fmu.file.variables.items() if v.causality == wanted[0]]
                raise InputError(
                    f"is no {wanted[0]} of the FMU",
                    file=fmu.file.path,
                    field=name,
                    hint=f"use some of {', '.join(known[:12])}",
                )


# ---- what an FMU depends on


def _part(series: Sequence[_Stage]) -> Part:
    """A series as the views see a part: what can be set, and whether it remembers."""
    variables: dict[tuple[str, str], PartVariable] = {}
    for number, stage in enumerate(series):
        file, prefix = stage.fmu.file, stage.fmu.prefix
        for name in sorted(parameters_read(file, stage.outputs) - set(stage.fmu.inputs)):
            v = file.variables[name]
            variables["parameter", prefix + name] = PartVariable(
                prefix + name, "parameter", v.type, v.start, v.unit, v.min, v.max
            )
        for name in stage.fmu.inputs:
            key = f"{number}.{name}"
            if name not in stage.fed:
                variables["input", key] = PartVariable(key, "input", "Real", 0.0, None, None, None)
        if _remembers(file):
            key = f"{number}.state"
            variables["state", key] = PartVariable(key, "state", "Real", None, None, None, None)
    return Part(series[-1].fmu.file.path, tuple(variables.values()), frozenset())


def _remembers(file: FmuFile) -> bool:
    """Whether an FMU may have states: one for co-simulation alone need not list them."""
    return bool(file.description.states) or "me" not in file.description.identifiers


def parameters_read(file: FmuFile, outputs: Sequence[str]) -> frozenset[str]:
    """What may be set before the start and acts on some outputs: as the model structure says, where
    it says all that this takes; else everything that may be set.
    """
    settable = frozenset(n for n, v in file.variables.items() if v.settable_before_start)
    d = file.description
    if not _structured(file) or not set(outputs) <= {*d.outputs, *d.states}:
        return settable
    rate = dict(zip(d.states, d.derivatives, strict=True))
    reached, open_ = set(outputs), list(outputs)
    first: set[str] = set()  # what the initialisation reads, and the rates do from then on
    while open_:
        name = open_.pop()
        unknowns = [name, rate[name]] if name in rate else [name]
        read = {n for u in unknowns for n in d.depends.get(u) or ()}
        open_ += [n for n in read - reached if n in rate or n in d.depends]
        reached |= read
        first |= {n for u in unknowns for n in d.depends_first.get(u) or ()}
    return frozenset((reached | first) & settable)


def _structured(file: FmuFile) -> bool:
    """Whether the model structure tells which parameters act on what. It does not tell what acts
    through events, nor what an FMU for co-simulation alone holds within.
    """
    d = file.description
    if "me" not in d.identifiers or d.n_indicators:
        return False
    if any(v.variability == "discrete" for v in d.variables.values() if v.causality != "input"):
        return False
    first = [n for n in (*d.outputs, *d.states, *d.derivatives) if _computed_first(file, n)]
    running = (*d.outputs, *d.derivatives)
    return all(d.depends.get(n) is not None for n in running) and all(
        d.depends_first.get(n) is not None for n in first
    )


def _computed_first(file: FmuFile, name: str) -> bool:
    """Whether the initialisation computes a variable."""
    return file.variables[name].initial != "exact"
