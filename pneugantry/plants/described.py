"""A user's plant from its description (see `engine.describe`): to an answer, and to the plant with
that answer in it.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from modelica_fmu.errors import InputError
from modelica_fmu.files import write_atomically
from pneugantry.engine.describe import Described, described, views_of
from pneugantry.engine.hypotheses.catalogue import Effect, Form
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found, run
from pneugantry.engine.signals.commands import outside
from pneugantry.engine.task import Task
from pneugantry.engine.views.accuracy import accurate
from pneugantry.engine.views.foreign import ForeignPlant
from pneugantry.engine.views.view import View
from pneugantry.plants.calibration_file import chances_of
from pneugantry.plants.doubts import doubts_of, with_doubts
from pneugantry.plants.modelica import Extension, write_extension
from pneugantry.plants.targets import AUGMENTED, NO_SOURCE, SET_BY_HAND, augmented_name
from pyfmi_runner.build import build_fmu, cache_folder
from pyfmi_runner.fmu import FmuFile, FmuVariable
from pyfmi_runner.scenario import parse_toml

__all__ = [
    "answered",
    "described_task",
    "diagnose_described",
    "is_plant_description",
    "write_augmented",
]


def is_plant_description(path: Path) -> bool:
    """A TOML file with a [plant] table."""
    return path.suffix == ".toml" and os.path.isfile(path) and "plant" in parse_toml(path)


def diagnose_described(
    path: Path,
    catalogue: Path | None = None,
    cache: Path | None = None,
    rules: Rules | None = None,
    say: Callable[[str], None] = lambda stage: None,
) -> tuple[Found, Rules]:
    """The diagnosis of a described plant, and the rules that it was made with. catalogue: folder or
    file, read instead of the one that the description names; cache: folder of the model's parts.
    say: told the name of each stage. Raises InputError naming file, field and hint.
    """
    say("model and logs")
    read, task = described_task(path, catalogue, cache, rules)
    return answered(read, task, say), read.rules


def answered(
    found: Described, task: Task, say: Callable[[str], None] = lambda stage: None
) -> Found:
    """The diagnosis of what `described_task` has read. What no effect seems to be behind is said
    before, and told with an answer that is "unknown".
    """
    doubts = doubts_of(task)
    for doubt in doubts:
        say(f"note: {doubt}")
    return with_doubts(run(task, found.rules, say), doubts)


def described_task(
    path: Path,
    catalogue: Path | None = None,
    cache: Path | None = None,
    rules: Rules | None = None,
) -> tuple[Described, Task]:
    """What a diagnosis is made of, as read; arguments and errors as of `diagnose_described`."""
    found = described(path, cache or cache_folder() / "parts", catalogue, rules)
    views, notes = views_of(found)
    plant = accurate(found.plant, views, found.data.fitted)
    if plant is not found.plant:
        found = replace(found, plant=plant)
        views, notes = views_of(found)
    if not views:
        hint = "; ".join(notes) or "name what was measured under [outputs]"
        raise InputError("no measured signal can be judged", file=path, field="outputs", hint=hint)
    _check(found, views, path)
    notes += _judged(found, views, path)
    if found.data.held_out is None:
        notes.append("no log is held out: the gap before and after is that of a fitted log")
    chances, uncalibrated = chances_of(path, catalogue)
    if uncalibrated:
        notes.append(uncalibrated)
    task = Task(
        found.plant,
        views,
        found.data,
        found.catalogue,
        found.cache,
        chances,
        notes=(*found.notes, *notes),
        limits=_unseen(found, views),
    )
    return found, task


def _check(found: Described, views: list[View], path: Path) -> None:
    """Refuses a catalogue that speaks of another plant."""
    own = {k: e for k, e in found.catalogue.items() if not e.outside}
    if not own:
        hint = 'write catalogue = "effects" under [plant], or give --catalogue'
        raise InputError("names no catalogue", file=path, field="plant.catalogue", hint=hint)
    known = {n: v for file in _files(found) for n, v in file.items()}
    names, file = {e.name for e in own.values()}, found.effects_from or path
    starts = {n: v.start for n, v in known.items() if n not in found.plant.parameters}
    for effect in own.values():
        for form in effect.forms:
            for name in (*form.settings, *(p.name for p in form.parameters)):
                if name not in known and not outside(name):
                    raise InputError(
                        "the plant has no such parameter",
                        file=file,
                        field=f"{effect.name}: {name}",
                        hint="correct the name, or give the plant's own catalogue with --catalogue",
                    )
            _check_neutral(form, starts, effect, file)
        if unknown := set(effect.refines) - names:
            raise InputError(
                f"refines {unknown.pop()!r}, which the catalogue lacks",
                file=file,
                field=effect.name,
                hint="correct the name",
            )


def _check_neutral(
    form: Form, starts: Mapping[str, float | None], effect: Effect, file: Path
) -> None:
    """Refuses an effect of one parameter without which the plant would be another one than the
    model. starts: the model's values, but of what the description sets: that holds without an
    effect, neutral or not.
    """
    if len(form.parameters) != 1 or form.settings:
        return
    (own,) = form.parameters
    value = starts.get(own.name)
    if value is not None and not own.relative and value != own.neutral:
        raise InputError(
            f"neutral is {own.neutral:g}, but {value:g} is what the plant has without the effect",
            file=file,
            field=f"{effect.name}: {own.name}",
            hint=f"write neutral = {value:g}, or relative = true for a share of that",
        )


def _judged(found: Described, views: list[View], path: Path) -> list[str]:
    """Notes on fitted logs that show nothing. Raises InputError for a log without any measured
    column, and where nothing is left to fit or to compare with.
    """
    names = ", ".join(s.name for s in found.plant.signals)
    for record in found.records:
        if not record.signals:
            raise InputError(
                f"has no column of a measured signal ({names})",
                file=path,
                field=f"log.{record.name}",
                hint="correct column under [outputs] or the log's file, or take the log out",
            )
    dull = [r.name for r in found.records if not any(v.shows(r) for v in views)]
    held = found.data.held_out
    unheld = held is not None and held.name in dull
    if unheld or set(dull) >= {r.name for r in found.data.fitted}:
        raise InputError(
            "nothing can be judged: no signal moves, or one that is needed with it is missing",
            file=path,
            field=f"log.{held.name}" if held is not None and unheld else "log",
            hint="record one in which the plant moves, with all of [outputs], or hold out another",
        )
    return [f"{name}: nothing in it can be judged, not used" for name in dull]


def _files(found: Described) -> list[Mapping[str, FmuVariable]]:
    """Variables of the plant's model, or of its FMUs under their prefixes."""
    plant = found.plant
    if isinstance(plant, ForeignPlant):
        return [{f.prefix + n: v for n, v in f.file.variables.items()} for f in plant.fmus]
    return [FmuFile.read(build_fmu(plant.class_name, plant.model).path).variables]


def _unseen(found: Described, views: list[View]) -> tuple[str, ...]:
    """What these logs cannot show: signals that no view judges, effects that no view reads."""
    shown = [v for v in views if any(v.shows(r) for r in found.data.fitted)]
    judged = {s for v in shown for s in v.signals}
    said = [f"{s.name} is not judged" for s in found.plant.signals if s.name not in judged]
    for key, effect in found.catalogue.items():
        names = [p.name for form in effect.forms for p in form.parameters]
        if not any(v.depends_on(n) for v in shown for n in names) and not effect.outside:
            said.append(f"{key} cannot be seen: no fitted log measures what it acts on")
    return tuple(said)


# ---- the plant with the answer in it


def write_augmented(folder: Path, found: Found, with_base: bool = False) -> tuple[Path, Path]:
    """Writes a Modelica model that extends the plant's with what was fitted, and the FMU built from
    it; returns both paths. Sensor errors are no part of a plant: they stand in comments. with_base:
    the plant's own file is written as well, for it holds a term that was learnt. Raises InputError
    for a plant of FMUs without source, and where the folder cannot be written.
    """
    plant = found.task.plant
    if isinstance(plant, ForeignPlant):
        raise InputError(NO_SOURCE, field=AUGMENTED, hint=SET_BY_HAND)
    variables = FmuFile.read(build_fmu(plant.class_name, plant.model).path).variables
    values = {**plant.parameters, **found.values}
    changed = {
        n: v
        for n, v in sorted(values.items())
        if n in variables and variables[n].causality == "parameter" and variables[n].start != v
    }
    starts = {n: float(v) for n, v in changed.items()}
    made = write_extension(folder, _extension(found, variables, changed), plant.model, starts)
    if with_base:
        write_atomically(folder / plant.model.name, lambda at: shutil.copy(plant.model, at))
    return made


def _extension(
    found: Found, variables: Mapping[str, FmuVariable], values: Mapping[str, float]
) -> Extension:
    """The plant's class under other values; those that are no plain numbers in Modelica stand in
    comments, and reach the FMU all the same.
    """
    plant = found.task.plant
    plain = {n: _literal(variables[n], v) for n, v in values.items() if _plain(n, variables)}
    said = [f"{c.key}: probability {c.probability:.2f}" for c in found.diagnosis.causes]
    said += [f"{n} = {v:.6g}" for n, v in sorted(found.values.items()) if outside(n)]
    said += [f"{n} = {v:g} in the FMU" for n, v in values.items() if n not in plain]
    title = f"{plant.class_name} as fitted to the logs of {plant.name}"
    name = augmented_name(plant.class_name)
    return Extension(name, title, plant.class_name, plain, tuple(said))


def _plain(name: str, variables: Mapping[str, FmuVariable]) -> bool:
    return "[" not in name and variables[name].type in ("Real", "Integer", "Boolean")


def _literal(variable: FmuVariable, value: float) -> str:
    if variable.type == "Boolean":
        return "true" if value else "false"
    return str(round(value)) if variable.type == "Integer" else repr(float(value))
