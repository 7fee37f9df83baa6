"""`pneugantry list`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

HELP = """Names that the other commands take, with what they mean.

  pneugantry list controllers            whether each can be exported as an FMU
  pneugantry list parameters axis_z
      of the plant, those whose names hold a text: value, unit, meaning
  pneugantry list effects                what a diagnosis can find
  pneugantry list gains                  gain tables of the thesis
  pneugantry list workpieces, presets, sets, columns"""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("what", choices=tuple(LISTS))
    command.add_argument("part", nargs="?", default="", help="only names that hold this text")
    command.add_argument(
        "--fmu", metavar="FILE.fmu", type=Path, help="parameters: of another FMU than the gantry's"
    )
    command.add_argument(
        "--catalogue", metavar="FILE.toml", type=Path, help="effects: of another catalogue"
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    rows = [row for row in LISTS[options.what](options) if options.part in str(row["name"])]
    for row in rows:
        print("  ".join(_cells(row)).rstrip())
    if not rows:
        print(f"no {options.what} hold {options.part!r}")
    return {"schema": "list/1", "what": options.what, "entries": rows}, 0


def _cells(row: dict[str, Any]) -> list[str]:
    name, *others = row.values()
    cells = [f"{value:g}" if isinstance(value, float) else str(value) for value in others]
    return [f"{name:<32}", *(f"{cell:<12}" for cell in cells[:-1]), *cells[-1:]]


def _controllers(_: argparse.Namespace) -> list[dict[str, Any]]:
    from controllers.catalogue import controller_names, make_controller

    rows = []
    for name in controller_names():
        controller = make_controller(name)
        exported = "FMU" if _is_plain([controller.params, controller.initial_state()]) else "-"
        about = (type(controller).__doc__ or "").strip().splitlines()[0]
        rows.append({"name": name, "export": exported, "about": about})
    return rows


def _is_plain(value: Any) -> bool:
    """Whether a controller's values are numbers in nested tuples, as an FMU can hold them."""
    if isinstance(value, tuple | list):
        return all(_is_plain(part) for part in value)
    return isinstance(value, int | float)


def _parameters(options: argparse.Namespace) -> list[dict[str, Any]]:
    from pneugantry.api.inputs import fmu_from

    return [
        {"name": name, "value": v.start, "unit": v.unit or "1", "about": v.description or ""}
        for name, v in sorted(fmu_from(options.fmu).variables.items())
        if v.causality == "parameter"
    ]


def _effects(options: argparse.Namespace) -> list[dict[str, Any]]:
    from pneugantry.plants.gantry.catalogue import QUANTISATION, catalogue_of

    seen = {} if options.catalogue is not None else {QUANTISATION.key: QUANTISATION}
    return [
        {"name": key, "block": effect.block, "about": effect.summary}
        for key, effect in sorted((catalogue_of(options.catalogue) | seen).items())
    ]


def _gains(_: argparse.Namespace) -> list[dict[str, Any]]:
    from controllers.gains import TABLES, named_gains

    return [
        {"name": name, "about": ", ".join(f"{k}={v:g}" for k, v in named_gains(name).items())}
        for name in TABLES
    ]


def _workpieces(_: argparse.Namespace) -> list[dict[str, Any]]:
    from pyfmi_runner.workpiece import WORKPIECES, default_standoff

    return [
        {"name": name, "about": f"stand-off {1e3 * default_standoff(name):g} mm"}
        for name in WORKPIECES
    ]


def _presets(_: argparse.Namespace) -> list[dict[str, Any]]:
    from pneugantry.api.preset_names import PRESETS

    return [{"name": name, "about": about} for name, about in PRESETS.items()]


def _sets(_: argparse.Namespace) -> list[dict[str, Any]]:
    from pneugantry.blind.set_names import SETS

    return [{"name": name, "about": about} for name, about in SETS.items()]


def _columns(_: argparse.Namespace) -> list[dict[str, Any]]:
    from pyfmi_runner.log import COLUMNS, REQUIRED

    return [
        {
            "name": name,
            "unit": column.unit,
            "required": "required" if name in REQUIRED else "optional",
            "about": column.sign,
        }
        for name, column in COLUMNS.items()
    ]


LISTS: dict[str, Callable[[argparse.Namespace], list[dict[str, Any]]]] = {
    "parameters": _parameters,
    "effects": _effects,
    "controllers": _controllers,
    "gains": _gains,
    "workpieces": _workpieces,
    "presets": _presets,
    "sets": _sets,
    "columns": _columns,
}
