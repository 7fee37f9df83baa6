"""Threads for what holds no lock meanwhile: native simulations, compilers at work."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from threadpoolctl import threadpool_limits

__all__ = ["THREADS", "Pooled", "on_threads", "one_blas_thread"]

THREADS = 2
MOST = 16  # calls that are side by side, at most
OVER = "closed: nothing more is simulated"
T = TypeVar("T")
Found = TypeVar("Found")
Kind = TypeVar("Kind")
Job = TypeVar("Job")
Made = TypeVar("Made")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Linear algebra stays on the thread that asks for it: matrices are small here, and threads of
    a BLAS that wait for their share of one take the processor from simulations.
    """
    with threadpool_limits(1, "blas"):
        yield


def on_threads(call: Callable[[T], Found], values: Iterable[T]) -> list[Found]:
    """What a call makes of each value, in their order."""
    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(call, values))


@dataclass(eq=False)
class _Order(Generic[Found]):
    """Jobs that one caller waits for."""

    made: list[Found | None]
    left: int
    done: threading.Event = field(default_factory=threading.Event)
    error: BaseException | None = None


class Pooled(Generic[Kind, Job, Found]):
    """Jobs that callers ask for at the same time, done in shares of one kind each.

    A thread that is free takes what has been asked for by then; so shares are small where threads
    wait for work, and large where work waits for threads.
    """

    def __init__(
        self, do: Callable[[Kind, Sequence[Job]], Sequence[Found]], least: int, most: int
    ) -> None:
        """do: what makes something of each job of a kind. least, most: jobs of a share, where there
        are as many.
        """
        self._do, self._least, self._most = do, least, most
        self._threads = ThreadPoolExecutor(THREADS)
        self._lock = threading.Lock()
        self._asked: dict[Kind, deque[tuple[Job, _Order[Found], int]]] = {}
        self._busy = 0
        self._over = False
        # As many callers as threads go on at a time: else those that wait for the interpreter would
        # keep a thread from its next share.
        self._turns = threading.Semaphore(THREADS)
        self._own = threading.local()

    def close(self) -> None:
        self._stop()
        self._threads.shutdown()

    def _stop(self) -> None:
        """Nothing more is done: who waits for jobs is told, and who asks for any."""
        with self._lock:
            self._over = True
            for order in {o for asked in self._asked.values() for _, o, _ in asked}:
                order.error = order.error or RuntimeError(OVER)
                order.done.set()
            self._asked.clear()

    def run(self, jobs: Sequence[tuple[Kind, Job]]) -> list[Found]:
        """What is made of each job, in their order. Raises what any of them raises, RuntimeError
        where it is closed.
        """
        order: _Order[Found] = _Order([None] * len(jobs), len(jobs))
        if not jobs:
            return []
        with self._lock:
            if self._over:
                raise RuntimeError(OVER)
            for i, (kind, job) in enumerate(jobs):
                self._asked.setdefault(kind, deque()).append((job, order, i))
            idle = THREADS - self._busy
            self._busy = THREADS
        for _ in range(idle):
            self._threads.submit(self._work)
        with self._turn_given_up():
            order.done.wait()
        if order.error is not None:
            raise order.error
        return [m for m in order.made if m is not None]

    def side_by_side(self, call: Callable[[T], Made], values: Sequence[T]) -> list[Made]:
        """What a call makes of each value, in their order. Calls may ask for jobs, and for calls
        side by side; what they make must not hang on each other. Where the user cancels, those that
        are at work end with the jobs that they have asked for.
        """
        if len(values) < 2:
            return [call(v) for v in values]

        def one(value: T) -> Made:
            self._turns.acquire()
            self._own.holds = True
            try:
                return call(value)
            finally:
                self._own.holds = False
                self._turns.release()

        with self._turn_given_up(), ThreadPoolExecutor(min(len(values), MOST)) as pool:
            try:
                return list(pool.map(one, values))
            except KeyboardInterrupt:
                self._stop()
                raise

    @contextmanager
    def _turn_given_up(self) -> Iterator[None]:
        """While a caller waits."""
        holds = getattr(self._own, "holds", False)
        if holds:
            self._turns.release()
        try:
            yield
        finally:
            if holds:
                self._turns.acquire()

    def _work(self) -> None:
        """Share after share, until nothing is asked for."""
        while True:
            with self._lock:
                taken = self._share()
                if taken is None:
                    self._busy -= 1
                    return
            kind, share = taken
            try:
                made: Sequence[Found] | None = self._do(kind, [job for job, _, _ in share])
                error = None
            except BaseException as raised:  # its callers raise it
                made, error = None, raised
            self._deliver(share, made, error)

    def _share(self) -> tuple[Kind, list[tuple[Job, _Order[Found], int]]] | None:
        """Of the kind that most is asked for of, so much that the other threads have work, too."""
        kind = max(self._asked, key=lambda k: len(self._asked[k]), default=None)
        if kind is None:
            return None
        asked = self._asked[kind]
        size = self._least * -(-len(asked) // (THREADS * self._least))
        share = [asked.popleft() for _ in range(min(size, self._most, len(asked)))]
        if not asked:
            del self._asked[kind]
        return kind, share

    def _deliver(
        self,
        share: Sequence[tuple[Job, _Order[Found], int]],
        made: Sequence[Found] | None,
        error: BaseException | None,
    ) -> None:
        with self._lock:
            for k, (_, order, i) in enumerate(share):
                if made is not None:
                    order.made[i] = made[k]
                order.error = order.error or error
                order.left -= 1
                if order.left == 0:
                    order.done.set()
