"""Jobs in worker processes of this machine.

Not `concurrent.futures`: there one dead process ends all the others and every case that waits, and
nobody knows which case it was. Here each worker has a pipe of its own, so its death is the end of
one pipe and the blame falls on one case.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait

from modelica_fmu.errors import RunError
from pneugantry.jobs.job import ATTEMPTS, Ended, Factory, Job, answer, end_of, reason_of

__all__ = ["run_local"]

START_ATTEMPTS = 3  # workers in a row that die before they are ready
ONES = (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "MALLOC_ARENA_MAX",  # what a thread frees serves the others
)  # one a worker: the cores are taken by the workers


class Worker:
    """A process that serves one job at a time over its pipe."""

    def __init__(self, factory: Factory) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(factory, theirs), daemon=True)
        with _single_threaded():
            self.process.start()
        theirs.close()  # only the worker holds it now: its death ends the pipe
        self.ready = False
        self.job: Job | None = None

    def give(self, job: Job) -> bool:
        """Hands a job over; False where the worker is gone."""
        try:
            self.pipe.send(job)
        except OSError:
            return False
        self.job = job
        return True

    def end(self) -> None:
        self.pipe.close()
        self.process.kill()
        self.process.join()


def run_local(factory: Factory, jobs: Sequence[Job], workers: int) -> Iterator[Ended]:
    """The jobs' ends as they come, each job once. Raises RunError where workers cannot be made
    ready.
    """
    waiting, deaths, stillborn = deque(jobs), Counter[int | str](), 0
    crew = [Worker(factory) for _ in range(min(workers, len(waiting)))]
    try:
        while waiting or any(worker.job for worker in crew):
            ended = []
            pipes = {worker.pipe: worker for worker in crew}
            for pipe in wait(list(pipes)):
                worker = pipes[pipe]  # type: ignore[index]
                try:
                    message = worker.pipe.recv()
                except (EOFError, OSError):
                    stillborn = stillborn if worker.ready else stillborn + 1
                    ended += _mourn(worker, waiting, deaths)
                    crew.remove(worker)
                    worker.end()
                    if stillborn == START_ATTEMPTS:
                        raise RunError(
                            f"worker processes end before they are ready (exit code "
                            f"{worker.process.exitcode})"
                        ) from None
                    crew.append(Worker(factory))
                    continue
                if isinstance(message, Ended):
                    worker.job = None
                    ended.append(message)
                elif message:
                    raise RunError(f"a worker cannot be made ready: {message}")
                else:
                    worker.ready, stillborn = True, 0
            for worker in crew:
                if worker.ready and worker.job is None and waiting and worker.give(waiting[0]):
                    waiting.popleft()
            yield from ended  # the workers are at it again while the caller writes
    finally:
        for worker in crew:
            worker.end()


def _mourn(worker: Worker, waiting: deque[Job], deaths: Counter[int | str]) -> list[Ended]:
    """The lost job goes back to the front, or ends if it took too many workers with it."""
    job = worker.job
    if job is None:
        return []
    deaths[job.key] += 1
    if deaths[job.key] >= ATTEMPTS:
        return [end_of(job)]
    waiting.appendleft(job)
    return []


def _serve(factory: Factory, pipe: Connection) -> None:
    """The worker's life: get ready, then answer until the pipe ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):
        try:
            function = factory()
        except Exception as error:
            pipe.send(reason_of(error))
            return
        pipe.send("")
        while True:
            job = pipe.recv()
            ended = answer(function, job)
            try:
                pipe.send(ended)
            except (EOFError, OSError):
                return
            except Exception as error:  # a value that does not pickle
                pipe.send(Ended(job.key, failure=reason_of(error)))


def _end_with_parent() -> None:
    """A parent that is killed leaves no worker behind, not even one in the middle of a
    long case.
    """
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@contextmanager
def _single_threaded() -> Iterator[None]:
    """The environment in which workers start."""
    before = {name: os.environ.get(name) for name in ONES}
    os.environ.update({name: value or "1" for name, value in before.items()})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
