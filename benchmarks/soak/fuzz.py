"""Inputs of many kinds, drawn and tried: each is taken or refused in one line that names the file
and the hint; counts of what happened.
"""

from __future__ import annotations

import random
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError

__all__ = ["Kinds", "Read", "crashes", "fuzz", "outcome", "with_bytes_changed"]

Read = Callable[[], object]
Kinds = Mapping[
    str, Callable[[random.Random, Path], Read]
]  # draws an input into a folder; what it returns reads it


def fuzz(kinds: Kinds, count: int, seed: int = 1) -> dict[str, Any]:
    """Counts by kind: "read", "refused", and whatever else happened as "crash: ..." (none is
    expected).
    """
    rng, found = random.Random(seed), {kind: Counter[str]() for kind in kinds}
    for k in range(count):
        kind = list(kinds)[k % len(kinds)]
        with tempfile.TemporaryDirectory(prefix="soak-fuzz-") as folder:
            found[kind][outcome(kinds[kind](rng, Path(folder)))] += 1
    return {"tried": count, "kinds": {kind: dict(counts) for kind, counts in found.items()}}


def crashes(found: Mapping[str, Any]) -> int:
    return sum(
        n
        for counts in found["kinds"].values()
        for what, n in counts.items()
        if what.startswith("crash")
    )


def outcome(read: Read) -> str:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # it would be a second line
            warnings.simplefilter("ignore", DeprecationWarning)
            read()
    except InputError as error:
        whole = error.file is not None and error.hint is not None and "\n" not in str(error)
        return "refused" if whole else f"crash: says too little: {error}"
    except Exception as error:
        return f"crash: {type(error).__name__}: {error}"
    return "read"


def with_bytes_changed(rng: random.Random, data: bytes) -> bytes:
    """Some bytes changed, put in or left out; the end cut off, or a piece of it doubled."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(changed) + 1)
        piece = bytes(rng.randrange(256) for _ in range(rng.randint(0, 3)))
        changed[at : at + rng.randint(0, 3)] = piece
    if changed and rng.random() < 0.3:
        a, b = sorted(rng.randrange(len(changed) + 1) for _ in range(2))
        changed = rng.choice([changed[:a], changed[:a] + changed[b:], changed[:b] + changed[a:]])
    return bytes(changed)
