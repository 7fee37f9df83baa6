"""The compiled loop on disk: found again by any later process, unless a file here has changed."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit

HERE = Path(__file__).parent


@cache
def stamp(folder: Path = HERE) -> str:
    """Digest of every file of the truth plant: what a loop takes in may stand in any of them."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def kept(function: Callable[..., Any]) -> Any:
    """`function` compiled and kept. numba by itself asks only whether the function's own file has
    changed: here its name on disk holds the stamp. For functions that are called with one set of
    types.
    """
    name = function.__name__
    function.__qualname__ = f"{name}-{stamp()}"
    compiled = njit(cache=True)(function)
    for path in Path(str(compiled.stats.cache_path)).glob(f"*.{name}-*"):
        if stamp() not in path.name:
            with contextlib.suppress(OSError):  # another process may be at it
                path.unlink()
    return compiled
