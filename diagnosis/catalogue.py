"""The catalogue of effects: data, one small TOML file per effect. A user adds an effect by adding a file.

name = "valve_delay"; block = "valve"; axes = ["x", "z"]
[[form]]                                   one or several functional forms; the best one stands for the effect
[form.settings] "axis_{axis}.friction.law" = 3           switched on with the form
[form.parameters."valve_{axis}.delay_time"]              what is fitted: parameters of the FMU, or `sensors.*`, `timing.*`
neutral = 0.0 (value without the effect; relative = true: the nominal value), scale (a usual size), low, high, unit,
starts = [..] (further starting values), positive = true (fitted as its logarithm); "table[1:11]" stands for eleven parameters
outside = true                             optional: a rough form of what the catalogue lacks; where it leads the verdict is "unknown"
refines = ["viscous_friction"]             optional: effects that it shapes, and that a user's own plant is offered first
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pyfmi_runner.errors import InputError

__all__ = ["AXIS_BLOCKS", "Effect", "Form", "Parameter", "read_catalogue"]

FOLDER = Path(__file__).parent / "effects"
AXIS_BLOCKS = ("valve", "friction")  # blocks that each axis has of its own


@dataclass(frozen=True)
class Parameter:
    """One fitted quantity of an effect. A relative one has the nominal value as its neutral, its scale and bounds as shares of it."""

    name: str
    neutral: float
    scale: float
    low: float
    high: float
    unit: str = "1"
    relative: bool = False
    positive: bool = False  # fitted as its logarithm
    starts: tuple[float, ...] = ()


@dataclass(frozen=True)
class Form:
    """One functional form of an effect."""

    name: str
    parameters: tuple[Parameter, ...]
    settings: Mapping[str, float] = field(default_factory=dict)
    estimator: str = ""  # "waviness", "converter": parameters that the data themselves give (see `diagnosis.search`)


@dataclass(frozen=True)
class Effect:
    """An effect on one axis (or on none), with the forms that may serve it."""

    name: str
    axis: str  # "x", "z" or ""
    block: str  # where it sits: "valve_x", "contact", ...
    summary: str
    forms: tuple[Form, ...]
    refines: tuple[str, ...] = ()  # names of the effects without which it is nothing (`diagnosis.own_search`)
    outside: bool = False  # no cause of its own: a rough form of what the catalogue lacks

    @property
    def key(self) -> str:
        """ "presliding/z", or "loop_delay" where there is no axis."""
        return f"{self.name}/{self.axis}" if self.axis else self.name


def read_catalogue(source: Path | None = None) -> dict[str, Effect]:
    """Effects by key from a folder of TOML files, or from one file with [[effect]] tables added to the built-in ones.

    Raises InputError naming file, field and mend.
    """
    effects: dict[str, Effect] = {}
    folder = source if source is not None and source.is_dir() else FOLDER
    for path in sorted(folder.glob("*.toml")):
        effects.update(_effects(path, [_read(path)]))
    if source is not None and not source.is_dir():
        tables = _read(source)
        effects.update(_effects(source, tables.get("effect", [tables])))
    if not effects:
        raise InputError("holds no effect", file=source, mend="add one TOML file per effect")
    return effects


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise InputError("cannot be read", file=path, mend="check the path given with --catalogue") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"not valid TOML: {error}", file=path, mend="correct that line") from None


def _effects(path: Path, tables: Iterable[Mapping[str, Any]]) -> dict[str, Effect]:
    found = {}
    for table in tables:
        for key in ("name", "block", "form"):
            if key not in table:
                raise InputError("is missing", file=path, field=key, mend=f"write {key} = ...")
        for axis in table.get("axes", [""]):
            block = f"{table['block']}_{axis}" if axis and table["block"] in AXIS_BLOCKS else table["block"]
            forms = tuple(_form(path, form, axis) for form in table["form"])
            refines, outside = tuple(table.get("refines", ())), table.get("outside", False)
            effect = Effect(table["name"], axis, block, table.get("summary", ""), forms, refines, outside)
            found[effect.key] = effect
    return found


def _members(name: str) -> list[str]:
    """A parameter's name, or those that a range of indices stands for."""
    span = re.fullmatch(r"(.*)\[(\d+):(\d+)\]", name)
    return [f"{span[1]}[{i}]" for i in range(int(span[2]), int(span[3]) + 1)] if span else [name]


def _form(path: Path, table: Mapping[str, Any], axis: str) -> Form:
    parameters = []
    for name, values in table.get("parameters", {}).items():
        for key in ("scale", "low", "high"):
            if not isinstance(values.get(key), int | float):
                raise InputError("must be a number", file=path, field=f"{name}.{key}", mend=f"write {key} = 0.1")
        known = {"neutral", "scale", "low", "high", "unit", "relative", "positive", "starts"}
        unknown = set(values) - known
        if unknown:
            raise InputError("unknown key", file=path, field=f"{name}.{unknown.pop()}", mend=f"use {', '.join(sorted(known))}")
        rest = {"neutral": 0.0, **values, "starts": tuple(values.get("starts", ()))}
        parameters += [Parameter(member, **rest) for member in _members(name.format(axis=axis))]
    if not parameters and not table.get("estimator"):
        raise InputError("has no parameters", file=path, field="form", mend="name at least one parameter to fit")
    settings = {name.format(axis=axis): float(value) for name, value in table.get("settings", {}).items()}
    return Form(table.get("name", "form"), tuple(parameters), settings, table.get("estimator", ""))
