"""A plant description that is written elsewhere still finds its model and its catalogue."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["relocated"]


def relocated(description: Path, out: Path, data: str = "data/") -> str:
    """Text of a plant.toml for the folder `out`: model and catalogue by their path from there, logs
    in `out` itself instead of in `data`.
    """
    example = os.path.relpath(description.parent, out.resolve())
    text = description.read_text(encoding="utf-8")
    for old, new in (
        ('model = "', f'model = "{example}/'),
        ('catalogue = "', f'catalogue = "{example}/'),
        (f'file = "{data}', 'file = "'),
    ):
        text = text.replace(old, new)
    return text
