"""The augmented plant as Modelica and as an FMU: the nominal one extended with what was fitted, for
other tools.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from modelica_fmu.files import write_atomically
from pneugantry.plants.modelica import Extension, write_extension
from pyfmi_runner.build import default_model
from pyfmi_runner.fmu import FmuFile

__all__ = ["augmented_model", "outside_the_plant", "write_augmented"]

CLASS = "AugmentedGantry"


def augmented_model(
    gantry: FmuFile, values: Mapping[str, float], remarks: Sequence[str] = ()
) -> Extension:
    """The FMU's class extended with `values`, by the FMU's names; values equal to its own are left
    out.

    Sensor errors and loop delay are no part of a plant: they stand in comments
    (`outside_the_plant`).
    """
    modifiers = {}
    for path, value in sorted(values.items()):
        if not _is_parameter(gantry, path) or gantry.variables[path].start == value:
            continue
        stem = re.sub(r"\[\d+\]$", "", path)
        modifiers[stem] = (
            _array(gantry, values, path) if path.endswith("]") else _literal(gantry, path, value)
        )
    base = gantry.description.model
    title = f"{base} as fitted to a measured campaign"
    return Extension(CLASS, title, base, modifiers, (*remarks, *outside_the_plant(values)))


def outside_the_plant(values: Mapping[str, float]) -> list[str]:
    """Sentences on fitted values that act outside the plant."""
    said = [
        f"sensor: {name.removeprefix('sensors.')} = {value:.6g}"
        for name, value in values.items()
        if name.startswith("sensors.")
    ]
    delay = sum(value for name, value in values.items() if name.startswith("timing."))
    return [*said, f"controller: loop delay of {1e3 * delay:.4g} ms"] if delay else said


def write_augmented(
    folder: Path,
    gantry: FmuFile,
    values: Mapping[str, float],
    remarks: Sequence[str] = (),
    model: Path | None = None,
) -> tuple[Path, Path]:
    """Writes AugmentedGantry.mo and the FMU built from it into a folder; returns both paths.

    `model`: the Modelica file of the nominal class where it is not the project's own; it is written
    beside them. Raises InputError where the folder cannot be written.
    """
    starts = {name: float(value) for name, value in values.items() if _is_parameter(gantry, name)}
    extension = augmented_model(gantry, values, remarks)
    made = write_extension(folder, extension, model or default_model(), starts)
    if model is not None:
        text = model.read_text(encoding="utf-8")
        write_atomically(folder / model.name, lambda at: at.write_text(text, encoding="utf-8"))
    return made


def _is_parameter(gantry: FmuFile, path: str) -> bool:
    variable = gantry.variables.get(path)
    return variable is not None and variable.causality == "parameter"


def _literal(gantry: FmuFile, path: str, value: float) -> str:
    variable = gantry.variables[path]
    if variable.type == "Boolean":
        return "true" if value else "false"
    if variable.literals:
        literal = next(name for name, number in variable.literals.items() if number == int(value))
        return f"PneuGantry.Types.{_enumeration(path)}.{literal}" if "." not in literal else literal
    return str(int(value)) if variable.type in ("Integer", "Enumeration") else repr(float(value))


def _enumeration(path: str) -> str:
    return {"law": "FrictionLaw", "shape": "EdgeShape"}[path.rsplit(".", 1)[-1]]


def _array(gantry: FmuFile, values: Mapping[str, float], path: str) -> str:
    stem = path[: path.rindex("[")]
    names = [n for n in gantry.variables if re.fullmatch(re.escape(stem) + r"\[\d+\]", n)]
    names.sort(key=lambda n: int(n[len(stem) + 1 : -1]))
    return (
        "{"
        + ", ".join(repr(float(values.get(n, gantry.variables[n].start or 0.0))) for n in names)
        + "}"
    )
