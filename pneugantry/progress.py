"""A progress bar on a terminal for whatever takes longer than a second."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from typing import TypeVar

from tqdm import tqdm

from pyfmi_runner.loop import Progress

T = TypeVar("T")


def bar(items: Iterable[T], total: int | None = None, what: str = "") -> Iterator[T]:
    """Iterates with a bar on standard error if that is a terminal."""
    return iter(
        tqdm(items, total=total, desc=what, delay=1.0, leave=False, disable=not sys.stderr.isatty())
    )


def loop_progress(what: str) -> Progress:
    """A callback for the sampled loops."""
    shown = tqdm(
        total=None, desc=what, delay=1.0, leave=False, disable=not sys.stderr.isatty(), unit="step"
    )

    def report(done: int, total: int) -> bool:
        shown.total = total
        shown.update(done - shown.n)
        if done >= total:
            shown.close()
        return True

    return report
