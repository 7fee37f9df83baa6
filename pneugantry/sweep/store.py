"""A study's results on disk: each as soon as it exists, in a part file written whole or not at all;
one table at the end.

study.json          which study this is: hash of its cases and base scenario, hash of the FMU
parts/*.parquet     results so far, one case each, gathered into blocks of a thousand logs/*.parquet
the cases' logs where they are kept results.parquet     at the end: a row per case in the order of
the cases; nothing in it tells who ran them, or when timings.parquet     at the end: seconds and
worker of each case
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import pyarrow as pa
import pyarrow.parquet as pq

from modelica_fmu.errors import InputError
from pyfmi_runner.log import write_atomically

__all__ = ["TIMINGS", "Store", "column_types"]

BLOCK = 1000  # single parts that are gathered into one
TIMINGS = {"seconds": pa.float64(), "worker": pa.string()}
Row = dict[str, Any]


def column_types(rows: list[Row]) -> dict[str, pa.DataType]:
    """The Parquet type of each varied parameter; what is neither number, truth value nor text is
    kept as JSON text.
    """
    return {name: _type([row[name] for row in rows]) for name in rows[0]}


def _type(values: list[Any]) -> pa.DataType:
    kinds = {type(value) for value in values}
    single = {bool: pa.bool_(), int: pa.int64(), float: pa.float64()}
    if int in kinds and max(abs(value) for value in values if type(value) is int) >= 2**63:
        return pa.string()
    if len(kinds) == 1 and (kind := next(iter(kinds))) in single:
        return single[kind]
    return pa.float64() if kinds == {int, float} else pa.string()


class Store:
    """The folder of one study, for one process at a time.

    identity: what must be the same for results to belong together; columns: of results.parquet,
    after `case`; metadata: goes into it.
    """

    def __init__(
        self,
        folder: Path,
        identity: Mapping[str, Any],
        columns: Mapping[str, pa.DataType],
        metadata: Mapping[str, Any],
    ) -> None:
        self.folder, self.identity = folder, json.loads(json.dumps(identity))
        about = {b"pneugantry": json.dumps(metadata, sort_keys=True).encode()}
        self.schema = pa.schema({"case": pa.int64(), **columns}, metadata=about)
        self.timings = pa.schema({"case": pa.int64(), **TIMINGS})
        self.part_schema = pa.schema({"case": pa.int64(), **columns, **TIMINGS})
        self.rows: dict[int, Row] = {}
        self._single: list[int] = []  # cases in part files of their own
        self._lock: IO[str] | None = None

    @property
    def results(self) -> Path:
        return self.folder / "results.parquet"

    @property
    def parts(self) -> Path:
        return self.folder / "parts"

    def log_path(self, case: int) -> Path:
        return self.folder / "logs" / f"{case:06d}.parquet"

    def __enter__(self) -> Store:
        """Takes the folder and reads what is there. Raises InputError where it is in use or holds
        another study.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"cannot be made ({error.strerror})",
                file=self.folder,
                field="--out",
                hint="choose another folder",
            ) from None
        self._lock = _locked(self.folder)
        try:
            self._identify()
            self._clear_torn()
            self._read()
        except BaseException:
            self._lock.close()
            raise
        return self

    def __exit__(
        self,
        _: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._lock is not None:
            self._lock.close()

    def add(self, row: Row, log: bytes | None = None) -> None:
        """One result, on disk when this returns; its log comes first, so that a result never lacks
        it.
        """
        case = row["case"]
        if log is not None:
            write_atomically(self.log_path(case), lambda temporary: temporary.write_bytes(log))
        self.rows[case] = {
            name: _plain(row.get(name), kind)
            for name, kind in zip(self.part_schema.names, self.part_schema.types, strict=True)
        }
        path = self.parts / f"{case:07d}.parquet"
        temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        self.parts.mkdir(exist_ok=True)
        pq.write_table(self._table(self.part_schema, [case]), temporary)
        os.replace(
            temporary,
            path,
            # not synchronised with the disk, 2 ms a case: a power cut costs the last cases, a kill
            # none
        )
        self._single.append(case)
        if len(self._single) >= BLOCK:
            self._gather()

    def finish(self) -> Path:
        """The two tables from all parts, which are no longer needed then."""
        cases = sorted(self.rows)
        self._write(self.timings, cases, self.folder / "timings.parquet")
        self._write(self.schema, cases, self.results)
        shutil.rmtree(self.parts, ignore_errors=True)
        return self.results

    def _gather(self) -> None:
        cases = sorted(self._single)
        self._write(self.part_schema, cases, self.parts / f"block_{cases[0]:07d}.parquet")
        for case in cases:
            (self.parts / f"{case:07d}.parquet").unlink(missing_ok=True)
        self._single = []

    def _write(self, schema: pa.Schema, cases: list[int], path: Path) -> None:
        table = self._table(schema, cases)
        write_atomically(
            path, lambda temporary: pq.write_table(table, temporary, compression="zstd")
        )

    def _table(self, schema: pa.Schema, cases: list[int]) -> pa.Table:
        rows = [self.rows[case] for case in cases]
        columns = [
            pa.array([row[name] for row in rows], kind)
            for name, kind in zip(schema.names, schema.types, strict=True)
        ]
        return pa.table(columns, schema=schema)

    def _identify(self) -> None:
        path = self.folder / "study.json"
        if not path.is_file():
            if self.results.exists():
                raise InputError(
                    "holds results of something else",
                    file=self.folder,
                    field="--out",
                    hint="choose another folder",
                )
            text = json.dumps(self.identity, indent=2) + "\n"
            write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
            return
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            raise InputError(
                "is damaged", file=path, hint="delete the folder, or choose another --out"
            ) from None
        changed = [
            key
            for key in self.identity
            if not isinstance(found, dict) or found.get(key) != self.identity[key]
        ]
        if changed:
            raise InputError(
                "the results there are of another one",
                file=path,
                field=" and ".join(changed),
                hint="choose another --out, bring back what it was run with, or delete the folder",
            )

    def _clear_torn(self) -> None:
        """What a killed process left half written."""
        for folder in (self.folder, self.parts, self.folder / "logs"):
            for path in folder.glob(".*.tmp"):
                path.unlink(missing_ok=True)

    def _read(self) -> None:
        if self.results.is_file():
            results, timings = (
                pq.ParquetFile(self.results).read(),
                pq.ParquetFile(self.folder / "timings.parquet").read(),
            )
            timed = {row["case"]: row for row in timings.to_pylist()}
            self.rows = {row["case"]: timed[row["case"]] | row for row in results.to_pylist()}
            shutil.rmtree(self.parts, ignore_errors=True)
            return
        for path in sorted(self.parts.glob("*.parquet")):
            with contextlib.suppress(
                pa.ArrowInvalid, OSError
            ):  # damaged by a power cut: its case runs again
                self.rows |= {row["case"]: row for row in pq.ParquetFile(path).read().to_pylist()}
                if path.stem.isdigit():
                    self._single.append(int(path.stem))


def _plain(value: Any, kind: pa.DataType) -> Any:
    """A value as its column takes it."""
    if value is None or isinstance(value, str) or kind != pa.string():
        return float(value) if kind == pa.float64() and value is not None else value
    return json.dumps(value, sort_keys=True)


def _locked(folder: Path) -> IO[str]:
    """A lock that ends with the process, however it ends. Where the system has no such locks, none
    is held.
    """
    stream = (folder / ".lock").open("w")
    try:
        import fcntl

        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except ImportError:
        pass
    except OSError:
        stream.close()
        raise InputError(
            "another sweep is at work there",
            file=folder,
            field="--out",
            hint="wait for it, or choose another folder",
        ) from None
    return stream
