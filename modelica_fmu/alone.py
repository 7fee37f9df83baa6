"""One compilation at a time.

CasADi lets go of the interpreter's lock while it works, and counts who refers to an expression
without a lock of its own: two threads that compile crash now and then. So does one, if another
thread collects garbage meanwhile, for that takes expressions apart.
"""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

__all__ = ["alone"]

P = ParamSpec("P")
T = TypeVar("T")
_LOCK = threading.RLock()


def alone(call: Callable[P, T]) -> Callable[P, T]:
    """A function of which no two run at once, nor one beside a collection of garbage. It must
    return no expression.
    """

    @wraps(call)
    def made(*arguments: P.args, **named: P.kwargs) -> T:
        with _LOCK:
            collecting = gc.isenabled()
            gc.disable()
            try:
                return call(*arguments, **named)
            finally:
                if collecting:
                    gc.enable()

    return made
