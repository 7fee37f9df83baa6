"""A study's TOML file: the base scenario, what is varied, and what is kept."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.sweep.cases import Axis, Case, grid_cases, sample_cases
from pneugantry.sweep.vary import flat
from pyfmi_runner.scenario import Fields, parse_toml, scenario_from

__all__ = ["Spec", "read_spec"]

MOST_CASES = 1_000_000
METHODS = {"latin_hypercube": "latin_hypercube", "lhs": "latin_hypercube", "sobol": "sobol"}
AXIS_KEYS = ("low", "high", "scale", "choices")
OWN_FILES = {"workpiece": ".csv", "controller": ".py"}  # fields that may name a file of the user
WHOLE = ("seed",)  # fields that are whole numbers


@dataclass(frozen=True)
class Spec:
    """A study. cases: in the order of the results; base: a scenario's TOML table."""

    file: Path
    name: str
    base: dict[str, Any]
    cases: list[Case]
    section: str  # where the file names what is varied: "grid" or "sample.bounds"
    keep_logs: bool
    notes: tuple[str, ...] = ()

    @property
    def varied(self) -> list[str]:
        return list(self.cases[0])


def read_spec(path: str | os.PathLike[str]) -> Spec:
    """Raises InputError naming file, field and hint. What the cases' values do to scenario and FMU
    is checked elsewhere.
    """
    file = Path(path)
    fields = Fields(parse_toml(file), ("name", "base", "grid", "sample", "keep_logs"), file)
    name = fields.of_type("name", str, file.stem)
    if not re.fullmatch(r"[\w.-]+", name) or name.startswith("."):
        fields.refuse(
            "name",
            f"is {name!r}, expected letters, digits, _ . -",
            "it names the folder of the results",
        )
    if ("grid" in fields) == ("sample" in fields):
        what = "both are given" if "grid" in fields else "is missing"
        fields.refuse(
            "grid or sample",
            what,
            'write one of them, for example [grid] with "plant.contact.K_c" = [1e4, 2e4]',
        )
    base = _base(fields)
    section, cases, notes = (
        ("grid", _grid(fields), ()) if "grid" in fields else ("sample.bounds", *_sample(fields))
    )
    _check_names(fields, section, cases[0])
    if OWN_FILES.keys() & cases[0].keys():
        cases = [_with_paths(fields, section, case) for case in cases]
    return Spec(file, name, base, cases, section, fields.of_type("keep_logs", bool, False), notes)


def _base(fields: Fields) -> dict[str, Any]:
    """The base scenario's table, its own edge as a full path. It stands in the file, or in a file
    that it names.
    """
    base = fields.table.get("base", {})
    file = fields.file
    assert file is not None
    if isinstance(base, str):
        file = Path(file).parent / base
        if not os.path.isfile(file):
            fields.refuse(
                "base",
                f"no such file {file}",
                "check the path; it is taken from the folder of this file",
            )
        table = {"name": file.stem} | parse_toml(file)
        read = scenario_from(table, file)
    elif isinstance(base, Mapping):
        table = dict(base)
        try:
            read = scenario_from(table, file)
        except InputError as error:
            raise InputError(
                error.message,
                file=file,
                field=f"base.{error.field or ''}".rstrip("."),
                hint=error.hint,
            ) from None
    else:
        fields.refuse(
            "base",
            f"is {base!r}, expected a table or a file",
            'write [base] or base = "scenario.toml"',
        )
    return table | {
        name: str(Path(getattr(read, name)).resolve())
        for name, suffix in OWN_FILES.items()
        if getattr(read, name).lower().endswith(suffix)
    }


def _grid(fields: Fields) -> list[Case]:
    values = flat(
        fields.sub(
            "grid", fields.table["grid"] if isinstance(fields.table["grid"], Mapping) else ()
        ).table
    )
    for name, given in values.items():
        if not isinstance(given, list) or not given:
            fields.refuse(
                f"grid.{name}",
                f"is {given!r}, expected a list of values",
                "write for example [1e4, 2e4]",
            )
        if any(given.count(value) > 1 for value in given[:1000]):
            fields.refuse(f"grid.{name}", "holds a value twice", "list each value once")
    if not values:
        fields.refuse(
            "grid", "is empty", 'name what varies, for example "plant.contact.K_c" = [1e4, 2e4]'
        )
    if (n := math.prod(len(given) for given in values.values())) > MOST_CASES:
        fields.refuse(
            "grid",
            f"has {n} combinations, at most {MOST_CASES} are run",
            "take fewer values, or a [sample]",
        )
    return grid_cases(values)


def _sample(fields: Fields) -> tuple[list[Case], tuple[str, ...]]:
    sample = fields.sub("sample", ("method", "n", "seed", "bounds"))
    method = sample.of_type("method", str, "latin_hypercube")
    if method not in METHODS:
        sample.refuse("method", f"is {method!r}", f"use {', '.join(METHODS)}")
    n, seed = sample.of_type("n", int, 0), sample.of_type("seed", int, 0)
    if not 1 <= n <= MOST_CASES:
        sample.refuse(
            "n", f"is {n}, expected 1..{MOST_CASES}", "write the number of cases, as in n = 256"
        )
    if seed < 0:
        sample.refuse("seed", f"is {seed}, expected >= 0", "choose a whole number from 0 on")
    bounds = sample.sub("bounds", sample.table.get("bounds", {}))
    axes = {
        name: _axis(bounds, name, given) for name, given in flat(bounds.table, AXIS_KEYS).items()
    }
    if not axes:
        sample.refuse(
            "bounds", "is empty", 'name what varies, for example "plant.contact.K_c" = [1e4, 4e4]'
        )
    power = METHODS[method] == "sobol" and n & (n - 1) != 0
    notes = (
        (f"a Sobol sample is balanced at powers of two; n = {n}, next is {1 << n.bit_length()}",)
        if power
        else ()
    )
    return sample_cases(METHODS[method], axes, n, seed), notes


def _axis(bounds: Fields, name: str, given: Any) -> Axis:
    """[low, high], { low, high, scale = "log" } or { choices = [...] }."""
    if isinstance(given, list) and len(given) == 2:
        given = {"low": given[0], "high": given[1]}
    if not isinstance(given, Mapping):
        bounds.refuse(
            name,
            f"is {given!r}, expected low and high",
            'write [1e4, 4e4] or { low = 1e4, high = 4e4, scale = "log" }',
        )
    axis = Fields(given, AXIS_KEYS, bounds.file, f"{bounds.prefix}{name}.")
    if "choices" in axis:
        choices = axis.of_type("choices", list, [])
        if not choices or len(axis.table) > 1:
            axis.refuse(
                "choices",
                "needs values, and no low, high or scale beside it",
                'write { choices = ["straight", "curved"] }',
            )
        return Axis(choices=tuple(choices))
    low, high, scale = axis.number("low"), axis.number("high"), axis.of_type("scale", str, "linear")
    if low is None or high is None or not low < high:
        bounds.refuse(name, f"goes from {low} to {high}", "write low < high")
    if scale not in ("linear", "log"):
        axis.refuse("scale", f"is {scale!r}", "use linear or log")
    if scale == "log" and low <= 0.0:
        axis.refuse(
            "low", f"is {low:g}, a log scale needs > 0", "raise it, or use the linear scale"
        )
    whole = name in WHOLE
    if whole and (scale == "log" or not (low.is_integer() and high.is_integer())):
        bounds.refuse(
            name,
            f"goes from {low:g} to {high:g}, {scale}; it is a whole number",
            "write whole numbers, linear scale",
        )
    return Axis(low, high, scale == "log", whole)


def _check_names(fields: Fields, section: str, names: Case) -> None:
    for name in names:
        for other in names:
            if name.startswith(f"{other}."):
                fields.refuse(
                    f"{section}.{name}",
                    f"varies a part of {other}, which varies too",
                    "vary one of the two",
                )


def _with_paths(fields: Fields, section: str, case: Case) -> Case:
    """Files of the user's own, an edge or a controller, as full paths: the case may run
    elsewhere.
    """
    return case | {
        name: _full_path(fields, f"{section}.{name}", case[name])
        for name, suffix in OWN_FILES.items()
        if isinstance(case.get(name), str) and case[name].lower().endswith(suffix)
    }


def _full_path(fields: Fields, key: str, name: str) -> str:
    assert fields.file is not None
    path = Path(fields.file).parent / name
    if not os.path.isfile(path):
        hint = "check the path; it is taken from the folder of this file"
        fields.refuse(key, f"no such file {path}", hint)
    return os.path.abspath(path)  # a link keeps its name
