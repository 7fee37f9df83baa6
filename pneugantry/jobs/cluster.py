"""Jobs on an existing Dask cluster. The one file that imports distributed; it is loaded only where
a scheduler is given.
"""

from __future__ import annotations

import logging
import threading
import uuid
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from typing import Any

from distributed import Client, Future, KilledWorker, Worker, WorkerPlugin, as_completed, get_worker

from modelica_fmu.errors import InputError, RunError
from pneugantry.jobs.job import Ended, Factory, Function, Job, answer, end_of, reason_of

__all__ = ["run_cluster"]

AHEAD = 8  # jobs a thread of the cluster that the scheduler holds; more only fill its memory
CONNECT = 10.0  # s
GONE = "the scheduler went away; start it again and repeat the command, what is done stays done"


class Equipment(WorkerPlugin):  # type: ignore[misc]
    """The factory, shipped to every worker of the cluster, those that come later included; called
    at a worker's first job.
    """

    def __init__(self, name: str, factory: Factory) -> None:
        self.name, self.factory = name, factory

    def setup(self, worker: Worker) -> None:
        self.lock = threading.Lock()
        self.function: Function | None = None

    def ready(self) -> Function:
        with self.lock:
            if self.function is None:
                self.function = self.factory()
            return self.function


def run_cluster(factory: Factory, jobs: Sequence[Job], address: str) -> Iterator[Ended]:
    """The jobs' ends as they come, each job once.

    A worker that dies: the scheduler gives its jobs to others, as often as its `allowed-failures`
    says. What it then gives up is tried once more at the end, alone, since it also blames a job
    that only waited on a worker that died. Raises InputError for an address without a scheduler,
    RunError for workers that cannot be made ready and a lost scheduler.
    """
    for logger in (
        "distributed",
        "distributed.client",
    ):  # a lost worker or scheduler is told in our words
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    name = f"pneugantry-{uuid.uuid4().hex[:12]}"
    client = _connect(address)
    try:
        _equip(client, name, factory)
        suspects: list[Job] = []
        for job, ended in _finished(client, name, jobs, ahead=AHEAD):
            if ended is None:
                suspects.append(job)
            else:
                yield ended
        for suspect in suspects:
            for job, ended in _finished(client, f"{name}-again", [suspect], equipment=name):
                yield ended or end_of(job)
    finally:
        if client.status == "running":  # else the scheduler is gone, and asking it would wait
            with suppress(Exception):
                client.unregister_worker_plugin(name)
        client.close()  # its futures go with it: what still waits is dropped by the scheduler


def _connect(address: str) -> Client:
    try:
        return Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:  # TimeoutError is an OSError
        raise InputError(
            f"no scheduler answers at {address!r} ({reason_of(error)})",
            field="--scheduler",
            hint="start one with `dask scheduler` and `dask worker ADDRESS`, or leave "
            "--scheduler out",
        ) from None


def _equip(client: Client, name: str, factory: Factory) -> None:
    try:
        client.register_plugin(Equipment(name, factory), name=name)
    except Exception as error:  # whatever unpickling raises there
        raise RunError(
            f"the cluster's workers cannot be equipped ({reason_of(error)}); install the "
            f"same pneugantry on them"
        ) from None


def _finished(
    client: Client, name: str, jobs: Sequence[Job], ahead: int = 1, equipment: str = ""
) -> Iterator[tuple[Job, Ended | None]]:
    """Jobs with their ends; None where the scheduler gave a job up because its workers died."""
    coming, running, queue = iter(jobs), {}, as_completed(loop=client.loop)

    def submit() -> None:
        for job in coming:
            future = client.submit(
                _work, equipment or name, job, key=f"{name}-{job.key}", pure=False
            )
            running[future.key] = job
            queue.add(future)
            return

    for _ in range(ahead * max(sum(client.ncores().values()), 1)):
        submit()
    for future in queue:
        job = running.pop(future.key)
        submit()
        yield job, _end(future)


def _end(future: Future) -> Ended | None:
    if future.status == "finished":
        try:
            value = future.result()
        except (OSError, CancelledError):  # the connection, or the future with it
            raise RunError(GONE) from None
        if isinstance(value, str):
            raise RunError(f"a worker cannot be made ready: {value}")
        return value  # type: ignore[no-any-return]
    if future.status == "error":
        error = future.exception()
        if isinstance(error, KilledWorker):
            return None
        raise RunError(f"the cluster failed: {reason_of(error)}")
    raise RunError(GONE)


def _work(equipment: str, job: Job) -> Any:
    """Runs in the cluster's worker: the job's end, or in words why the worker is unfit."""
    try:
        plugin = get_worker().plugins[equipment]
        assert isinstance(plugin, Equipment)
        function = plugin.ready()
    except Exception as error:
        return reason_of(error)
    return answer(function, job)
