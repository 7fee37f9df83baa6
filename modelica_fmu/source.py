"""Refusals that name file and line of what is at fault in a model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca

from modelica_fmu.errors import InputError, Undecided
from modelica_fmu.ir import Place

__all__ = ["Source", "place_of", "undecided"]


class Source:
    """Refusals with file and line of the node at fault."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def line(self, node: Any) -> int | None:
        """Line of a node of the flat model, 1-based."""
        place = place_of(node)
        return None if place is None else place.line

    def refuse(
        self, message: str, node: Any = None, hint: str = "rewrite it with supported Modelica"
    ) -> InputError:
        place = place_of(node)
        where = f"{place.file}:{place.line}" if place else str(self.path)
        return InputError(message, file=where, hint=hint)


def undecided(told: InputError, *values: ca.SX) -> InputError:
    """A refusal for what values depend on, where fixing these would help."""
    return Undecided(told, frozenset(v.name() for value in values for v in ca.symvar(value)))


def place_of(node: Any) -> Place | None:
    if isinstance(node, Place):
        return node
    place = getattr(node, "place", None)
    return place if isinstance(place, Place) else None
