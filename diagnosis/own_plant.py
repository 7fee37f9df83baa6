"""A user's own plant as a TOML file says it: FMU or Modelica file, what its inputs and outputs are in the logs, what is known of it.

[plant]       model = "EMPS.mo" and class = "EMPS.Axis", or fmu = "axis.fmu"; catalogue = "effects" (folder or file)
              period = 1e-3 (s, whole milliseconds), decimate = 25 (samples to one, behind a low-pass), skip = 0.5 (s, not judged)
[inputs]      "name in the FMU" = "column", or a number
[outputs.u]   column = "vir", sigma = 0.005 (RMS of the sensor's noise), unit = "V"; the part is the name in the FMU
[tolerance]   "M" = 0.05                  share (RMS) by which a rig's parameter may be off; that is no cause
[parameters]  "gtau" = 35.15              what is known and differs from the FMU's own value
[log.train]   file = "train.csv" (.parquet, .mat), use = "fit" or "held out"; [log.train.inputs], [log.train.parameters]: of this log only

Paths are relative to the file. Row k holds the readings at k * period and the inputs that act from then on.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.io import loadmat

from pyfmi_runner.build import build_fmu
from pyfmi_runner.errors import InputError
from pyfmi_runner.fmu import FmuFile

__all__ = ["Channel", "OwnLog", "OwnPlant", "is_own_plant", "read_own_plant"]

Array = NDArray[np.float64]


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
    return path.suffix == ".toml" and path.is_file() and "plant" in _read(path)


def read_own_plant(path: Path, fmu: Path | None = None, out: Path | None = None) -> OwnPlant:
    """Reads the description and its logs, and builds the FMU where a Modelica file is given. `fmu`: used instead; `out`: folder of the
    FMU built. Raises InputError naming file, field and mend."""
    text = _read(path)
    plant = _table(path, text, "plant")
    file = FmuFile.read(fmu) if fmu is not None else _fmu(path, plant, out)
    inputs, outputs = _table(path, text, "inputs"), _table(path, text, "outputs")
    channels = tuple(_channel(path, name, entry) for name, entry in outputs.items())
    tolerance, parameters = dict(text.get("tolerance", {})), dict(text.get("parameters", {}))
    for name in (*inputs, *outputs, *tolerance, *parameters):
        if name not in file.variables:
            raise InputError("no such variable in the FMU", file=path, field=name, mend=f"see modelDescription.xml in {file.path.name}")
    period = _number(path, plant, "period", 1e-3)
    if period <= 0 or abs(period * 1e3 - round(period * 1e3)) > 1e-9:
        raise InputError(f"{period:g} s is no whole number of milliseconds", file=path, field="plant.period", mend="resample the logs")
    logs = tuple(_log(path, name, entry, inputs, channels) for name, entry in _table(path, text, "log").items())
    if all(log.held_out for log in logs):
        raise InputError("every log is held out", file=path, field="log", mend='give at least one log use = "fit"')
    catalogue = path.parent / plant["catalogue"] if "catalogue" in plant else None
    return OwnPlant(
        plant.get("name", path.parent.name), file, catalogue, period, int(plant.get("decimate", 1)), _number(path, plant, "skip", 0.0),
        tuple(inputs), channels, tolerance, parameters, logs,
    )  # fmt: skip


def _fmu(path: Path, plant: Mapping[str, Any], out: Path | None) -> FmuFile:
    if "fmu" in plant:
        return FmuFile.read(path.parent / plant["fmu"])
    if "model" not in plant or "class" not in plant:
        raise InputError("names no plant", file=path, field="plant", mend='write fmu = "axis.fmu", or model = "Axis.mo" and class = "Axis"')
    return FmuFile.read(build_fmu(plant["class"], path.parent / plant["model"], out=out).path)


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise InputError("cannot be read", file=path, mend="check the path") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"not valid TOML: {error}", file=path, mend="correct that line") from None


def _table(path: Path, text: Mapping[str, Any], name: str) -> dict[str, Any]:
    if not isinstance(text.get(name), dict) or not text[name]:
        raise InputError("is missing or empty", file=path, field=name, mend=f"add a table [{name}]")
    return dict(text[name])


def _number(path: Path, table: Mapping[str, Any], name: str, default: float | None = None) -> float:
    value = table.get(name, default)
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise InputError(f"must be a number, got {value!r}", file=path, field=name, mend=f"write {name} = 0.1")
    return float(value)


def _channel(path: Path, name: str, entry: Mapping[str, Any]) -> Channel:
    sigma = _number(path, entry, "sigma")
    if sigma <= 0:
        raise InputError(f"must be > 0, got {sigma:g}", file=path, field=f"outputs.{name}.sigma", mend="give the RMS of the sensor's noise")
    return Channel(name, str(entry.get("column", name)), sigma, str(entry.get("unit", "1")))


def _log(path: Path, name: str, entry: Mapping[str, Any], inputs: Mapping[str, Any], channels: tuple[Channel, ...]) -> OwnLog:
    use = entry.get("use", "fit")
    if use not in ("fit", "held out") or "file" not in entry:
        raise InputError("needs file, and use as one of fit, held out", file=path, field=f"log.{name}", mend='write use = "fit"')
    file = path.parent / entry["file"]
    columns = _columns(file)
    sources = {**inputs, **entry.get("inputs", {})}
    unknown = set(sources) - set(inputs)
    if unknown:
        raise InputError("no such input", file=path, field=f"log.{name}.inputs.{unknown.pop()}", mend="name it under [inputs] first")
    measured = np.column_stack([_column(file, columns, c.column) for c in channels])
    driven = [np.full(len(measured), float(s)) if isinstance(s, int | float) else _column(file, columns, s) for s in sources.values()]
    if len({len(d) for d in (*driven, measured)}) > 1:
        raise InputError("columns differ in length", file=file, mend="write one row per sample")
    return OwnLog(name, np.column_stack(driven), measured, dict(entry.get("parameters", {})), use == "held out")


def _columns(file: Path) -> Mapping[str, Any]:
    """Columns of a table, by name."""
    if not file.is_file():
        raise InputError("no such file", file=file, mend="correct the log's file in the TOML")
    try:
        if file.suffix == ".mat":
            return {name: values for name, values in loadmat(file).items() if not name.startswith("__")}
        table = pd.read_parquet(file) if file.suffix == ".parquet" else pd.read_csv(file, comment="#")
    except (ValueError, OSError, NotImplementedError) as error:
        raise InputError(f"cannot be read: {error}", file=file, mend="give a CSV, Parquet or MATLAB (up to v7) file") from None
    return {str(name): table[name].to_numpy() for name in table.columns}


def _column(file: Path, columns: Mapping[str, Any], name: str) -> Array:
    if name not in columns:
        raise InputError("no such column", file=file, field=name, mend=f"use one of {', '.join(columns)}")
    try:
        values = np.asarray(columns[name], dtype=np.float64).ravel()
    except (TypeError, ValueError):
        raise InputError("holds what is no number", file=file, field=name, mend="write numbers, SI") from None
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise InputError(f"is not finite in row {bad[0]}", file=file, field=name, mend="cut the log there")
    return values
