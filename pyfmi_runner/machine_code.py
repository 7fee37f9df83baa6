"""Numba's machine code on disk, valid until any source changes that it may have been made of.

Numba's own cache looks at the file of the compiled function alone. What is compiled into it here
lies in other files: kernels of controllers, the sensors, calls by address.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
from numba.core import config
from numba.core.caching import UserProvidedCacheLocator

from pyfmi_runner.cache import cache_folder

__all__ = ["BySources", "kept"]

HERE = Path(__file__).resolve().parents[1]
PACKAGES = ("pyfmi_runner", "controllers")
SETTINGS: Any = config  # of numba, for all of a process
_ONE_AT_A_TIME = threading.Lock()


class BySources(UserProvidedCacheLocator):  # type: ignore[misc]
    """Where numba keeps a function's machine code, and what it is valid for."""

    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        super().__init__(py_func, py_file)
        self._cache_path = str(
            cache_folder() / "machine_code" / self.get_suitable_cache_subpath(py_file)
        )

    def get_source_stamp(self) -> str:
        return source_stamp()

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> BySources | None:
        """None where the folder cannot be written to."""
        found = cls(py_func, py_file)
        try:
            found.ensure_cache_path()
        except OSError:
            return None
        return found


@lru_cache(maxsize=1)
def source_stamp() -> str:
    """Hash of every source file of `PACKAGES`, names included."""
    stamp = hashlib.sha256()
    for path in sorted(p for name in PACKAGES for p in (HERE / name).rglob("*.py")):
        stamp.update(str(path.relative_to(HERE)).encode())
        stamp.update(path.read_bytes())
    return stamp.hexdigest()


def kept(function: Callable[..., Any], *parts: Callable[..., Any]) -> Callable[..., Any]:
    """`function` compiled without the interpreter's lock, its machine code kept on disk.

    parts: what is compiled into it from elsewhere. Nothing is kept with a part of another package
    (a user's controller): its file, or one that it imports, may change. The parts are in the name
    that it is kept by: numba numbers what it keeps under one name, and two processes that do so at
    once may give one number to two kernels.
    """
    function.__qualname__ = "-".join([function.__qualname__, *(p.__qualname__ for p in parts)])
    own = all(part.__module__.split(".")[0] in PACKAGES for part in parts)
    with _ONE_AT_A_TIME:
        before = SETTINGS.CACHE_LOCATOR_CLASSES
        SETTINGS.CACHE_LOCATOR_CLASSES = f"{__name__}.{BySources.__name__}"
        try:
            return numba.njit(nogil=True, cache=own)(function)  # type: ignore[no-any-return]
        except RuntimeError:  # no folder for it
            return numba.njit(nogil=True)(function)  # type: ignore[no-any-return]
        finally:
            SETTINGS.CACHE_LOCATOR_CLASSES = before
