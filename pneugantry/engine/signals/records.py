"""Inputs, signals and logs of a description (see `describe`) as records."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from modelica_fmu.errors import InputError
from pneugantry.engine.plant import Array, Record, Signal
from pneugantry.engine.signals.tables import (
    COARSEST,
    FINEST,
    STAMPS,
    Column,
    conversion,
    noise_of,
    read_columns,
)
from pneugantry.engine.signals.units import with_unit
from pyfmi_runner.scenario import Fields

__all__ = ["Logs", "free", "per_log", "signals_of", "variables_of"]

COLUMN_KEYS = ("column", "unit", "recorded", "scale", "offset")
BETWEEN = ("held", "straight")  # how an input runs from row to row
OUTPUT_KEYS = ("sigma", "error", "lasting", "variable")
MISSPELT = 0.5  # likeness from which on an unused column may be the one that is missing
Source = Column | float


def variables_of(top: Fields) -> dict[str, str]:
    """Variable of the model by signal."""
    outputs = free(top, "outputs")
    return {
        name: Fields(outputs.table[name], (*COLUMN_KEYS, *OUTPUT_KEYS)).of_type(
            "variable", str, name
        )
        for name in outputs.table
    }


class Logs:
    """The logs of a description."""

    def __init__(self, top: Fields, own: Fields) -> None:
        self.top, self.own = top, own
        self.inputs = {n: _source(free(top, "inputs"), n) for n in free(top, "inputs").table}
        outputs = free(top, "outputs")
        self.signals = {
            n: _column(outputs.sub(n, (*COLUMN_KEYS, *OUTPUT_KEYS)), n) for n in outputs.table
        }
        self.skip = own.number("skip", 0.0, 0.0)
        self.period: float | None = own.number("period", None, FINEST, COARSEST)
        self.time: Column | None = STAMPS if self.period is None else None
        self.unused: set[str] = set()  # columns of logs that nothing names
        self.how: dict[str, None] = {}  # logs were resampled
        if "time" in own:
            given = own.table["time"]
            named = isinstance(given, str)
            self.time = (
                Column(given) if named else _column(own.sub("time", COLUMN_KEYS), "time", "s")
            )

    def read(self) -> tuple[list[Record], list[Record], list[str]]:
        """Records to fit, those held out, and what was changed or is missing."""
        fitted: list[Record] = []
        held: list[Record] = []
        notes: list[str] = []
        for name in free(self.top, "log").table:
            record, out, said = self._log(name)
            self.period = record.period  # all are brought to the first one's, if none is given
            (held if out else fitted).append(record)
            notes += said
        notes += [f"resampled: {how}" for how in self.how]
        if not fitted:
            self.top.refuse("log", "every log is held out", 'give at least one log use = "fit"')
        everywhere = {s for r in (*fitted, *held) for s in r.signals}
        for signal in self.signals:
            lacking = [r.name for r in (*fitted, *held) if signal not in r.signals]
            if signal in everywhere and lacking:
                notes.append(f"{signal} is not measured in {', '.join(lacking)}")
        return fitted, held, notes

    def _log(self, name: str) -> tuple[Record, bool, tuple[str, ...]]:
        logs = free(self.top, "log")
        entry = logs.sub(name, ("file", "use", "inputs", "parameters"))
        use = entry.of_type("use", str, "fit")
        if use not in ("fit", "held out") or not entry.of_type("file", str, ""):
            logs.refuse(name, "needs file, and use as one of fit, held out", 'write use = "fit"')
        given = free(entry, "inputs")
        for unknown in set(given.table) - set(self.inputs):
            given.refuse(unknown, "no such input", "name it under [inputs] first")
        sources = {**self.inputs, **{key: _source(given, key) for key in given.table}}
        driving = {n: s for n, s in sources.items() if isinstance(s, Column)}
        # an input and a signal may share a name: the input's column is kept under another one
        wanted = {f"input {n}": s for n, s in driving.items()} | self.signals
        assert self.top.file is not None
        file = Path(self.top.file).parent / entry.table["file"]
        straight = frozenset(n for n, s in driving.items() if s.straight)
        held = {f"input {n}" for n in driving if n not in straight}
        table = read_columns(file, wanted, set(self.signals), self.time, self.period, held)
        self.unused |= table.unused
        self.how |= {table.how: None} if table.how else {}
        rows = _rows(table.columns, file)
        inputs = {
            n: table.columns[f"input {n}"] if n in driving else np.full(rows, s)
            for n, s in sources.items()
        }
        signals = {n: table.columns[n] for n in self.signals if n in table.columns}
        own = {**self._starts(name, entry.numbers("parameters"))}
        record = Record(name, table.period, inputs, signals, own, skip=self.skip, straight=straight)
        return record, use == "held out", table.notes

    def _starts(self, log: str, parameters: dict[str, float]) -> dict[str, float]:
        """A log's own parameters: those that may be off in each need a value in each."""
        known = self.top.numbers("parameters")
        for name in per_log(self.top):
            if name not in parameters and name not in known:
                near = difflib.get_close_matches(name, [*parameters, *known], 1, MISSPELT)
                wanted = f"write it under [parameters] or [log.{log}.parameters]"
                hint = f"{wanted}; {near[0]!r} stands there" if near else wanted
                self.top.refuse(f"per_log.{name}", f"has no value for the log {log}", hint)
            parameters.setdefault(name, known.get(name, 0.0))
        return parameters


def _rows(columns: Mapping[str, Array], file: Path) -> int:
    if not columns:
        hint = "name its columns under [outputs]"
        raise InputError("has none of the columns", file=file, field="outputs", hint=hint)
    return len(next(iter(columns.values())))


def signals_of(logs: Logs, records: Sequence[Record]) -> tuple[list[Signal], list[str]]:
    """Signals that some log has, their noise estimated where it is not given; and what to say."""
    outputs, variables = free(logs.top, "outputs"), variables_of(logs.top)
    found, notes = [], []
    for name, column in logs.signals.items():
        measured = [r.signals[name] for r in records if name in r.signals]
        if not measured:
            near = difflib.get_close_matches(column.name, sorted(logs.unused), 1, MISSPELT)
            if near:
                hint = f"did you mean {near[0]!r}? else take {name} out"
                outputs.refuse(name, f"no log has a column {column.name!r}", hint)
            rest = f" (not read: {', '.join(sorted(logs.unused))})" if logs.unused else ""
            notes.append(
                f"no log has a column {column.name!r}{rest}: {name} is taken as not measured"
            )
            continue
        entry = outputs.sub(name, (*COLUMN_KEYS, *OUTPUT_KEYS))
        unit = entry.of_type("unit", str, "1")
        sigma = entry.number("sigma", None)
        if sigma is None:
            sigma = noise_of(measured)
            told = with_unit(f"{sigma:.3g}", unit)
            notes.append(f"noise of {name} estimated from the logs: {told}")
        if sigma <= 0:
            hint = "give the RMS of the sensor's noise"
            entry.refuse("sigma", f"must be > 0, got {sigma:g}", hint)
        error, lasting = entry.number("error", 0.0, 0.0), entry.number("lasting", 1.0, 0.0)
        if lasting == 0:
            entry.refuse("lasting", "must be > 0 s", "leave out error where the model has none")
        found.append(Signal(name, variables[name], sigma, unit, error, lasting))
    if not found:
        logs.top.refuse("outputs", "no log has any of the columns", "correct their names")
    return found, notes


def per_log(top: Fields) -> dict[str, float]:
    """RMS by which parameters of each log are off; 0 is none."""
    found = top.numbers("per_log")
    for name in found:
        free(top, "per_log").number(name, low=0.0)
    return {name: spread for name, spread in found.items() if spread}


def free(fields: Fields, key: str) -> Fields:
    """A table whose keys are the user's."""
    given: Any = fields.table.get(key, {})
    return fields.sub(key, given if isinstance(given, Mapping) else {})


def _source(fields: Fields, name: str) -> Source:
    """Where an input comes from: a column of the log, or a number."""
    given = fields.table[name]
    if isinstance(given, str):
        return Column(given)
    if isinstance(given, Mapping):
        own = fields.sub(name, (*COLUMN_KEYS, "between"))
        between = own.of_type("between", str, BETWEEN[0])
        if between not in BETWEEN:
            own.refuse("between", f"is {between!r}", f"write one of {', '.join(BETWEEN)}")
        return replace(_column(own, name), straight=between == "straight")
    return float(fields.number(name))


def _column(entry: Fields, name: str, usual: str = "1") -> Column:
    """A column in the model's unit, `usual` if it is not given: `recorded` tells the recorder's."""
    unit = entry.of_type("unit", str, usual)
    recorded = entry.of_type("recorded", str, unit)
    told = conversion(recorded, unit)
    if told is None:
        hint = "name units of one quantity, such as km/h and m/s, or give scale"
        entry.refuse("recorded", f"{recorded!r} is not known in {unit!r}", hint)
        raise AssertionError
    scale = entry.number("scale", 1.0)
    by, offset = told
    return Column(
        entry.of_type("column", str, name), by * scale, offset + entry.number("offset", 0.0)
    )
