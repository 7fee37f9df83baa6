"""A study, run: what is on disk is taken from there, the rest goes to the workers, each result to
disk as it comes.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from pneugantry.jobs.job import Ended, Job
from pneugantry.jobs.run import run_jobs
from pneugantry.sweep.check import check_spec
from pneugantry.sweep.spec import OWN_FILES, Spec
from pneugantry.sweep.store import Store, column_types
from pneugantry.sweep.vary import changed
from pneugantry.sweep.work import UNITS, Simulation
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.scenario import scenario_from, scenario_text

__all__ = ["Swept", "run_sweep"]

Watch = Callable[
    [Iterable[Ended], int], Iterator[Ended]
]  # shows progress while it hands the ends on; the number to come


@dataclass(frozen=True)
class Swept:
    """A finished study."""

    results: Path
    cases: int
    resumed: int  # were on disk already
    failures: dict[int, str]  # case -> reason
    seconds: float  # wall time of this call

    @property
    def sha256(self) -> str:
        """Of results.parquet: the same however the work was split."""
        return hashlib.sha256(self.results.read_bytes()).hexdigest()


def run_sweep(
    spec: Spec,
    fmu: FmuFile,
    out: Path,
    *,
    workers: int = 2,
    scheduler: str | None = None,
    watch: Watch | None = None,
) -> Swept:
    """Runs the cases that `out` does not hold yet; workers, scheduler: as in `run_jobs`.

    Raises InputError for a spec that scenario, controller or FMU do not take and for a folder that
    holds another study. A case that fails is a row with its reason.
    """
    started = time.perf_counter()
    check_spec(spec, fmu)
    files = _own_files(spec)
    with Store(out, _identity(spec, fmu, files), _columns(spec), _about(spec, fmu)) as store:
        resumed = len(store.rows)
        jobs = [
            Job(index, (index, case))
            for index, case in enumerate(spec.cases)
            if index not in store.rows
        ]
        if jobs:
            simulation = Simulation(
                spec.name, spec.base, fmu.path.name, fmu.path.read_bytes(), files, spec.keep_logs
            )
            ends = run_jobs(simulation, jobs, workers=workers, scheduler=scheduler)
            for ended in watch(ends, len(jobs)) if watch else ends:
                _keep(store, spec, ended)
            store.finish()
        elif not store.results.is_file():  # killed between the last case and the table
            store.finish()
        failures = {
            case: row["reason"]
            for case, row in sorted(store.rows.items())
            if row["status"] != "done"
        }
    return Swept(store.results, len(spec.cases), resumed, failures, time.perf_counter() - started)


def _keep(store: Store, spec: Spec, ended: Ended) -> None:
    case = int(ended.key)
    value: dict[str, Any] = (
        {"status": "failed", "reason": ended.failure} if ended.failure else dict(ended.value)
    )
    log = value.pop("log", None)
    store.add(
        {
            "case": case,
            **spec.cases[case],
            **value,
            "seconds": ended.seconds,
            "worker": ended.worker,
        },
        log,
    )


def _columns(spec: Spec) -> dict[str, pa.DataType]:
    metrics = dict.fromkeys(UNITS, pa.float64())
    return {**column_types(spec.cases), **metrics, "status": pa.string(), "reason": pa.string()}


def _own_files(spec: Spec) -> dict[str, bytes]:
    """The user's own edges and controllers that occur: path -> content."""
    tables = (spec.base, *spec.cases)
    return {
        name: Path(name).read_bytes()
        for field, suffix in OWN_FILES.items()
        for name in sorted({str(table.get(field, "")) for table in tables})
        if name.lower().endswith(suffix)
    }


def _identity(spec: Spec, fmu: FmuFile, files: dict[str, bytes]) -> dict[str, Any]:
    """What results that stand in one table have in common."""
    hashes = {hashlib.sha256(content).hexdigest() for content in files.values()}
    study = {
        "base": spec.base,
        "cases": spec.cases,
        "keep_logs": spec.keep_logs,
        "edges": sorted(hashes),
    }
    text = json.dumps(study, sort_keys=True, default=str)
    return {
        "schema": "sweep/1",
        "name": spec.name,
        "spec": hashlib.sha256(text.encode()).hexdigest(),
        "fmu": fmu.sha256,
    }


def _about(spec: Spec, fmu: FmuFile) -> dict[str, Any]:
    first = scenario_from(changed(spec.base, spec.cases[0]))
    return {
        "schema": "sweep/1",
        "name": spec.name,
        "fmu": fmu.sha256,
        "units": UNITS,
        "scenario_of_case_0": scenario_text(first),
    }
