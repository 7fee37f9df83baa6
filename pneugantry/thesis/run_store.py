"""Finished runs on disk, so that a killed study goes on where it was and a longer one takes over
what a shorter one ran.

One SQLite file. A key is the hash of the FMU, of the sources that a run depends on, and of the run
itself: after any change of these a run is another one and is run again. Old rows stay, harmless;
delete the file to be rid of them.
"""

from __future__ import annotations

import hashlib
import io
import json
import sqlite3
import threading
from collections.abc import Iterable, Mapping
from dataclasses import astuple
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import controllers
import pyfmi_runner
from modelica_fmu.errors import InputError
from pneugantry.thesis.conditions import Run
from pneugantry.thesis.scores import Effort, Scores, Trace

__all__ = ["Done", "RunStore", "source_hash"]

# what decides how a run goes and is scored, besides the packages of controllers and of the runner
RUN_MODULES = (
    "thesis/conditions.py",
    "thesis/random_finish.py",
    "thesis/runner.py",
    "thesis/scores.py",
    "analysis/metrics.py",
)
VALUE_MODULES = (  # what other kept results are computed with
    "thesis/gap.py",
    "thesis/gap_tests.py",
    "thesis/judge.py",
    "thesis/loop_limits.py",
    "thesis/perfect.py",
    "thesis/plant_tests.py",
    "thesis/settings.py",
)
TABLE = "CREATE TABLE IF NOT EXISTS found (key TEXT PRIMARY KEY, value TEXT, trace BLOB)"


class Done(NamedTuple):
    """A run's scores, and its trace where asked for."""

    scores: Scores
    effort: Effort
    trace: Trace | None = None


@lru_cache(maxsize=2)
def source_hash(*, analysis: bool = False) -> str:
    """Of every source that a run depends on besides the FMU; analysis: of what margins and
    tests on the plant are computed with, too.
    """
    home = Path(__file__).parent.parent
    files = [home / name for name in RUN_MODULES]
    for package in (controllers, pyfmi_runner):
        files += sorted(Path(str(package.__file__)).parent.rglob("*.py"))
    if analysis:
        found = sorted((home / "analysis").rglob("*.py"))
        files += [path for path in found if not path.name.startswith("plots")]
        files += [home / name for name in VALUE_MODULES]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


class RunStore:
    """Runs and other results of one FMU. Opened by one process; its threads may share it."""

    def __init__(self, file: Path, fmu_hash: str) -> None:
        """Raises InputError where the file cannot be made or is no store."""
        self.file = file
        self.runs_of = fmu_hash + source_hash()
        self.values_of = fmu_hash + source_hash(analysis=True)
        self.taken = 0  # results that were there
        self._lock = threading.Lock()
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            self._base = sqlite3.connect(file, check_same_thread=False)
            with self._base:
                self._base.execute(TABLE)
        except (OSError, sqlite3.Error) as error:
            raise InputError(
                f"holds no finished runs ({error})",
                file=file,
                field="--runs",
                hint="choose another file, or delete this one",
            ) from None

    def close(self) -> None:
        self._base.close()

    def runs(self, wanted: Iterable[Run], traced: frozenset[Run]) -> dict[Run, Done | str]:
        """Those of the wanted runs that are there; text: why the run was lost. A run without the
        trace that is asked for is not there.
        """
        found: dict[Run, Done | str] = {}
        for run in wanted:
            row = self._row(self._run_key(run))
            if row is None:
                continue
            value, trace = json.loads(row[0]), row[1]
            if "lost" in value:
                found[run] = value["lost"]
            elif run not in traced or trace is not None:
                scores, effort = Scores(*value["scores"]), Effort(*value["effort"])
                found[run] = Done(scores, effort, _trace(trace) if run in traced else None)
        self.taken += len(found)
        return found

    def add_runs(self, runs: Mapping[Run, Done | str]) -> None:
        """On disk when this returns."""
        rows: list[tuple[str, Any, bytes | None]] = []
        for run, done in runs.items():
            if isinstance(done, str):
                rows.append((self._run_key(run), {"lost": done}, None))
                continue
            value = {"scores": done.scores, "effort": done.effort}
            rows.append(
                (self._run_key(run), value, None if done.trace is None else _blob(done.trace))
            )
        self._write(rows)

    def value(self, name: str) -> Any:
        """What was kept under a name; None where nothing was."""
        row = self._row(self._value_key(name))
        self.taken += row is not None
        return None if row is None else json.loads(row[0])

    def add_value(self, name: str, value: Any) -> None:
        """value: what JSON holds, infinities too."""
        self._write([(self._value_key(name), value, None)])

    def _row(self, key: str) -> tuple[str, bytes | None] | None:
        with self._lock:
            found = self._base.execute(
                "SELECT value, trace FROM found WHERE key = ?", (key,)
            ).fetchone()
        return None if found is None else (found[0], found[1])

    def _write(self, rows: Iterable[tuple[str, Any, bytes | None]]) -> None:
        texts = [(key, json.dumps(value), trace) for key, value, trace in rows]
        with self._lock, self._base:
            self._base.executemany("INSERT OR REPLACE INTO found VALUES (?, ?, ?)", texts)

    def _run_key(self, run: Run) -> str:
        return _hash(f"{self.runs_of}\n{_run_text(run)}")

    def _value_key(self, name: str) -> str:
        return _hash(f"{self.values_of}\n{name}")


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _run_text(run: Run) -> str:
    """A run in words; an edge that is a file counts by its content, wherever it lies."""
    path = Path(run.workpiece)
    if path.suffix == ".csv":
        run = run.changed(workpiece=hashlib.sha256(path.read_bytes()).hexdigest())
    return repr(astuple(run))


def _blob(trace: Trace) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **trace._asdict())
    return stream.getvalue()


def _trace(blob: bytes | None) -> Trace:
    assert blob is not None
    with np.load(io.BytesIO(blob)) as found:
        return Trace(*(found[name] for name in Trace._fields))
