"""A recorder's own table made a log: which of its columns is which, in what unit, at what rate.

[import]
time = { column = "t [ms]", unit = "ms" }     # or rate = 500 where there are no stamps
z = { column = "Zpos", unit = "mm", offset = -0.002 }
u_x = "Ventil X"                               # a name alone: already in SI
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from modelica_fmu.errors import InputError
from pyfmi_runner.log import COLUMNS, MEASURED, parsed_numbers
from pyfmi_runner.resample import even_stamps, is_regular, resampled
from pyfmi_runner.scenario import Fields

__all__ = ["UNITS", "Import", "Source", "import_from"]

UNITS: Mapping[str, Mapping[str, float]] = {  # SI unit: what else a recorder writes, in it
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "m": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "in": 0.0254},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2, "in/s": 0.0254},
    "N": {"N": 1.0, "kN": 1e3, "mN": 1e-3, "kgf": 9.80665, "lbf": 4.4482216152605},
    "V": {"V": 1.0, "mV": 1e-3},
    "rad": {"rad": 1.0, "deg": np.pi / 180.0},
    "1": {"1": 1.0},
}
ABSENT = "?"  # stands in a set-up file where its writer has to say something
NAMES = tuple(COLUMNS)


@dataclass(frozen=True)
class Source:
    """Where a column of a log comes from: SI value = scale * (factor of the unit) * raw
    + offset.
    """

    column: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0  # in SI


@dataclass(frozen=True)
class Import:
    """How a recorder's table becomes a log. Called with the table and its path."""

    sources: Mapping[str, Source] = field(default_factory=dict)
    rate: float | None = None  # Hz, where there are no stamps
    file: str | None = None  # where this stands, for messages

    def __call__(self, table: pd.DataFrame, path: Path) -> tuple[pd.DataFrame, list[str]]:
        """The table in COLUMNS, SI units and at 1 kHz, and what was changed, a sentence each.
        Raises InputError naming file, key and hint.
        """
        columns = {name: self._values(name, table, path) for name in self._read(table)}
        if self.rate is not None:
            columns["time"] = even_stamps(len(table), self.rate)
        if "time" not in columns:
            raise InputError(
                "is missing", file=self.file, field="import.time", hint="name it, or give rate"
            )
        notes = [f"columns read as {self._mapping()}"] if self.sources else []
        finite = all(np.isfinite(values).all() for values in columns.values())
        if finite and len(columns["time"]) > 2 and not is_regular(columns["time"]):
            try:
                columns, said = resampled(columns)
            except InputError as error:
                raise InputError(
                    error.message, file=path, field=error.field, hint=error.hint
                ) from None
            notes.append(said)
        order = ["time", *(name for name in columns if name != "time")]
        return pd.DataFrame({name: columns[name] for name in order}), notes

    def _read(self, table: pd.DataFrame) -> list[str]:
        """Columns of the log: those with a source, and those that the table names as a log does."""
        return [name for name in NAMES if name in self.sources or name in table.columns]

    def _values(self, name: str, table: pd.DataFrame, path: Path) -> NDArray[np.float64]:
        source = self.sources.get(name, Source(name, COLUMNS[name].unit))
        if source.column == ABSENT:
            raise InputError(
                "is not filled in yet",
                file=self.file,
                field=f"import.{name}.column",
                hint=f"name the column of {path.name}; it has {_list(table)}",
            )
        if source.column not in table.columns:
            near = difflib.get_close_matches(source.column, [str(c) for c in table.columns], n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"it has {_list(table)}"
            raise InputError(
                f"{path.name} has no column {source.column!r}",
                file=self.file,
                field=f"import.{name}.column",
                hint=hint,
            )
        factor = UNITS[COLUMNS[name].unit][source.unit]
        raw = parsed_numbers(table[source.column])
        return np.asarray(source.scale * factor * raw + source.offset)

    def _mapping(self) -> str:
        return ", ".join(
            f"{name} = {source.column!r} [{source.unit}]" for name, source in self.sources.items()
        )


def _list(table: pd.DataFrame) -> str:
    names = [repr(str(c)) for c in table.columns]
    return ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")


def import_from(table: Mapping[str, Any], file: str | os.PathLike[str] | None = None) -> Import:
    """An import from its TOML table. Raises InputError naming file, key and hint."""
    fields = Fields(table, (*NAMES, "rate"), file, "import.")
    rate = fields.number("rate", None, 1.0, 1e6)
    if rate is not None and "time" in fields:
        fields.refuse("rate", "is given beside time", "keep one of them")
    sources = {name: _source(fields, name) for name in fields.table if name != "rate"}
    return Import(sources, rate, None if file is None else os.fspath(file))


def _source(fields: Fields, name: str) -> Source:
    si = COLUMNS[name].unit
    if isinstance(fields.table[name], str):
        return Source(fields.table[name], si)
    sub = fields.sub(name, ("column", "unit", "scale", "offset"))
    unit = sub.of_type("unit", str, si)
    if unit not in UNITS[si]:
        sub.refuse("unit", f"is {unit!r}, no unit of {name}", f"use {', '.join(UNITS[si])}")
    column = sub.of_type("column", str, name)
    return Source(column, unit, sub.number("scale", 1.0), sub.number("offset", 0.0))


assert set(MEASURED) <= set(NAMES)
