"""A plant's calibration: the file beside its description, from which the weights of its decisions
are read as long as it fits what the rigs were drawn from.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from modelica_fmu.files import write_atomically
from pneugantry.engine.calibration.weights import FITTED, Calibration
from pneugantry.engine.chances import Chances
from pneugantry.engine.hypotheses.catalogue import catalogue_files
from pyfmi_runner.scenario import parse_toml

__all__ = [
    "as_json",
    "chances_of",
    "files_named",
    "files_of",
    "path_of",
    "stamp_of",
    "write_calibration",
]


def path_of(plant: Path) -> Path:
    """Where a plant's calibration stands."""
    return plant.with_suffix(".calibration.json")


def as_json(found: Calibration) -> dict[str, Any]:
    """What a calibration says of itself, in its file and as the command's result."""
    return {
        "schema": "calibration/1",
        "rigs": found.rigs,
        "chances": {k: v for k, v in asdict(found.chances).items() if k != "usual"},
        "log_probability": {"before": found.before, "after": found.score},
        "reliability": [asdict(b) for b in found.reliability],
    }


def write_calibration(
    plant: Path, found: Calibration, seed: int, catalogue: Path | None = None
) -> Path:
    """Beside the description; `diagnose` reads it from there. catalogue: that the rigs were drawn
    from, where it is not the description's.
    """
    told = {**as_json(found), "plant": stamp_of(plant, catalogue), "seed": seed}
    text = json.dumps(told, indent=1) + "\n"
    write_atomically(path_of(plant), lambda at: at.write_text(text, encoding="utf-8"))
    return path_of(plant)


def chances_of(plant: Path, catalogue: Path | None = None) -> tuple[Chances, str]:
    """The weights for a plant with its catalogue or another one, and a note where they are not its
    own. Raises InputError for a file that is no calibration.
    """
    path = path_of(plant)
    given = "" if catalogue is None else f" --catalogue {catalogue}"
    hint = f"probabilities are not calibrated for this plant: pneugantry calibrate {plant}{given}"
    if not path.is_file():
        return Chances(), hint
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        weights = {k: float(v) for k, v in told["chances"].items()}
        same = told["plant"] == stamp_of(plant, catalogue)
        known = {k: weights[k] for k in FITTED if k in weights}
        chances = replace(Chances(), **known)  # type: ignore[arg-type]
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputError(
            "is no calibration",
            file=path,
            hint=f"make it anew: pneugantry calibrate {plant}{given}",
        ) from None
    if not same:
        what = f"{plant.name}, a file that it names or the catalogue"
        return Chances(), f"{what} has changed since {path.name} was made; {hint}"
    if len(known) < len(FITTED):
        return Chances(), f"{path.name} was made by another version; {hint}"
    return chances, ""


def stamp_of(plant: Path, catalogue: Path | None = None) -> str:
    """Hash of all that rigs are drawn from: the description, the files that it names, the effects.
    catalogue: folder or file that is read instead of the description's.
    """
    digest = hashlib.sha256()
    for file in files_of(plant, catalogue):
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def files_of(plant: Path, catalogue: Path | None = None) -> list[Path]:
    """Files that a diagnosis reads: a description, what it names, the effects. catalogue: as of
    `stamp_of`. Raises InputError for a description that is no TOML.
    """
    table = parse_toml(plant)
    about = table.get("plant")
    own = about.pop("catalogue", None) if isinstance(about, dict) else None
    named = plant.parent / own if isinstance(own, str) else None
    effects = named if catalogue is None else catalogue
    files = [plant, *files_named(table, plant.parent)]
    if effects is not None:
        files += catalogue_files(effects)
    return [file for file in files if file.is_file()]


def files_named(value: Any, folder: Path) -> Iterator[Path]:
    """Files in a folder, or from there, that the values of a TOML table name: a description's model
    or FMUs, logs.
    """
    if isinstance(value, str):
        if value and (folder / value).is_file():
            yield folder / value
    elif isinstance(value, Mapping | list):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from files_named(part, folder)
