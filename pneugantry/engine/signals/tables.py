"""Columns of a recorder's table as inputs and signals: by the names, units and stamps that a
description gives. CSV, Parquet and MATLAB files.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from modelica_fmu.errors import InputError
from pneugantry.engine.plant import Array
from pyfmi_runner.log import parsed_numbers, read_table
from pyfmi_runner.log_import import UNITS
from pyfmi_runner.resample import on_grid

if TYPE_CHECKING:
    import pint

__all__ = ["STAMPS", "Column", "Table", "conversion", "noise_of", "read_columns"]

EVEN = 1e-3  # of a period: stamps within it, and the rate too, need no resampling
FINEST, COARSEST = 1e-5, 86_400.0  # s, periods that a description may name: to a day
FARTHEST = 100.0  # times the period from which on stamps are in another unit


@dataclass(frozen=True)
class Column:
    """Value = scale * raw + offset."""

    name: str
    scale: float = 1.0
    offset: float = 0.0  # in the unit of the result
    straight: bool = False  # between two rows; else it holds


STAMPS = Column("time")  # s, looked for where a description tells neither stamps nor period


@dataclass(frozen=True, eq=False)
class Table:
    """What was read of a log: row k at k * period."""

    period: float  # s
    columns: Mapping[str, Array]  # by the description's names
    notes: tuple[str, ...]
    unused: frozenset[str] = frozenset()  # columns of the file that the description does not name
    how: str = ""  # rows were brought to a grid, if they were


def conversion(recorded: str, wanted: str) -> tuple[float, float] | None:
    """Scale and offset by which a value in the unit `recorded` becomes one in `wanted`, units as
    Modelica writes them ("N.m", "m/s2"); None: they are no units of one quantity.
    """
    if recorded == wanted:
        return 1.0, 0.0
    for family in UNITS.values():
        if recorded in family and wanted in family:
            return family[recorded] / family[wanted], 0.0
    import pint  # costs half a second, for who records in other units than these

    units = _units()
    try:
        own, other = (units.parse_units(_in_products(unit)) for unit in (recorded, wanted))
        none, one = (float(units.Quantity(k, own).to(other).magnitude) for k in (0.0, 1.0))
    except (pint.PintError, ValueError, TypeError, AttributeError):
        return None
    return one - none, none


@cache
def _units() -> pint.UnitRegistry[float]:
    import pint

    return pint.UnitRegistry()


def _in_products(unit: str) -> str:
    """A unit as Modelica writes it, with signs for products and powers."""
    return "" if unit == "1" else re.sub(r"(?<=[A-Za-z])(?=-?\d)", "**", unit.replace(".", "*"))


def read_columns(
    file: Path,
    wanted: Mapping[str, Column],
    optional: Collection[str],
    time: Column | None,
    period: float | None,
    held: Collection[str],
) -> Table:
    """The columns of a file, on an even grid.

    optional: those that may be missing; held: those that act until their next row. time: stamps, in
    s; None: rows are `period` apart. period: s; None: as the stamps say. Uneven stamps, and those
    of another rate than `period` asks for, are resampled, which is noted. Raises InputError naming
    file, column and what to do.
    """
    table, _ = read_table(file)
    if not table.columns.is_unique:
        twice = str(table.columns[table.columns.duplicated()][0])
        raise InputError("a column is there twice", file=file, field=twice, hint="keep one")
    found = {
        name: _values(table, column, file)
        for name, column in wanted.items()
        if column.name in table.columns or name not in optional
    }
    if time is STAMPS and time.name not in table.columns:
        raise InputError(
            "nothing tells how far its rows are apart",
            file=file,
            field="plant.period",
            hint='write period = 1e-3 (in s), or time = "column of the stamps"',
        )
    named = {c.name for c in wanted.values()} | ({time.name} if time else set())
    unused = frozenset(map(str, table.columns)) - named
    if time is None:
        assert period is not None
        return Table(period, found, (), unused)
    made = _evened(found, _values(table, time, file), period, held, file)
    return replace(made, unused=unused)


def _evened(
    columns: Mapping[str, Array],
    stamps: Array,
    period: float | None,
    held: Collection[str],
    file: Path,
) -> Table:
    if len(stamps) < 3:
        raise InputError(f"has {len(stamps)} rows", file=file, hint="record the log again")
    steps = np.diff(stamps)
    typical = float(np.median(steps))
    grid = period or float(f"{typical:.4g}")
    hint = 'give the stamps\' unit, as in time = { column = "t", recorded = "ms" }'
    if not FINEST <= grid <= COARSEST:
        raise InputError(f"rows are {grid:g} s apart", file=file, field="time", hint=hint)
    if typical > FARTHEST * grid:
        told = f"rows are {typical:g} s apart, the period is {grid:g} s"
        raise InputError(told, file=file, field="time", hint=f"{hint}, or correct period")
    mean = float(stamps[-1] - stamps[0]) / len(steps)
    if np.max(np.abs(steps / grid - 1)) <= EVEN and abs(mean / grid - 1) <= EVEN:
        return Table(grid, columns, ())
    try:
        even, said, how = on_grid({**columns, "time": stamps}, grid, held)
    except InputError as error:
        raise _of_file(error, file) from None
    del even["time"]
    return Table(grid, even, (f"{file.name}: {said}",), how=how)


def _of_file(error: InputError, file: Path) -> InputError:
    """The same complaint about a file."""
    return InputError(error.message, file=file, field=error.field, hint=error.hint)


def _values(table: pd.DataFrame, column: Column, file: Path) -> Array:
    names = [str(c) for c in table.columns]
    if column.name not in table.columns:
        near = difflib.get_close_matches(column.name, names, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"use one of {', '.join(names[:12])}"
        raise InputError("no such column", file=file, field=column.name, hint=hint)
    values = column.scale * parsed_numbers(table[column.name]) + column.offset
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise InputError(
            f"is no finite number in row {bad[0]}",
            file=file,
            field=column.name,
            hint="write plain numbers, or cut the log there",
        )
    return np.ascontiguousarray(values)


def noise_of(signals: Collection[Array]) -> float:
    """RMS of the white noise of a signal, from its third differences in several logs: what is
    smooth leaves none there. A coarse converter's steps count as uniform noise.
    """
    if not any(len(v) > 3 for v in signals):
        return 0.0
    third = np.concatenate([np.abs(np.diff(v, 3)) for v in signals if len(v) > 3])
    spread = 1.4826 * float(np.median(third)) / np.sqrt(20.0)
    if spread > 0:
        return spread
    steps = np.concatenate([np.abs(np.diff(v)) for v in signals])
    return float(steps[steps > 0].min() / np.sqrt(12.0)) if (steps > 0).any() else 0.0
