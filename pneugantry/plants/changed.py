"""Two descriptions of one rig, before and after a change: what came, what went, what stayed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from modelica_fmu.errors import InputError
from pneugantry.engine.change import gap_on, joined, with_changes
from pneugantry.engine.describe import Described
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found
from pneugantry.engine.task import Task
from pneugantry.plants.calibration_file import chances_of
from pneugantry.plants.described import answered, described_task
from pyfmi_runner.scenario import parse_toml

__all__ = ["changed_task", "diagnose_change"]

OTHER = "differs from that of the campaign before"


def diagnose_change(
    before: Path,
    after: Path,
    catalogue: Path | None = None,
    cache: Path | None = None,
    rules: Rules | None = None,
    say: Callable[[str], None] = lambda stage: None,
) -> tuple[Found, Rules]:
    """The diagnosis of two campaigns of one described plant, and the rules that it was made with.
    Arguments and errors as of `changed_task`; say: told the name of each stage.
    """
    say("model and logs")
    read, task = changed_task(before, after, catalogue, cache, rules)
    found = answered(read, task, say)
    gaps = [gap_on(found, r, read.rules) for r in reversed(task.data.unseen)]
    return with_changes(found, [g.gap for g in gaps if g is not None]), read.rules


def changed_task(
    before: Path,
    after: Path,
    catalogue: Path | None = None,
    cache: Path | None = None,
    rules: Rules | None = None,
) -> tuple[Described, Task]:
    """One task of two descriptions; catalogue, tolerance and calibration are those of `before`.
    Arguments and errors as of `described_task`; InputError where the descriptions are of two
    plants.
    """
    first, one = described_task(before, catalogue, cache, rules)
    effects = catalogue or _catalogue_of(before)
    second, two = described_task(after, effects, cache, rules)
    _check(first, second, after)
    _, uncalibrated = chances_of(before, catalogue)
    _, other = chances_of(after, effects)
    one = replace(one, notes=tuple(n for n in one.notes if n != uncalibrated))
    two = replace(two, notes=tuple(n for n in two.notes if n != other))
    task = joined(one, two)
    notes = (*task.notes, *([uncalibrated] if uncalibrated else []))
    return first, replace(task, notes=notes)


def _catalogue_of(description: Path) -> Path | None:
    """What a description names."""
    given = parse_toml(description).get("plant", {}).get("catalogue", "")
    return description.parent / given if given else None


def _check(first: Described, second: Described, path: Path) -> None:
    """Refuses descriptions of two plants."""
    one, two = first.plant, second.plant
    for what, a, b in (
        ("plant.model", one.model.resolve(), two.model.resolve()),
        ("plant.class", one.class_name, two.class_name),
        ("inputs", sorted(one.inputs), sorted(two.inputs)),
        ("parameters", dict(one.parameters), dict(two.parameters)),
    ):
        if a != b:
            hint = "both are of one rig: what a log alone has belongs under [log.NAME.parameters]"
            raise InputError(OTHER, file=path, field=what, hint=hint)
    if first.rules.band != second.rules.band:
        hint = "write the same [plant] period and decimate in both"
        raise InputError(OTHER, file=path, field="plant.period", hint=hint)
