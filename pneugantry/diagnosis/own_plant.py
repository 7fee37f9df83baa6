"""A user's own plant as a TOML file says it: FMU or Modelica file, what its inputs and outputs are
in the logs, what is known of it.

[plant]       model = "EMPS.mo" and class = "EMPS.Axis", or fmu = "axis.fmu"; catalogue = "effects"
(folder or file)
              period = 1e-3 (s, whole milliseconds), decimate = 25 (samples to one, behind a
                  low-pass), skip = 0.5 (s, not judged)
[inputs]      "name in the FMU" = "column", or a number
[outputs.u]   column = "vir", sigma = 0.005 (RMS of the sensor's noise), unit = "V"; the part is the
name in the FMU
[tolerance]   "M" = 0.05                  share (RMS) by which a rig's parameter may be off; that is
no cause
[parameters]  "gtau" = 35.15              what is known and differs from the FMU's own value
[log.train]   file = "train.csv" (.parquet, .mat), use = "fit" or "held out"; [log.train.inputs],
[log.train.parameters]: of this log only

Paths are relative to the file. Row k holds the readings at k * period and the inputs that act from
then on.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from modelica_fmu.errors import InputError
from pneugantry.diagnosis.mat_file import read_mat
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.scenario import Fields, parse_toml

__all__ = ["Channel", "OwnLog", "OwnPlant", "is_own_plant", "read_own_plant"]

Array = NDArray[np.float64]
PLANT_KEYS = ("name", "model", "class", "fmu", "catalogue", "period", "decimate", "skip")


@dataclass(frozen=True)
class Channel:
    """An output of the FMU that was measured."""

    name: str
    column: str
    sigma: float  # RMS of the sensor's noise, white
    unit: str = "1"


@dataclass(frozen=True, eq=False)
class OwnLog:
    """One measured run."""

    name: str
    inputs: Array  # (N, inputs), held over the period behind each row
    measured: Array  # (N, channels)
    parameters: Mapping[str, float]  # of this log alone
    held_out: bool


@dataclass(frozen=True, eq=False)
class OwnPlant:
    """Everything that the generic diagnosis needs to know."""

    name: str
    fmu: FmuFile
    catalogue: Path | None
    period: float  # s
    decimate: int
    skip: float  # s at a log's start that are not judged
    inputs: tuple[str, ...]
    channels: tuple[Channel, ...]
    tolerance: Mapping[str, float]
    parameters: Mapping[str, float]
    logs: tuple[OwnLog, ...]
    notes: tuple[str, ...] = field(default=())


def is_own_plant(path: Path) -> bool:
    """A TOML file with a [plant] table."""
    return path.suffix == ".toml" and os.path.isfile(path) and "plant" in parse_toml(path)


def read_own_plant(path: Path, fmu: Path | None = None, out: Path | None = None) -> OwnPlant:
    """Reads the description and its logs, and builds the FMU where a Modelica file is given. `fmu`:
    used instead; `out`: folder of the FMU built. Raises InputError naming file, field and hint.
    """
    top = Fields(
        parse_toml(path), ("plant", "inputs", "outputs", "tolerance", "parameters", "log"), path
    )
    for name in ("plant", "inputs", "outputs", "log"):
        if not top.table.get(name):
            top.refuse(name, "is missing or empty", f"add a table [{name}]")
    plant, inputs, outputs = (
        top.sub("plant", PLANT_KEYS),
        _free(top, "inputs"),
        _free(top, "outputs"),
    )
    period, skip = plant.number("period", 1e-3, 0.0, 10.0), plant.number("skip", 0.0, 0.0)
    if period <= 0 or abs(period * 1e3 - round(period * 1e3)) > 1e-9:
        plant.refuse(
            "period", f"{period:g} s is no whole number of milliseconds", "resample the logs"
        )
    decimate = plant.of_type("decimate", int, 1)
    if decimate < 1:
        plant.refuse("decimate", f"is {decimate}, expected >= 1", "write 1 to judge every sample")
    texts = {
        key: plant.of_type(key, str, "") for key in ("name", "model", "class", "fmu", "catalogue")
    }
    sources = {name: _source(inputs, name) for name in inputs.table}
    channels = tuple(_channel(outputs, name) for name in outputs.table)
    tolerance, parameters = top.numbers("tolerance"), top.numbers("parameters")
    file = FmuFile.read(fmu) if fmu is not None else _fmu(path, texts, out)
    for name in (*sources, *outputs.table, *tolerance, *parameters):
        if name not in file.variables:
            raise InputError(
                "no such variable in the FMU",
                file=path,
                field=name,
                hint=f"see modelDescription.xml in {file.path.name}",
            )
    entries = _free(top, "log")
    logs = tuple(_log(entries, name, sources, channels) for name in entries.table)
    if all(log.held_out for log in logs):
        top.refuse("log", "every log is held out", 'give at least one log use = "fit"')
    catalogue = path.parent / texts["catalogue"] if texts["catalogue"] else None
    return OwnPlant(
        texts["name"] or path.parent.name,
        file,
        catalogue,
        period,
        decimate,
        skip,
        tuple(sources),
        channels,
        tolerance,
        parameters,
        logs,
    )


def _free(fields: Fields, key: str) -> Fields:
    """A table whose keys are the user's."""
    return fields.sub(key, fields.table.get(key, {}))


def _source(fields: Fields, name: str) -> str | float:
    """Where an input comes from: a column of the log, or a number."""
    given = fields.table[name]
    return given if isinstance(given, str) else float(fields.number(name))


def _fmu(path: Path, texts: Mapping[str, str], out: Path | None) -> FmuFile:
    if texts["fmu"]:
        return FmuFile.read(path.parent / texts["fmu"])
    if not texts["model"] or not texts["class"]:
        raise InputError(
            "names no plant",
            file=path,
            field="plant",
            hint='write fmu = "axis.fmu", or model = "Axis.mo" and class = "Axis"',
        )
    return FmuFile.read(build_fmu(texts["class"], path.parent / texts["model"], out=out).path)


def _channel(outputs: Fields, name: str) -> Channel:
    entry = outputs.sub(name, ("column", "sigma", "unit"))
    sigma = entry.number("sigma", 0.0)
    if sigma <= 0:
        entry.refuse("sigma", f"must be > 0, got {sigma:g}", "give the RMS of the sensor's noise")
    return Channel(name, entry.of_type("column", str, name), sigma, entry.of_type("unit", str, "1"))


def _log(
    logs: Fields, name: str, inputs: Mapping[str, str | float], channels: tuple[Channel, ...]
) -> OwnLog:
    entry = logs.sub(name, ("file", "use", "inputs", "parameters"))
    use = entry.of_type("use", str, "fit")
    if use not in ("fit", "held out") or not entry.of_type("file", str, ""):
        logs.refuse(name, "needs file, and use as one of fit, held out", 'write use = "fit"')
    given = _free(entry, "inputs")
    for unknown in set(given.table) - set(inputs):
        given.refuse(unknown, "no such input", "name it under [inputs] first")
    assert logs.file is not None
    file = Path(logs.file).parent / entry.table["file"]
    columns = _columns(file)
    sources = {**inputs, **{key: _source(given, key) for key in given.table}}
    read = [_column(file, columns, c.column) for c in channels]
    driven = [
        _column(file, columns, s) if isinstance(s, str) else np.full(len(read[0]), s)
        for s in sources.values()
    ]
    if len({len(values) for values in (*driven, *read)}) > 1:
        raise InputError("columns differ in length", file=file, hint="write one row per sample")
    return OwnLog(
        name,
        np.column_stack(driven),
        np.column_stack(read),
        entry.numbers("parameters"),
        use == "held out",
    )


def _columns(file: Path) -> Mapping[str, Any]:
    """Columns of a table, by name."""
    if not os.path.isfile(file):
        raise InputError("no such file", file=file, hint="correct the log's file in the TOML")
    try:
        if file.suffix == ".mat":
            return read_mat(file)
        table = (
            pd.read_parquet(file) if file.suffix == ".parquet" else pd.read_csv(file, comment="#")
        )
    except Exception as error:  # of a damaged file the readers, scipy's foremost, raise anything
        raise InputError(
            f"cannot be read: {error}",
            file=file,
            hint="give a CSV, Parquet or MATLAB (up to v7) file",
        ) from None
    if not table.columns.is_unique:
        raise InputError(
            "a column is there twice",
            file=file,
            field=str(table.columns[table.columns.duplicated()][0]),
            hint="keep one",
        )
    return {str(name): table[name].to_numpy() for name in table.columns}


def _column(file: Path, columns: Mapping[str, Any], name: str) -> Array:
    if name not in columns:
        raise InputError(
            "no such column", file=file, field=name, hint=f"use one of {', '.join(columns)}"
        )
    try:
        values = np.asarray(columns[name], dtype=np.float64).ravel()
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            "holds what is no number", file=file, field=name, hint="write numbers, SI"
        ) from None
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise InputError(
            f"is not finite in row {bad[0]}", file=file, field=name, hint="cut the log there"
        )
    return values
