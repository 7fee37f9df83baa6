"""Probabilities for a plant of one's own: rigs are drawn from its model, diagnosed, and the weights
of the decision fitted to them. The result stands beside the description and serves from then on.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from modelica_fmu.files import write_atomically
from pneugantry.engine.answer.result import to_json
from pneugantry.engine.calibration.draws import Source, drawn
from pneugantry.engine.calibration.weights import FITTED, Calibration, Known, calibrated, known_case
from pneugantry.engine.chances import Chances
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import run
from pneugantry.engine.task import Task
from pyfmi_runner.scenario import parse_toml

__all__ = [
    "Rigs",
    "as_json",
    "calibration_of",
    "chances_of",
    "path_of",
    "stamp_of",
    "write_calibration",
]

LEAST = 10  # rigs


@dataclass(frozen=True)
class Rigs:
    """Reads a plant once in a worker, then draws and diagnoses rig by rig."""

    plant: Path
    catalogue: Path | None = None

    def __call__(self) -> Callable[[int], dict[str, Any]]:
        from pneugantry.plants.described import described_task

        found, task = described_task(self.plant, self.catalogue)
        defaults = {k: v for view in task.views for k, v in view.defaults.items()}
        source = Source(task.plant, task.data, task.catalogue, defaults, task.cache)
        return partial(_rig, source, task, found.rules)


def _rig(source: Source, task: Task, rules: Rules, seed: int) -> dict[str, Any]:
    """Truth and diagnosis of the rig of a seed."""
    rig = drawn(source, seed)
    found = run(replace(task, data=rig.data, chances=Chances()), rules)
    said = to_json(found.diagnosis)
    causes = [{"effect": key, "axis": "", "known": True} for key in rig.effects]
    return {
        "seed": seed,
        "truth": {"kind": rig.kind, "causes": causes, "what": rig.what},
        "answer": {k: said[k] for k in ("verdict", "weighed", "stands_out", "doubtful", "seconds")},
    }


def calibration_of(rigs: Iterable[Mapping[str, Any]]) -> Calibration:
    """Weights from diagnosed rigs. Raises InputError for too few."""
    cases = [_known(r) for r in rigs]
    if len(cases) < LEAST:
        raise InputError(
            f"{len(cases)} rigs were diagnosed, expected >= {LEAST}",
            field="--cases",
            hint="draw more",
        )
    return calibrated(cases, Chances())


def _known(rig: Mapping[str, Any]) -> Known:
    return known_case(rig["truth"], rig["answer"])


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
        chances = replace(Chances(), **{k: weights[k] for k in FITTED})  # type: ignore[arg-type]
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputError(
            "is no calibration",
            file=path,
            hint=f"make it anew: pneugantry calibrate {plant}{given}",
        ) from None
    if not same:
        what = f"{plant.name}, a file that it names or the catalogue"
        return Chances(), f"{what} has changed since {path.name} was made; {hint}"
    return chances, ""


def stamp_of(plant: Path, catalogue: Path | None = None) -> str:
    """Hash of all that rigs are drawn from: the description, the files that it names, the effects.
    catalogue: folder or file that is read instead of the description's.
    """
    table = parse_toml(plant)
    own = table["plant"].pop("catalogue", None)
    effects = catalogue if catalogue is not None or own is None else plant.parent / own
    files = [plant, *_named(table, plant.parent)]
    if effects is not None:
        files += sorted(effects.glob("*.toml")) if effects.is_dir() else [effects]
    digest = hashlib.sha256()
    for file in files:
        if file.is_file():
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _named(value: Any, folder: Path) -> Iterator[Path]:
    """Files that a description's values name: its model or FMUs, its logs."""
    if isinstance(value, str):
        if value and (folder / value).is_file():
            yield folder / value
    elif isinstance(value, Mapping | list):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from _named(part, folder)
