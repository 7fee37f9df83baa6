"""The user's cache: FMUs, compiled parts and machine code that nobody asked for by name."""

from __future__ import annotations

import os
from pathlib import Path

from platformdirs import user_cache_path

__all__ = ["CACHE_VARIABLE", "cache_folder"]

CACHE_VARIABLE = "PNEUGANTRY_CACHE"


def cache_folder() -> Path:
    """$PNEUGANTRY_CACHE, or the user's cache."""
    named = os.environ.get(CACHE_VARIABLE)
    return Path(named) if named else user_cache_path("pneugantry")
