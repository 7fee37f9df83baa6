"""Before anything is fitted: which effects these sensors and records can see and tell apart, and
which record or sensor more would add most.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from modelica_fmu.errors import InputError, RunError
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.hypotheses.catalogue import Effect
from pneugantry.engine.planning.information import (
    Information,
    Sight,
    Size,
    gather,
    score,
    sights,
    sizes,
)
from pneugantry.engine.plant import Plant, Record, Signal
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.build import build_views, view_beside
from pneugantry.engine.views.cuts import sharp_views
from pneugantry.engine.views.subsystem import SubsystemView
from pneugantry.engine.views.synthetic import Nominal, noisy
from pneugantry.engine.views.view import View

__all__ = ["Addition", "Case", "Experiment", "Plan", "make_plan", "without"]

Say = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Experiment:
    """A record that could be taken; signals may be empty: they are simulated."""

    what: str
    record: Record
    scenario: str = ""  # TOML, where a command can run it


@dataclass(frozen=True, eq=False)
class Case:
    """What a plan is made of."""

    plant: Plant
    records: tuple[Record, ...]  # signals that are missing are simulated
    catalogue: Mapping[str, Effect]
    rules: Rules
    cache: Path  # of the parts
    others: tuple[View, ...] = ()  # views that no model gives
    experiments: tuple[Experiment, ...] = ()
    sensors: tuple[Signal, ...] = ()  # that could be added; sigma 0: of a usual sensor
    notes: tuple[str, ...] = ()
    sharp: bool = False  # cut where measured well enough (`sharp_views`), as the plant's diagnosis


@dataclass(frozen=True)
class Addition:
    """What a record or sensor adds, or a record that is there would take away."""

    what: str
    effects: float  # more effects told from all else, those told in part counting in part
    shows: tuple[str, ...]  # effects that are seen with it alone
    parts: tuple[str, ...]  # seen effects that are told from all others with it alone
    finer: float  # factor by which the smallest sizes that are told shrink, geometric mean
    scenario: str = ""
    sigma: float = 0.0  # of a sensor


@dataclass(frozen=True, eq=False)
class Plan:
    """What records can tell, and what would add."""

    case: Case
    sizes: Mapping[str, Size]
    sights: tuple[Sight, ...]
    unread: tuple[str, ...]  # effects that touch no view
    score: float
    logs: tuple[Addition, ...]  # what each record that is there adds to the rest
    experiments: tuple[Addition, ...]
    sensors: tuple[Addition, ...]
    notes: tuple[str, ...] = field(default=())


def without(case: Case, names: Sequence[str]) -> Case:
    """The case as if some signals were not measured; they are then among the sensors that could be
    added. Raises InputError for a name that is no signal.
    """
    known = {s.name for s in case.plant.signals}
    for name in names:
        if name not in known:
            hint = f"use some of {', '.join(sorted(known))}"
            raise InputError("is no measured signal", field=name, hint=hint)
    left = tuple(s for s in case.plant.signals if s.name not in names)
    if not left:
        raise InputError("no signal is left", field=", ".join(names), hint="leave one at least")
    gone = tuple(s for s in case.plant.signals if s.name in names)
    return replace(case, plant=replace(case.plant, signals=left), sensors=(*gone, *case.sensors))


LEAST = 1e-3  # standard deviations below which nothing is told at all
SENSOR = 1e-3  # noise of a sensor that could be added, share of its range (field: a usual one)


def make_plan(case: Case, say: Say = lambda _: None) -> Plan:
    """Raises InputError for names that the model lacks, RunError where no record can be used."""
    notes = list(case.notes)
    say("simulate what is missing")
    records, experiments = _completed(case, notes)
    if not records:
        raise RunError("the nominal model can be simulated over none of the records")
    say("views")
    everything = (*records, *(e.record for e in experiments))
    views: list[View] = [*_views(case, records), *case.others]
    fitter = Fitter(case.plant, views, everything, case.rules)
    try:
        say("effects")
        readable = {
            k: e for k, e in case.catalogue.items() if fitter.coordinates.readable(e.forms[0])
        }
        information = gather(fitter, readable, partial(noisy, case.plant))
        usual = sizes(fitter, case.catalogue)
    finally:
        fitter.close()
    names = [r.name for r in records]
    notes += [f"{k}: no run at its usual size came to an end" for k in sorted(information.failed)]
    say("sensors")
    told = tuple(sights(information, names))
    return Plan(
        case,
        usual,
        told,
        tuple(k for k in case.catalogue if k not in readable),
        score(told),
        _logs(information, names),
        _experiments(information, names, experiments),
        _ranked(_sensors(case, records, notes)),
        tuple(notes),
    )


def _views(case: Case, records: Sequence[Record]) -> list[SubsystemView]:
    rules, measured = case.rules, [s.name for s in case.plant.signals]
    if case.sharp:
        return sharp_views(case.plant, measured, case.cache, records, rules)
    return build_views(case.plant, measured, case.cache, records[0].period, rules)


def _completed(case: Case, notes: list[str]) -> tuple[list[Record], list[Experiment]]:
    """Records and experiments with all signals."""
    wanted = {s.name for s in case.plant.signals}
    complete = [wanted <= set(e.signals) for e in case.records]
    complete += [wanted <= set(e.record.signals) for e in case.experiments]
    if all(complete):
        return list(case.records), list(case.experiments)
    nominal = Nominal(case.plant, [s.variable for s in case.plant.signals], case.cache)
    records = [r for r in (_whole(nominal, r, wanted, notes) for r in case.records) if r]
    experiments = [
        replace(e, record=record)
        for e in case.experiments
        if (record := _whole(nominal, e.record, wanted, notes)) is not None
    ]
    return records, experiments


def _whole(
    nominal: Nominal, record: Record, wanted: Iterable[str], notes: list[str]
) -> Record | None:
    if set(wanted) <= set(record.signals):
        return record
    try:
        return nominal.record(record, record.signals)
    except RunError as error:
        notes.append(f"{error}; left out")
        return None


# ---- what would add


def _addition(what: str, before: Sequence[Sight], after: Sequence[Sight]) -> Addition:
    """What lies between two states of knowledge."""
    old = {s.effect: s for s in before}
    known = [s for s in after if s.effect in old]
    ratios = [max(s.told, LEAST) / max(old[s.effect].told, LEAST) for s in known]
    return Addition(
        what,
        score(after) - score(before),
        tuple(
            s.effect for s in after if s.visible and not (s.effect in old and old[s.effect].visible)
        ),
        tuple(
            s.effect
            for s in after
            if _resolved(s) and not (s.effect in old and _resolved(old[s.effect]))
        ),
        float(np.exp(np.mean(np.log(ratios)))) if ratios else 1.0,
    )


def _resolved(sight: Sight) -> bool:
    return sight.visible and not sight.rivals


def _logs(information: Information, names: Sequence[str]) -> tuple[Addition, ...]:
    whole = sights(information, names)
    return _ranked(
        _addition(name, sights(information, [n for n in names if n != name]), whole)
        for name in names
    )


def _experiments(
    information: Information, names: Sequence[str], experiments: Sequence[Experiment]
) -> tuple[Addition, ...]:
    before = sights(information, names)
    return _ranked(
        replace(
            _addition(e.what, before, sights(information, [*names, e.record.name])),
            scenario=e.scenario,
        )
        for e in experiments
    )


def _ranked(additions: Iterable[Addition]) -> tuple[Addition, ...]:
    """By what they add; what adds no effect by how much finer it makes the rest."""
    return tuple(sorted(additions, key=lambda a: (-round(a.effects, 2), -a.finer)))


def _sensors(case: Case, records: Sequence[Record], notes: list[str]) -> list[Addition]:
    """What each sensor that could be added brings: nominal records with and without its view,
    beside the views that are there.
    """
    if not case.sensors:
        return []
    variables = [s.variable for s in (*case.plant.signals, *case.sensors)]
    nominal = Nominal(case.plant, variables, case.cache)
    plain, extra = [], []
    for record in records:
        try:
            found = nominal.run(record)
        except RunError as error:
            notes.append(f"{error}; left out where sensors are compared")
            continue
        signals = {s.name: found[s.variable] for s in case.plant.signals}
        plain.append(replace(record, signals=signals, judged=None))
        extra.append({s.name: found[s.variable] for s in case.sensors})
    if not plain:
        return []
    views = _views(case, plain)
    before = sights(_informed(case, case.plant, views, plain))
    made = []
    for sensor in case.sensors:
        span = max(float(np.ptp(e[sensor.name])) for e in extra)
        if span < 1e-9:
            continue
        sensor = replace(sensor, sigma=sensor.sigma or SENSOR * span)
        plant = replace(case.plant, signals=(*case.plant.signals, sensor))
        records = [
            replace(r, signals={**r.signals, sensor.name: e[sensor.name]})
            for r, e in zip(plain, extra, strict=True)
        ]
        own = view_beside(plant, sensor.name, case.cache, views[0])
        after = sights(_informed(case, plant, [*views, own], records))
        made.append(replace(_addition(sensor.name, before, after), sigma=sensor.sigma))
    return made


def _informed(
    case: Case, plant: Plant, views: Sequence[View], records: Sequence[Record]
) -> Information:
    fitter = Fitter(plant, [*views, *case.others], records, case.rules)
    try:
        effects = {
            k: e for k, e in case.catalogue.items() if fitter.coordinates.readable(e.forms[0])
        }
        return gather(fitter, effects, partial(noisy, plant))
    finally:
        fitter.close()
