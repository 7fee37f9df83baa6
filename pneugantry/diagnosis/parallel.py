"""Independent pieces of a search on several cores: in copies of this process, which have all of its
FMU instances and data.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

__all__ = ["each"]

T = TypeVar("T")
R = TypeVar("R")
_work: Callable[[Any], Any] | None = None


def each(work: Callable[[T], R], items: Sequence[T], workers: int) -> list[R]:
    """[work(item) for item in items], by up to `workers` forked copies of this process; here, where
    a system cannot fork.

    `work` sees everything as it is now; what it changes besides its result is lost.
    """
    global _work
    if workers < 2 or len(items) < 2 or not sys.platform.startswith("linux"):
        return [work(item) for item in items]
    _work = lambda i: work(items[i])  # noqa: E731
    try:
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", DeprecationWarning
            )  # a process with threads forks: the copies use none of them
            context = multiprocessing.get_context("fork")
            with ProcessPoolExecutor(
                min(workers, len(items)), context, _watch, (os.getpid(),)
            ) as pool:
                return list(pool.map(_call, range(len(items))))
    except BrokenProcessPool:
        return [work(item) for item in items]
    finally:
        _work = None


def _watch(parent: int) -> None:
    """A process that is killed leaves no copy behind."""
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def _call(i: int) -> Any:
    assert _work is not None
    return _work(i)
