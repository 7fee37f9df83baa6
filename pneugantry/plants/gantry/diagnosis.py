"""A measuring campaign of the gantry, diagnosed: what the engine finds, and what only the gantry
has beside it: notes on its logs, a coarse converter, the closed loop, the next experiment.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError, RunError
from pneugantry.engine.answer.confirm import values_on
from pneugantry.engine.answer.decide import UNKNOWN
from pneugantry.engine.answer.location import Place
from pneugantry.engine.answer.result import Cause, Diagnosis, Size
from pneugantry.engine.change import AFTER, BEFORE, gap_on, joined, with_changes
from pneugantry.engine.hypotheses.catalogue import Effect
from pneugantry.engine.plant import Data, Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found, run
from pneugantry.engine.task import Task
from pneugantry.engine.views.view import View
from pneugantry.plants.gantry.catalogue import QUANTISATION, catalogue_of, check_names
from pneugantry.plants.gantry.closed_loop import left_out, rerun
from pneugantry.plants.gantry.converter import (
    Converters,
    as_read,
    coarse_channels,
    converters,
    rounded,
)
from pneugantry.plants.gantry.describe import data_of, measured_of, plant_of, record_of, views_of
from pneugantry.plants.gantry.excitation import not_excited
from pneugantry.plants.gantry.next_experiment import proposed
from pneugantry.plants.gantry.nominal import Nominal, parameters_of
from pneugantry.plants.gantry.usable import sound_logs
from pyfmi_runner.build import build_fmu, cache_folder
from pyfmi_runner.campaign import Campaign
from pyfmi_runner.enough_rows import long_enough
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import COLUMNS

__all__ = ["both", "diagnose", "finished", "task_of"]

Say = Callable[[str], None]
ONE_LOG = (
    "one log only: nothing is held out, so the gap before and after is on the fitted log itself"
)
SHIPPED = Nominal()
SEEN = 1.0  # probability of what the readings themselves show


def diagnose(
    campaign: Campaign,
    catalogue: Mapping[str, Effect] | None = None,
    rules: Rules | None = None,
    nominal: Nominal = SHIPPED,
    say: Say = lambda stage: None,
    after: Campaign | None = None,
) -> Found:
    """Diagnoses a campaign. nominal: the gantry that it is compared with. say: told the name of
    each stage as it begins. after: a second campaign of the same gantry, after a change. Raises
    InputError where nothing is left to diagnose.
    """
    began = time.perf_counter()
    rules, fmu = rules or Rules(), nominal.fmu
    own = FmuFile.read(build_fmu(model=nominal.model).path)
    catalogue = catalogue_of() if catalogue is None else catalogue
    check_names(catalogue, own)
    campaigns = [_checked(c) for c in (campaign, after) if c is not None]
    say("model")
    parameters = parameters_of(fmu, own, next(iter(campaigns[0]))) if fmu is not None else {}
    coarse = [converters(c) for c in campaigns]
    campaigns = [as_read(c, q.steps) for c, q in zip(campaigns, coarse, strict=True)]
    tasks = [
        task_of(c, catalogue, rules, parameters, q, nominal.model)
        for c, q in zip(campaigns, coarse, strict=True)
    ]
    campaigns = [rounded(c, q.steps) for c, q in zip(campaigns, coarse, strict=True)]
    task = tasks[0] if after is None else joined(*tasks)
    campaign = campaigns[0] if after is None else both(*campaigns)
    found = run(task, rules, say)
    say("closed loop")
    found = _with(
        found, _coarse(found.diagnosis, {n: s for q in coarse for n, s in q.steps.items()})
    )
    found = _at_full_rate(found, campaign, rules)
    found = _in_loop(found, campaign, fmu or own)
    if found.diagnosis.verdict == "ambiguous" and after is None:
        say("next experiment")
        best = proposed(found, campaign, fmu or own, rules)
        found = _with(found, replace(found.diagnosis, next_experiment=best))
    return _with(found, replace(found.diagnosis, seconds=time.perf_counter() - began))


def task_of(
    campaign: Campaign,
    catalogue: Mapping[str, Effect],
    rules: Rules,
    parameters: Mapping[str, float] | None = None,
    coarse: Converters | None = None,
    model: Path | None = None,
) -> Task:
    """What the engine is given of a campaign. parameters: of the nominal gantry, where they are not
    the model's own. coarse: converters; what these cut off its controller does not see. model: as
    of `Nominal`.
    """
    coarse = coarse or Converters({})
    read, campaign = campaign, rounded(campaign, coarse.steps)
    measured = measured_of(campaign)
    if not measured:
        hint = "add one of the columns that `pneugantry list columns` names"
        raise InputError("no log measures anything", file=campaign.path, hint=hint)
    plant = replace(plant_of(measured, rules.thinning), parameters=dict(parameters or {}))
    plant = _coarser(plant, coarse.steps)
    plant = plant if model is None else replace(plant, model=model)
    cache = cache_folder() / "parts"
    views = views_of(plant, read, cache, rules, coarse.undecided)
    data, dull = _judged(data_of(campaign, rules), views, campaign)
    fitted = {r.name for r in data.fitted}
    notes = (*campaign.notes, *dull, *(() if data.held_out else (ONE_LOG,)))
    return Task(
        plant,
        views,
        data,
        catalogue,
        cache,
        notes=(*notes, *_coarse_notes(coarse.steps)),
        limits=tuple(not_excited(r for n, r in campaign.logs.items() if n in fitted)),
    )


def _judged(data: Data, views: Sequence[View], campaign: Campaign) -> tuple[Data, list[str]]:
    """Without records of which no view judges a signal, and a note of each. Raises InputError where
    none is left.
    """
    every = (*data.fitted, *(() if data.held_out is None else (data.held_out,)))
    shown = {r.name for r in every if any(v.shows(r) for v in views)}
    dull = [r.name for r in every if r.name not in shown]
    left = [r for r in every if r.name in shown]
    if not left:
        raise InputError(
            "nothing in its logs can be judged: no signal moves, or one needed with it is missing",
            file=campaign.path,
            hint="record a log in which the carriages or forces move, with all channels",
        )
    said = "left out: nothing in it can be judged (no signal moves, or one needed is missing)"
    fitted, held = (left[:-1], left[-1]) if len(left) > 1 else (left, None)
    return Data(tuple(fitted), held), [f"{name} {said}" for name in dull]


def _checked(campaign: Campaign) -> Campaign:
    """Without logs that are too short or have a fault; all that was seen stands in its notes."""
    campaign = long_enough(campaign)
    sound, notes = sound_logs(campaign)
    return replace(sound, notes=[*campaign.notes, *notes])


def both(before: Campaign, after: Campaign) -> Campaign:
    """Two campaigns of one gantry as one, logs by the names that the engine has for them."""
    logs = {
        f"{epoch}/{n}": replace(run, log=replace(run.log, name=f"{epoch}/{n}"))
        for epoch, campaign in ((BEFORE, before), (AFTER, after))
        for n, run in campaign.logs.items()
    }
    return replace(before, logs=logs, notes=[*before.notes, *after.notes])


def _held(found: Found) -> Record:
    """The record whose gap is told."""
    data = found.task.data
    return data.held_out or data.fitted[-1]


def _full_rate(record: Record, campaign: Campaign) -> Record:
    """A fitted record as it was recorded, with all that is known of it alone."""
    made = record_of(record.name, campaign.logs[record.name])
    known = {**record.parameters, **made.parameters}
    return replace(made, parameters=known, epoch=record.epoch)


def _with(found: Found, diagnosis: Diagnosis) -> Found:
    return replace(found, diagnosis=diagnosis)


def finished(found: Found, campaign: Campaign, rules: Rules) -> Found:
    """What the engine found of another plant's model, with gap and closed loop as `diagnose` tells
    them; campaign: as it was read.
    """
    grid, plant = coarse_channels(campaign), found.task.plant
    campaign = rounded(as_read(campaign, grid), grid)
    fmu = FmuFile.read(build_fmu(plant.class_name, plant.model).path)
    found = _with(found, _coarse(found.diagnosis, grid))
    return _in_loop(_at_full_rate(found, campaign, rules), campaign, fmu)


def _at_full_rate(found: Found, campaign: Campaign, rules: Rules) -> Found:
    """With the gap of the log as it was recorded, so that the sensors' noise alone leaves 1 and
    `pneugantry replay` says the same; the fits see averages of rows. With what changed, where there
    are two campaigns.
    """
    plant = plant_of([s.name for s in found.task.plant.signals], thinning=1)
    own = found.task.plant
    plant = replace(plant, parameters=own.parameters, model=own.model)
    finer = replace(found, task=replace(found.task, plant=plant))
    if found.gap is not None:
        made = gap_on(finer, _full_rate(_held(found), campaign), rules)
        if made is not None:
            d = replace(found.diagnosis, gap=made.gap)
            found = replace(
                found,
                diagnosis=d,
                nominal=made.nominal,
                augmented=made.augmented,
                gap=made.gap,
            )
    if found.task.epoch is None:
        return found
    unseen = [_full_rate(r, campaign) for r in found.task.data.unseen]
    gaps = [gap_on(finer, record, rules) for record in reversed(unseen)]
    return with_changes(found, [g.gap for g in gaps if g is not None])


def _in_loop(found: Found, campaign: Campaign, fmu: FmuFile) -> Found:
    """With the held-out log's experiment run again, its controller in the loop."""
    record = _full_rate(_held(found), campaign)
    held, began = campaign.logs[record.name], time.perf_counter()
    closed: Mapping[str, float] | None = None
    d, notes = found.diagnosis, []
    try:
        values = {**found.task.plant.parameters, **values_on(found.decision.best, record)}
        closed = rerun(fmu, held, values)
    except (RunError, ValueError) as error:
        notes.append(f"the closed loop could not be run again: {error}")
    claimed = {p for c in d.causes if c.key in found.decision.chosen for p in c.parameters}
    if closed and (without := [n for n in left_out(found.values) if n in claimed]):
        notes.append(f"the closed loop was run again without {', '.join(without)}")
    stages = {**d.stages, "closed loop": time.perf_counter() - began}
    return _with(found, replace(d, closed_loop=closed, notes=(*d.notes, *notes), stages=stages))


# ---- coarse converters


def _coarse_notes(quanta: Mapping[str, float]) -> tuple[str, ...]:
    return tuple(
        f"{c} is read on a grid of {q:.3g} {COLUMNS[c].unit}: a coarse converter"
        for c, q in quanta.items()
    )


def _coarser(plant: Plant, quanta: Mapping[str, float]) -> Plant:
    """A plant whose signals have a grid's error beside their noise: RMS of q/sqrt(12)."""
    steps = {s.name: quanta.get(s.name, 0.0) for s in plant.signals}
    signals = (
        replace(s, sigma=math.hypot(s.sigma, steps[s.name] / math.sqrt(12)), step=steps[s.name])
        for s in plant.signals
    )
    return replace(plant, signals=tuple(signals))


def _coarse(d: Diagnosis, quanta: Mapping[str, float]) -> Diagnosis:
    """The answer with what the readings themselves show."""
    if not quanta:
        return d
    steps = {
        f"step_{c}": Size(float(q), float(q), float(q), COLUMNS[c].unit, "grid")
        for c, q in quanta.items()
    }
    seen = Cause(QUANTISATION.name, QUANTISATION.axis, SEEN, steps)
    others = tuple(c for c in d.causes if c.key != seen.key)
    sets = tuple(_joined(keys) for keys in d.answer_set)
    return replace(
        d,
        verdict="identified" if d.verdict == "none" else d.verdict,
        where=_shared(d.where, quanta, alone=d.verdict == "none"),
        causes=(*others[:1], seen, *others[1:]) if d.verdict == "identified" else (seen, *others),
        answer_set=sets,
        probabilities={**d.probabilities, "none": 0.0},
    )


def _joined(keys: Sequence[str]) -> tuple[str, ...]:
    known = [k for k in keys if k != UNKNOWN]
    return (*known, QUANTISATION.key, *(k for k in keys if k == UNKNOWN))


def _shared(places: Sequence[Place], quanta: Mapping[str, float], alone: bool) -> tuple[Place, ...]:
    """The sensors have all of what is seen alone, else half as much as all other blocks."""
    before: Any = next((p for p in places if p.block == QUANTISATION.block), None)
    share = 1.0 if alone else max(1 / 3, before.share if before else 0.0)
    regime = f"readings of {', '.join(quanta)}"
    mine = Place(QUANTISATION.block, share, (), regime, 0.0, 0.0)
    rest = [] if alone else [p for p in places if p.block != QUANTISATION.block]
    total = sum(p.share for p in rest)
    others = [replace(p, share=p.share / total * (1 - share)) for p in rest] if total else []
    if not others:
        mine = replace(mine, share=1.0)
    return tuple(sorted((mine, *others), key=lambda p: -p.share))
