"""Mangled logs: bytes, cells, columns, rows and types that no logger writes, as CSV and as
Parquet.
"""

from __future__ import annotations

import datetime
import decimal
import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from scipy.io import savemat

from benchmarks.soak.fuzz import Kinds, Read, with_bytes_changed
from pneugantry.engine.describe import described
from pyfmi_runner.build import build_fmu, cache_folder
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.log import COLUMNS, read_log
from pyfmi_runner.suspicions import log_warnings
from pyfmi_runner.workpiece import default_standoff, read_profile

__all__ = ["LOGS", "sound_csv"]

Cells = list[list[str]]  # the header, then the rows
ROWS = 30
ODD_CELLS = (
    "",
    " ",
    "nan",
    "NaN",
    "inf",
    "-inf",
    "1e999",
    "-1e308",
    "0x10",
    "1,5",
    "1.5.5",
    "--",
    "true",
    "None",
    "null",
    '"',
    '""',
    "'",
    "1_000",
    "٣",
    "5 V",
    "9999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999999",
    "contour",
    "\u0000",
    "\ufeff",
    "\r",
    "é",
    "2026-01-01",
    "1+2j",
    "[1]",
    "#",
    "# a: 1",
    ";",
    "\t",
)
ODD_NAMES = (
    "",
    " ",
    "time",
    "x",
    "x ",
    "X",
    "z ",
    "u_x",
    "v-z",
    "time.1",
    "Unnamed: 0",
    "index",
    "phase",
    "theta",
    "\u0000",
    '"',
    "x,z",
    "# x",
    "éééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééééé",
)
ODD_JSON = (
    "{",
    "[]",
    "3",
    "null",
    "NaN",
    '{"setup": 3}',
    '{"setup": {}}',
    '{"setup": {"loop": "both"}}',
    '{"setup": {"start": [1]}}',
    "ÿ",
    '"a"',
)


def _sound(name: str, row: int) -> float:
    return {"time": row * 1e-3, "x": 0.5, "z": 0.05, "u_x": 0.6, "u_z": 0.8, "phase": 1.0}.get(
        name, 0.0
    )


def _cells() -> Cells:
    return [list(COLUMNS), *([repr(_sound(name, k)) for name in COLUMNS] for k in range(ROWS))]


def sound_csv() -> str:
    return "\n".join(",".join(row) for row in _cells()) + "\n"


def _reading(path: Path) -> Read:
    def read() -> None:
        log_warnings(read_log(path))
        read_campaign(path, strict=False)

    return read


def _csv(change: Callable[[random.Random, Cells], None]) -> Callable[[random.Random, Path], Read]:
    def draw(rng: random.Random, folder: Path) -> Read:
        cells = _cells()
        for _ in range(rng.randint(1, 4)):
            change(rng, cells)
        mark, end = rng.choice(",,,;\t"), rng.choice(["\n", "\n", "\r\n", "\r"])
        head = rng.choice(
            [
                "",
                "",
                "# rig: bench\n",
                f"# setup: {rng.choice(ODD_JSON)}\n",
                f"# {rng.choice(ODD_NAMES)}: {rng.choice(ODD_CELLS)}\n",
            ]
        )
        text = head + end.join(mark.join(row) for row in cells) + rng.choice(["", end])
        path = folder / "log.csv"
        path.write_bytes(
            text.encode(
                rng.choice(["utf-8", "utf-8", "utf-8-sig", "utf-16", "latin-1"]), errors="replace"
            )
        )
        return _reading(path)

    return draw


def _cell(rng: random.Random, cells: Cells) -> None:
    row = cells[rng.randrange(len(cells))]
    k = rng.randrange(len(row) or 1)
    row[k : k + 1] = [rng.choice(ODD_CELLS)]


def _column(rng: random.Random, cells: Cells) -> None:
    """One column left out, doubled, moved, renamed, or all its cells odd."""
    j, to, name, cell = (
        rng.randrange(len(cells[0]) or 1),
        rng.randrange(len(cells[0]) or 1),
        rng.choice(ODD_NAMES),
        rng.choice(ODD_CELLS),
    )
    change = rng.randrange(5)
    for k, row in enumerate(cells):
        if j >= len(row):
            continue
        if change == 0 and len(row) > 1:
            del row[j]
        elif change == 1:
            row.insert(to, row[j])
        elif change == 2:
            row.insert(to, row.pop(j))
        elif change == 3 and k == 0:
            row[j] = name
        elif change == 4 and k > 0:
            row[j] = cell


def _row(rng: random.Random, cells: Cells) -> None:
    """Rows left out, doubled, moved, emptied, too short or too long."""
    k = rng.randrange(len(cells))
    change = rng.randrange(6)
    if change == 0:
        del cells[k : k + rng.randint(1, ROWS)]
    elif change == 1:
        cells.insert(rng.randrange(len(cells)), list(cells[k]))
    elif change == 2:
        cells.append(cells.pop(k))
    elif change == 3:
        cells[k] = [""] * rng.randint(0, 20)
    elif change == 4:
        cells[k] = cells[k][: rng.randrange(len(cells[k]) + 1)]
    else:
        cells[k] = cells[k] + [rng.choice(ODD_CELLS) for _ in range(rng.randint(1, 5))]
    if not any(cells):
        cells[:] = [[""]]


def _csv_bytes(rng: random.Random, folder: Path) -> Read:
    path = folder / rng.choice(["log.csv", "log.csv", "log.txt", "log.parquet", "log"])
    path.write_bytes(with_bytes_changed(rng, sound_csv().encode()))
    return _reading(path)


def _parquet(
    rng: random.Random,
    folder: Path,
    columns: list[tuple[str, Any]],
    metadata: dict[str, str] | None = None,
) -> Path:
    path = folder / "log.parquet"
    names, arrays = [name for name, _ in columns], [array for _, array in columns]
    pq.write_table(
        pa.Table.from_arrays(arrays, names=names).replace_schema_metadata(metadata), path
    )
    return path


def _sound_columns() -> list[tuple[str, Any]]:
    return [(name, pa.array([_sound(name, k) for k in range(ROWS)])) for name in COLUMNS]


def _parquet_bytes(rng: random.Random, folder: Path) -> Read:
    path = _parquet(rng, folder, _sound_columns(), {"provenance": json.dumps({"rig": "bench"})})
    path.write_bytes(with_bytes_changed(rng, path.read_bytes()))
    return _reading(path)


def _parquet_types(rng: random.Random, folder: Path) -> Read:
    """Columns of types that hold no numbers, or hold them oddly; odd values among sound ones."""
    columns = _sound_columns()
    kinds: list[Callable[[list[float]], Any]] = [
        lambda v: pa.array([str(x) for x in v]),
        lambda v: pa.array([rng.choice(ODD_CELLS) for _ in v]),
        lambda v: pa.array([f"{x}".encode() for x in v]),
        lambda v: pa.array([[x] for x in v]),
        lambda v: pa.array([{"a": x} for x in v]),
        lambda v: pa.array([x > 0 for x in v]),
        lambda v: pa.nulls(len(v)),
        lambda v: pa.array([None if rng.random() < 0.2 else x for x in v]),
        lambda v: pa.array([round(x) for x in v]),
        lambda v: pa.array([round(x) for x in v], pa.uint8()),
        lambda v: pa.array(v, pa.float32()),
        lambda v: pa.array([decimal.Decimal(repr(x)) for x in v]),
        lambda v: pa.array(
            [datetime.datetime(2026, 1, 1) + datetime.timedelta(seconds=x) for x in v]
        ),
        lambda v: pa.array([datetime.timedelta(seconds=x) for x in v]),
        lambda v: pa.array([datetime.date(2026, 1, 1) for _ in v]),
        lambda v: pa.array([str(x) for x in v]).dictionary_encode(),
        lambda v: pa.array(
            [rng.choice([float("nan"), float("inf"), 1e308, -1e308, 5e-324, x]) for x in v]
        ),
        lambda v: pa.array([x * rng.choice([1e3, -1.0, 1e-3]) for x in v]),
    ]
    for _ in range(rng.randint(1, 3)):
        j = rng.randrange(len(columns))
        columns[j] = (
            columns[j][0],
            rng.choice(kinds)([_sound(columns[j][0], k) for k in range(ROWS)]),
        )
    return _reading(_parquet(rng, folder, columns))


def _parquet_columns(rng: random.Random, folder: Path) -> Read:
    """Columns left out, doubled, renamed; few rows or none; metadata that is no JSON, or holds an
    odd set-up.
    """
    columns = _sound_columns()
    for _ in range(rng.randint(0, 3)):
        j = rng.randrange(len(columns))
        change = rng.randrange(3)
        if change == 0 and len(columns) > 1:
            del columns[j]
        elif change == 1:
            columns.insert(rng.randrange(len(columns)), columns[j])
        else:
            columns[j] = (rng.choice(ODD_NAMES), columns[j][1])
    rows = rng.choice([ROWS, ROWS, ROWS, 0, 1, 2, 10])
    metadata = {rng.choice(["provenance", "provenance", "units", "pandas"]): rng.choice(ODD_JSON)}
    return _reading(
        _parquet(rng, folder, [(name, array[:rows]) for name, array in columns], metadata)
    )


def _edge(rng: random.Random, folder: Path) -> Read:
    """An edge of the user's own: a point's values odd, doubled or moved; bytes changed."""
    cells = [["x", "z_w"], *([f"{k / 20}", "0.01"] for k in range(21))]
    for _ in range(rng.randint(0, 2)):
        rng.choice([_cell, _column, _row])(rng, cells)
    data = "\n".join(",".join(row) for row in cells).encode()
    path = folder / "edge.csv"
    path.write_bytes(with_bytes_changed(rng, data) if rng.random() < 0.3 else data)
    return lambda: (read_profile(path), default_standoff(path))


def _own_log(rng: random.Random, folder: Path) -> Read:
    """A log of a user's own plant, CSV, Parquet or MATLAB, with bytes changed."""
    path = folder / rng.choice(["log.mat", "log.csv", "log.parquet"])
    if path.suffix == ".mat":
        savemat(
            path,
            {name: [_sound(name, k) for k in range(ROWS)] for name in COLUMNS},
            do_compression=rng.random() < 0.5,
        )
    elif path.suffix == ".parquet":
        _parquet(rng, folder, _sound_columns())
    else:
        path.write_text(sound_csv(), encoding="utf-8")
    path.write_bytes(with_bytes_changed(rng, path.read_bytes()))
    text = (
        'plant = { fmu = "plant.fmu" }\ninputs = { u_z = "u_z" }\noutputs.z.sigma = 1e-4\n'
        f'log.a.file = "{path.name}"\n'
    )
    (folder / "plant.toml").write_text(text, encoding="utf-8")
    link = folder / "plant.fmu"
    if not link.exists():
        link.symlink_to(build_fmu().path)
    return lambda: described(folder / "plant.toml", cache_folder() / "parts")


LOGS: Kinds = {
    "CSV bytes": _csv_bytes,
    "CSV cells": _csv(_cell),
    "CSV columns": _csv(_column),
    "CSV rows": _csv(_row),
    "Parquet bytes": _parquet_bytes,
    "Parquet types": _parquet_types,
    "Parquet columns": _parquet_columns,
    "edge": _edge,
    "own log": _own_log,
}
