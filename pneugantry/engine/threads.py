"""Two threads for what holds no lock meanwhile: native simulations, compilers at work."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

__all__ = ["THREADS", "on_threads"]

THREADS = 2
T = TypeVar("T")
Found = TypeVar("Found")


def on_threads(call: Callable[[T], Found], values: Iterable[T]) -> list[Found]:
    """What a call makes of each value, in their order."""
    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(call, values))
