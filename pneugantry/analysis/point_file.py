"""Operating points as JSON: `{"schema": "state/1", "states": {..}, "inputs": {..}, "parameters":
{..}}`, names and units the FMU's.
"""

from __future__ import annotations

import difflib
import json
import math
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from modelica_fmu.files import check_source, write_atomically
from pneugantry.analysis.operating_point import OperatingPoint
from pyfmi_runner.fmu import FmuFile

__all__ = ["point_table", "read_point", "write_point"]

SCHEMA = "state/1"
PARTS = ("states", "inputs", "parameters")


def point_table(point: OperatingPoint) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "states": point.states,
        "inputs": point.inputs,
        "parameters": point.parameters,
    }


def write_point(point: OperatingPoint, path: Path) -> None:
    """Writes a point so that `read_point` gives it back equal."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(point_table(point), indent=2) + "\n"
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def read_point(path: Path, file: FmuFile) -> OperatingPoint:
    """A point for this FMU. Raises InputError that names the file, the field and the hint."""
    check_source(path)
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f"cannot be read: {error.strerror}", file=path, hint="correct the path"
        ) from None
    except ValueError as error:
        raise InputError(
            f"is no JSON ({error})",
            file=path,
            hint="write a file as `pneugantry linearize --save FILE` does",
        ) from None
    if not isinstance(table, dict):
        raise InputError(
            "holds no table",
            file=path,
            hint='write {"states": {..}, "inputs": {..}, "parameters": {..}}',
        )
    for key in table:
        if key not in (*PARTS, "schema"):
            raise InputError(
                "unknown key",
                file=path,
                field=str(key),
                hint=f"known keys: schema, {', '.join(PARTS)}",
            )
    if table.get("schema", SCHEMA) != SCHEMA:
        raise InputError(
            f"is {table['schema']!r}, expected {SCHEMA!r}",
            file=path,
            field="schema",
            hint="save the point again",
        )
    variables = file.variables
    known = {"states": set(file.description.states)}
    known |= {
        part: {n for n, v in variables.items() if v.causality == part[:-1]}
        for part in ("inputs", "parameters")
    }
    return OperatingPoint(
        *(_numbers(path, part, table.get(part, {}), known[part], file) for part in PARTS)
    )


def _numbers(
    path: Path, part: str, values: object, known: set[str], file: FmuFile
) -> dict[str, float]:
    if not isinstance(values, dict):
        raise InputError(
            f"is {values!r}, expected a table",
            file=path,
            field=part,
            hint="write names and numbers",
        )
    for name, value in values.items():
        field = f"{part}.{name}"
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            raise InputError(
                f"the FMU has none of this name among its {part}",
                file=path,
                field=field,
                hint=f"did you mean {near[0]}?" if near else "remove it",
            )
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(
                f"is {value!r}, expected a number",
                file=path,
                field=field,
                hint="write a finite number",
            )
        bounds = file.variables[name]
        if not bounds.min <= value <= bounds.max:
            hint = "choose a value within it"
            raise InputError(
                f"is {value:g}, expected {bounds.min:g}..{bounds.max:g}",
                file=path,
                field=field,
                hint=hint,
            )
    return {name: float(value) for name, value in values.items()}
