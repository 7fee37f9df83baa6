"""Logs: 1 kHz tables of sensors and commands in SI units, as Parquet or CSV, checked when read.

Row k holds the sensors at t_k and the command that acts over [t_k, t_k + 1 ms).
"""

from __future__ import annotations

import difflib
import io
import json
import math
import os
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from modelica_fmu.errors import InputError
from modelica_fmu.files import check_source, write_atomically
from pyfmi_runner.mat_file import read_mat

__all__ = [
    "COLUMNS",
    "LABELS",
    "MEASURED",
    "OPTIONAL",
    "PERIOD",
    "PHASES",
    "REQUIRED",
    "SIGMA",
    "STROKE_X",
    "STROKE_Z",
    "Column",
    "Log",
    "check_table",
    "parsed_numbers",
    "read_log",
    "read_table",
    "write_atomically",
    "write_log",
]

PERIOD = 0.001  # s, between rows
STROKE_X = 1.0  # m, x piston 0..1
STROKE_Z = 0.101  # m, z piston 0..0.101
PHASES = (
    "approach",
    "contact",
    "contour",
    "retreat",
)  # column `phase` holds the index; names are accepted on reading
MIN_ROWS = 10
LARGEST = 10**300
_SPAN = {
    "x": f"0..{STROKE_X:g}",
    "z": f"0..{STROKE_Z:g}",
    "u_x": "0..5",
    "u_z": "0..5",
}  # what a message calls expected


class Column(NamedTuple):
    """Unit, sign and bounds of one column. Bounds hold for any sane log, errors of a calibrated
    sensor included.
    """

    unit: str
    sign: str
    low: float
    high: float


_CODE = Column("1", "index into PHASES", -np.inf, np.inf)
COLUMNS: Mapping[str, Column] = {
    "time": Column("s", "sample instant t_k, one row per millisecond", -np.inf, np.inf),
    "u_x": Column("V", "x valve command, 0..5; more pushes the x piston to -x", -0.5, 5.5),
    "u_z": Column("V", "z valve command, 0..5; more pushes the z piston to +z", -0.5, 5.5),
    "x": Column("m", "x piston position, 0..1", -0.05, STROKE_X + 0.05),
    "z": Column(
        "m", "z piston position, 0..0.101, > 0 towards the workpiece", -0.01, STROKE_Z + 0.01
    ),
    "v_x": Column("m/s", "dx/dt; tracking runs towards -x", -12.0, 12.0),
    "v_z": Column("m/s", "dz/dt", -6.0, 6.0),
    "f_x": Column("N", "force of the robot on the workpiece along +x", -5e3, 5e3),
    "f_z": Column("N", "force of the robot on the workpiece along +z", -5e3, 5e3),
    "f_ax": Column("N", "x actuator force along +x; the one-way valve makes it <= 0", -5e3, 5e3),
    "f_az": Column("N", "z actuator force along +z; the one-way valve makes it >= 0", -5e3, 5e3),
    "f_nd": Column("N", "wanted normal force, > 0 presses into the workpiece", -5e3, 5e3),
    "v_td": Column("m/s", "wanted tangential speed, < 0 towards -x", -12.0, 12.0),
    "theta": Column("rad", "slope angle of the edge, tan(theta) = dz_w/dx", -np.inf, np.inf),
    "phase": _CODE,
}
OPTIONAL = ("f_nd", "v_td", "theta", "phase")
REQUIRED = tuple(name for name in COLUMNS if name not in OPTIONAL)
MEASURED = ("x", "z", "v_x", "v_z", "f_x", "f_z", "f_ax", "f_az")
LABELS = tuple(f"{name} [{COLUMNS[name].unit}]" for name in MEASURED)  # of axes and tables
# RMS noise of the sensors in the column's unit, Table 3.3
SIGMA: Mapping[str, float] = {
    "x": 0.3e-3,
    "z": 0.1e-3,
    "v_x": 1.0e-3,
    "v_z": 0.5e-3,
    "f_x": 0.05,
    "f_z": 0.05,
    "f_ax": 0.05,
    "f_az": 0.05,
}


@dataclass(frozen=True, eq=False)
class Log:
    """A log in memory. table: the columns of COLUMNS as float64, then the file's others;
    provenance: JSON values.
    """

    table: pd.DataFrame
    name: str = "log"
    provenance: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.table)

    def __getitem__(self, column: str) -> NDArray[np.float64]:
        """One column as an array of float64, shape (N,)."""
        return np.asarray(self.table[column].to_numpy(dtype=np.float64))

    def __contains__(self, column: str) -> bool:
        return column in self.table.columns

    @property
    def time(self) -> NDArray[np.float64]:
        return self["time"]

    def measured(self) -> NDArray[np.float64]:
        """The eight measured channels in the order of MEASURED, shape (N, 8)."""
        return np.asarray(self.table[list(MEASURED)].to_numpy(dtype=np.float64))


# ---------------------------------------------------------------- files


Convert = Callable[[pd.DataFrame, Path], tuple[pd.DataFrame, list[str]]]


def read_log(
    path: str | os.PathLike[str],
    convert: Convert | None = None,
    needs: Sequence[str] = REQUIRED,
) -> Log:
    """Read and check a Parquet, CSV or MATLAB log. convert: makes the file's own table one of
    COLUMNS, SI units and 1 kHz, and says what it changed (`log_import.Import`). needs: columns that
    must be there, "time" among them. Raises InputError naming file, column or row, and the hint.
    """
    path = Path(path)
    table, provenance = read_table(path)
    if convert is not None:
        table, notes = convert(table, path)
        provenance = provenance | {"import": notes}
    return Log(check_table(table, path, needs), path.stem, provenance)


def read_table(path: Path) -> tuple[pd.DataFrame, dict[str, Any]]:
    """A log file's table as it stands there, and its provenance. Raises InputError."""
    if os.path.isdir(path):
        raise InputError(
            "is a folder, expected a log file",
            file=path,
            hint="name one .parquet or .csv file in it",
        )
    check_source(path)
    try:
        with path.open("rb") as stream:
            head = stream.read(4)
    except FileNotFoundError:
        raise InputError("no such file", file=path, hint=_hint_absent(path)) from None
    except (OSError, ValueError) as error:  # ValueError: a path that holds a NUL
        reason = getattr(error, "strerror", error)
        raise InputError(
            f"cannot be read ({reason})", file=path, hint="check its path and permissions"
        ) from None
    if not head:
        raise InputError("the file is empty", file=path, hint="record or export the log again")
    suffix = path.suffix.lower()
    if head == b"PAR1" or suffix in (".parquet", ".pq"):
        return _read_parquet(path)
    if suffix in (".csv", ".txt"):
        return _read_csv(path)
    if suffix == ".mat":
        return _read_matlab(path), {}
    raise InputError(
        f"unknown kind of file {suffix!r}", file=path, hint="give a .parquet, .csv or .mat file"
    )


def write_log(log: Log, path: str | os.PathLike[str]) -> Path:
    """Write a log as Parquet or CSV (by suffix), with provenance and units. Atomic: a reader sees
    all of it or none.

    Values survive the round trip bit for bit. Provenance should be JSON values; others are written
    as their `str()`. Raises InputError where the path cannot be written.
    """
    path = Path(path)
    writers = {".parquet": _write_parquet, ".pq": _write_parquet, ".csv": _write_csv}
    if path.suffix.lower() not in writers:
        raise InputError(
            f"unknown kind of log file {path.suffix!r}",
            file=path,
            hint="end it in .parquet or .csv",
        )
    write_atomically(path, lambda temporary: writers[path.suffix.lower()](log, temporary))
    return path


def _hint_absent(path: Path) -> str:
    beside = sorted(
        p.name for p in path.parent.glob("*") if p.suffix.lower() in (".parquet", ".csv")
    )
    near = difflib.get_close_matches(path.name, beside, n=1)
    return f"did you mean {near[0]}?" if near else "check the path"


def _json(value: object) -> str:
    return json.dumps(value, default=str)


def _units(table: pd.DataFrame) -> dict[str, str]:
    return {name: COLUMNS[name].unit for name in table.columns if name in COLUMNS}


def _write_parquet(log: Log, path: Path) -> None:
    table = pa.Table.from_pandas(log.table, preserve_index=False)
    units = _units(log.table)
    fields = [
        f.with_metadata({"unit": units[f.name]}) if f.name in units else f for f in table.schema
    ]
    metadata = {"provenance": _json(log.provenance), "units": _json(units)}
    pq.write_table(table.cast(pa.schema(fields)).replace_schema_metadata(metadata), path)


def _read_parquet(path: Path) -> tuple[pd.DataFrame, dict[str, Any]]:
    try:
        table = pq.read_table(path, partitioning=None)
        provenance = json.loads((table.schema.metadata or {}).get(b"provenance", b"{}"))
        frame = table.to_pandas(ignore_metadata=True)
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = str(error).split("\n")[0].rstrip(". ")[:120]
        raise InputError(
            f"not a readable Parquet file ({reason})", file=path, hint="record or export it again"
        ) from None
    return frame, provenance if isinstance(provenance, dict) else {"provenance": provenance}


def _read_matlab(path: Path) -> pd.DataFrame:
    """The longest columns of a MATLAB file that are of one length; a matrix' columns are numbered
    from 1.
    """
    try:
        arrays = read_mat(path)
    except ValueError as error:
        raise InputError(
            f"not a readable MATLAB file ({str(error)[:120]})",
            file=path,
            hint="save it with -v7, as columns of one length",
        ) from None
    columns: dict[str, NDArray[np.generic]] = {}
    for name, values in arrays.items():
        flat = values.reshape(-1, 1) if 1 in values.shape or values.ndim == 1 else values
        if flat.ndim == 2 and flat.shape[1] == 1:
            columns[name] = flat[:, 0]
        elif flat.ndim == 2:
            columns |= {f"{name}_{k + 1}": flat[:, k] for k in range(flat.shape[1])}
    rows = max((len(values) for values in columns.values()), default=0)
    return pd.DataFrame({name: v for name, v in columns.items() if len(v) == rows})


def _write_csv(log: Log, path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        for key, value in [*log.provenance.items(), ("units", _units(log.table))]:
            name = str(key)
            stream.write(
                f"# {name if re.fullmatch(r'[A-Za-z0-9_.-]+', name) else _json(name)}: "
                f"{_json(value)}\n"
            )
        log.table.to_csv(stream, index=False)


def _read_csv(path: Path) -> tuple[pd.DataFrame, dict[str, Any]]:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines(keepends=True)
    except UnicodeDecodeError:
        raise InputError(
            "not a text file in UTF-8", file=path, hint="export the log as CSV in UTF-8"
        ) from None
    first = next(
        (k for k, line in enumerate(lines) if line.strip() and not line.startswith("#")), None
    )
    if first is None:
        raise InputError(
            "no table: the file has no header line",
            file=path,
            hint="record or export the log again",
        )
    separator = max(",;\t", key=lines[first].count)
    wanted = lines[first].count(separator)
    for k, line in enumerate(lines[first + 1 :], first + 2):
        if line.count(separator) != wanted and line.strip() and '"' not in line:
            message = (
                f"line {k} has {line.count(separator) + 1} values, the header {wanted + 1} names"
            )
            hint = (
                "delete it: it is cut short"
                if k == len(lines)
                else "use decimal points, one value per column"
            )
            raise InputError(message, file=path, hint=hint)
    try:
        body = io.StringIO("".join(lines[first:]))
        with warnings.catch_warnings():
            warnings.simplefilter(
                "error", pd.errors.ParserWarning
            )  # it would drop values that the header does not name
            frame = pd.read_csv(
                body,
                sep=separator,
                decimal=_decimal(lines[first + 1 : first + 20], separator),
                skipinitialspace=True,
                index_col=False,
            )
    except (pd.errors.ParserError, pd.errors.EmptyDataError, pd.errors.ParserWarning) as error:
        reason = str(error).replace("Error tokenizing data. C error: ", "")
        raise InputError(
            f"not a readable table ({reason})", file=path, hint="even out the rows"
        ) from None
    frame.columns = [str(name).strip().strip('"') for name in frame.columns]
    return frame, dict(_comments(lines[:first]))


def _decimal(rows: list[str], separator: str) -> str:
    """The decimal mark: a comma where no comma separates and no number has a point."""
    text = "".join(rows)
    comma = separator != "," and re.search(r"\d,\d", text) and not re.search(r"\d\.\d", text)
    return "," if comma else "."


def _comments(lines: list[str]) -> Iterator[tuple[str, Any]]:
    """Pairs of the lines `# key: value`; the key `units` is the file's own and left out, other
    comments too.
    """
    for line in lines:
        match = re.fullmatch(r'#\s*("(?:[^"\\]|\\.)*"|[^:"]+?)\s*:\s*(.*?)\s*', line.rstrip("\r\n"))
        if match is None or match[1] == "units":
            continue
        try:
            value = json.loads(match[2])
        except ValueError:
            value = match[2]
        yield (json.loads(match[1]) if match[1].startswith('"') else match[1]), value


# ---------------------------------------------------------------- checks that refuse


def check_table(
    table: pd.DataFrame,
    file: str | os.PathLike[str] | None = None,
    needs: Sequence[str] = REQUIRED,
) -> pd.DataFrame:
    """The table with its known columns as float64, unknown ones kept as they are.

    needs: columns that must be there, "time" among them. Raises InputError for the first of: a
    missing column, a value that is no finite number, time that is not 1 kHz, values that are not in
    the column's unit.
    """

    def refuse(message: str, column: str | None, hint: str) -> NoReturn:
        raise InputError(message, file=file, field=column, hint=hint)

    if not table.columns.is_unique:
        refuse(
            "column is there twice",
            str(table.columns[table.columns.duplicated()][0]),
            "keep one of them",
        )
    for name in needs:
        if name not in table.columns:
            spare = {_bare(str(c)): str(c) for c in table.columns if c not in COLUMNS}
            near = difflib.get_close_matches(_bare(name), list(spare), n=1, cutoff=0.5)
            hint = (
                f'rename column "{spare[near[0]]}" to "{name}"'
                if near
                else f"add it [{COLUMNS[name].unit}]"
            )
            refuse("column is missing", name, hint)
    if len(table) < MIN_ROWS:
        refuse(
            f"{len(table)} rows, expected at least {MIN_ROWS}",
            None,
            "record or export the log again",
        )
    known = [name for name in table.columns if name in COLUMNS]
    numbers = {name: _numbers(table[name], name, file) for name in known}
    values = np.column_stack(list(numbers.values()))
    if not np.isfinite(values).all():
        row, k = (int(i) for i in np.argwhere(~np.isfinite(values))[0])
        text = "empty or NaN" if np.isnan(values[row, k]) else "infinite"
        last = row == len(values) - 1
        hint = (
            "the last row is cut short: delete it" if last else "fill it in, or cut the log there"
        )
        refuse(
            f"row {row} is {text}",
            known[k],
            hint if known[k] in REQUIRED else "fill it in, or drop the column",
        )
    _check_time(numbers["time"], refuse)
    _check_units(numbers, refuse)
    return pd.DataFrame({name: numbers.get(name, table[name]) for name in table.columns})


def _bare(name: str) -> str:
    return re.sub(r"[^a-z]|\bpos(ition)?\b", "", name.lower().split("[")[0].split("(")[0])


def parsed_numbers(column: pd.Series) -> NDArray[np.float64]:
    """A column of any type as float64: NaN where there is no number, infinity where it is beyond a
    float.
    """
    if column.dtype == object:
        column = column.map(
            lambda value: math.inf if isinstance(value, int) and abs(value) > LARGEST else value
        )  # pandas overflows
    return np.asarray(pd.to_numeric(column, errors="coerce").to_numpy(dtype=np.float64))


def _numbers(
    column: pd.Series, name: str, file: str | os.PathLike[str] | None
) -> NDArray[np.float64]:
    try:
        if column.dtype != object:
            return np.asarray(column.to_numpy(dtype=np.float64))
    except (TypeError, ValueError, OverflowError):
        pass
    if name == "phase":
        codes = {phase: float(code) for code, phase in enumerate(PHASES)}
        column = column.map(
            lambda value: codes.get(value, value) if isinstance(value, str) else value
        )
    parsed = parsed_numbers(column)
    bad = np.flatnonzero(np.isnan(parsed) & column.notna().to_numpy())
    if len(bad):
        value = column.iloc[int(bad[0])]
        known = (
            f"use a number or one of {', '.join(PHASES)}"
            if name == "phase"
            else "use plain numbers"
        )
        hint = "use a decimal point" if re.fullmatch(r"\s*[-+]?\d*,\d+\s*", str(value)) else known
        raise InputError(
            f"row {int(bad[0])} is {str(value)[:40]!r}, not a number",
            file=file,
            field=name,
            hint=hint,
        )
    return np.asarray(parsed)


def _check_time(time: NDArray[np.float64], refuse: Callable[[str, str, str], NoReturn]) -> None:
    steps = np.diff(time)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        refuse(
            f"row {row} (t = {time[row]:g} s) does not increase",
            "time",
            "sort the rows, drop repeated ones",
        )
    typical, mean = float(np.median(steps)), float(steps.mean())
    if abs(typical / PERIOD - 1) > 0.01:
        if abs(typical - 1) < 0.01:
            refuse("looks like milliseconds: one row per 1 s", "time", "divide column time by 1000")
        thin = typical < 0.6 * PERIOD
        hint = (
            f"keep every {round(PERIOD / typical)}th row"
            if thin
            else "record at 1 kHz, or resample to it"
        )
        refuse(f"sampled at {1 / typical:.6g} Hz, expected 1000 Hz", "time", hint)
    odd = np.flatnonzero((steps > 1.5 * PERIOD) | (steps < 0.5 * PERIOD))
    if len(odd):
        row = int(odd[0]) + 1
        what = "gap" if steps[row - 1] > PERIOD else "step"
        hint = (
            "cut the log there, or fill the missing rows" if what == "gap" else "resample to 1 kHz"
        )
        size = f"{1e3 * steps[row - 1]:.4g} ms, expected 1 ms"
        refuse(f"row {row} (t = {time[row]:g} s) follows a {what} of {size}", "time", hint)
    if abs(mean / PERIOD - 1) > 0.01:
        refuse(
            f"sampled at {1 / mean:.6g} Hz on average, expected 1000 Hz",
            "time",
            "resample to 1 kHz",
        )


def _check_units(
    numbers: Mapping[str, NDArray[np.float64]], refuse: Callable[[str, str, str], NoReturn]
) -> None:
    def within(name: str, scale: float = 1.0, of: str | None = None) -> bool:
        column, values = COLUMNS[of or name], numbers[name]
        return bool(values.min() * scale >= column.low and values.max() * scale <= column.high)

    both = "x" in numbers and "z" in numbers
    if both and not within("z") and within("x", of="z") and within("z", of="x"):
        reach = numbers["z"].max()
        refuse(
            f"reaches {reach:.4g} m, beyond the z stroke, while x stays inside it",
            "z",
            "swap columns x and z",
        )
    for name in numbers:
        if within(name):
            continue
        low, high, unit = COLUMNS[name].low, COLUMNS[name].high, COLUMNS[name].unit
        row = int(np.argmax((numbers[name] < low) | (numbers[name] > high)))
        small = within(name, 1e-3)
        span = _SPAN.get(name, f"{low:g}..{high:g}")
        looks = f", looks like m{unit}" if small else ""
        hint = (
            f"divide column {name} by 1000" if small else "check the column's unit, zero and order"
        )
        refuse(f"row {row} is {numbers[name][row]:.6g}, expected {span} {unit}{looks}", name, hint)
    for position, name in (("x", "v_x"), ("z", "v_z")):
        if name not in numbers:
            continue
        noise = float(np.std(np.diff(numbers[name])))  # a tachometer's in mm/s is 1000 times it
        travelled = numbers.get(position, np.zeros(0))
        if noise > 150 * SIGMA[name] and not _moves_at(numbers[name], travelled):
            refuse(
                f"noise of {noise:.2g} m/s, looks like mm/s", name, f"divide column {name} by 1000"
            )


def _moves_at(speed: NDArray[np.float64], position: NDArray[np.float64]) -> bool:
    """Whether a position [m] moves as a speed says, so that what looks like noise is an
    oscillation.
    """
    rows = 10  # over which a position's noise is small
    if len(position) <= rows:
        return False
    moved = (position[rows:] - position[:-rows]) / (rows * PERIOD)
    said = np.convolve(0.5 * (speed[1:] + speed[:-1]), np.full(rows, 1 / rows), "valid")
    return bool(np.std(said - moved) < 0.3 * np.std(said))
