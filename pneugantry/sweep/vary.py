"""Dotted names of what a study varies: fields of a scenario and, after `plant.`, parameters of the
model.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

from controllers.gains import TABLES, FvGains, PidGains

__all__ = ["changed", "flat"]


def flat(table: Mapping[str, Any], leaf: tuple[str, ...] = (), prefix: str = "") -> dict[str, Any]:
    """Nested tables as one with dotted names: TOML reads `plant.contact.K_c = ...` as tables in
    tables.

    A table with a key of `leaf` is a value itself.
    """
    found: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, Mapping) and not any(name in value for name in leaf):
            found |= flat(value, leaf, f"{prefix}{key}.")
        else:
            found[prefix + key] = value
    return found


def changed(table: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A scenario's table with the values of dotted names put in; a gain table's name gives way to
    its gains where one is varied.
    """
    result = copy.deepcopy(dict(table))
    for name, value in changes.items():
        head, _, rest = name.partition(".")
        path = [head, rest] if head == "plant" and rest else name.split(".")
        if head == "gains" and rest and isinstance(result.get("gains"), str):
            result["gains"] = _gains(result["gains"])
        place = result
        for key in path[:-1]:
            inner = place.setdefault(key, {})
            if not isinstance(inner, dict):
                inner = place[key] = {}
            place = inner
        place[path[-1]] = value
    return result


def _gains(name: str) -> dict[str, float]:
    """The gains of a table of the thesis by their names in a scenario; empty for an unknown one,
    which the controller will refuse.
    """
    table = TABLES.get(name)
    pairs = zip(FvGains._fields, table, strict=True) if table is not None else ()
    return {
        f"K{kind[-1]}_{loop.replace('_', '')}": value
        for loop, pid in pairs
        for kind, value in zip(PidGains._fields, pid, strict=True)
    }
