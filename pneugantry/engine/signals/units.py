"""Units as they are read."""

from __future__ import annotations

__all__ = ["with_unit"]


def with_unit(value: str, unit: str) -> str:
    """A value and its unit, which is left out where it is 1 or not known."""
    return value if unit in ("", "1") else f"{value} {unit}"
