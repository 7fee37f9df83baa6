"""Two campaigns of one rig, before and after a change: which effect came, which went, which stayed.

All records are evidence on one rig: its tolerance and its nuisances are shared. Every effect of the
catalogue stands there three times: in all records, in those before alone, in those after alone. The
parameters of an effect of one campaign are named "after:axis.mass". Only the views of that
campaign's records read them: what they differ by from their neutral value is added to the shared
one's. Search and decision know nothing of this: to them such an effect is one more effect, and a
view of one campaign one more view.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from modelica_fmu.errors import RunError
from pneugantry.engine.answer.confirm import (
    Gap,
    Replay,
    draws,
    floor_of,
    gap_of,
    noise_levels,
    replays,
    values_on,
)
from pneugantry.engine.answer.result import NORMAL, Answer, Change, Changes, Moved
from pneugantry.engine.chances import Chances
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.hypotheses.catalogue import Effect, Form
from pneugantry.engine.plant import Array, Data, Epoch, Nuisance, Plant, Record, Signal
from pneugantry.engine.recent import Recent
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found
from pneugantry.engine.signals.commands import outside
from pneugantry.engine.signals.sensors import neutral as neutral_of_sensor
from pneugantry.engine.task import Task
from pneugantry.engine.views.view import Run, View

__all__ = ["AFTER", "BEFORE", "EpochView", "changes_of", "gap_on", "joined", "with_changes"]

BEFORE, AFTER = "before", "after"
KEPT = 64  # records of a view that are kept under their campaign's names


class EpochView:
    """A view of one campaign's records."""

    def __init__(self, view: View, epoch: Epoch) -> None:
        self.view, self.epoch = view, epoch
        self.name, self.blocks = f"{view.name}@{epoch.name}", view.blocks
        self.signals, self.sigmas, self.decimation = view.signals, view.sigmas, view.decimation
        self.remembers = view.remembers
        own = {epoch.own(p): v for p, v in epoch.neutral.items()}
        self.defaults: Mapping[str, float] = {**view.defaults, **own}
        self._inner: Recent[Record] = Recent(KEPT)

    def shows(self, record: Record) -> bool:
        return record.epoch is self.epoch and self.view.shows(self._inside(record))

    def depends_on(self, parameter: str) -> bool:
        known = self.epoch.known(parameter)
        return known is not None and self.view.depends_on(known)

    def prepare(self, moving: Collection[str], settings: Mapping[str, float]) -> None:
        own = {self.epoch.known(n): n for n in moving}
        kept = {self.epoch.known(n): v for n, v in settings.items()}
        self.view.prepare(
            [n for n in own if n is not None], {n: v for n, v in kept.items() if n is not None}
        )

    def residuals(self, runs: Sequence[Run]) -> list[Array]:
        records = {r.name: self._inside(r) for r, _ in runs}
        return self.view.residuals([(records[r.name], r.read(given)) for r, given in runs])

    def _inside(self, record: Record) -> Record:
        """Under the name that the campaign has for it; the same one each time, for a view keeps by
        the record what it makes of it.
        """
        name = record.name.removeprefix(f"{self.epoch.name}/")
        return self._inner.of(record, lambda: replace(record, name=name))


def joined(before: Task, after: Task) -> Task:
    """One task of two, of the same plant; `before` tells plant, catalogue and chances."""
    plant, catalogue = _plant(before.plant, after.plant), before.catalogue
    settings = frozenset(n for e in catalogue.values() for f in e.forms for n in f.settings)
    neutral = _neutral(plant, (*before.views, *after.views), catalogue)
    tasks = {n: (t, Epoch(n, neutral, settings)) for n, t in ((BEFORE, before), (AFTER, after))}
    data = [_of_epoch(t.data, epoch) for t, epoch in tasks.values()]
    held = [d.held_out for d in data if d.held_out is not None]
    return replace(
        before,
        plant=plant,
        views=[EpochView(v, epoch) for t, epoch in tasks.values() for v in t.views],
        data=Data(
            (*data[0].fitted, *data[1].fitted),
            held[-1] if held else None,
            tuple(held[:-1]),
        ),
        catalogue={e.key: e for effect in catalogue.values() for e in _variants(effect)},
        chances=_chances(before.chances),
        notes=_said(before.notes, after.notes),
        limits=_said(before.limits, after.limits),
        epoch=tasks[AFTER][1],
    )


def _plant(before: Plant, after: Plant) -> Plant:
    """With what either campaign measures, and may have off."""
    later = {s.name: s for s in after.signals}
    signals = later | {s.name: _rougher(s, later.get(s.name, s)) for s in before.signals}
    known = {n.parameter: n for n in after.nuisances}
    nuisances = known | {
        n.parameter: _wider(n, known.get(n.parameter, n)) for n in before.nuisances
    }
    return replace(before, signals=tuple(signals.values()), nuisances=tuple(nuisances.values()))


def _rougher(before: Signal, after: Signal) -> Signal:
    """A signal with the larger noise and the coarser converter of two campaigns."""
    worse = max(before, after, key=lambda s: s.error)
    return replace(
        before,
        sigma=max(before.sigma, after.sigma),
        step=max(before.step, after.step),
        error=worse.error,
        lasting=worse.lasting,
    )


def _wider(before: Nuisance, after: Nuisance) -> Nuisance:
    """What a sensor may have off in either campaign; the model's tolerance is that of the first."""
    return after if outside(after.parameter) and after.sigma > before.sigma else before


def _neutral(
    plant: Plant, views: Sequence[View], catalogue: Mapping[str, Effect]
) -> dict[str, float]:
    """Values of the effects' parameters without any effect."""
    known: dict[str, float] = {}
    for view in views:
        known |= view.defaults
    known |= plant.parameters
    names = {p.name for e in catalogue.values() for f in e.forms for p in f.parameters}
    return {n: neutral_of_sensor(n) if outside(n) else known.get(n, 0.0) for n in names}


def _said(before: Sequence[str], after: Sequence[str]) -> tuple[str, ...]:
    """What is said of both campaigns once, and of one with its name."""
    both = [text for text in before if text in after]
    own = [f"{BEFORE}: {text}" for text in before if text not in both]
    return (*both, *own, *(f"{AFTER}: {text}" for text in after if text not in both))


def _of_epoch(data: Data, epoch: Epoch) -> Data:
    def moved(record: Record) -> Record:
        return replace(record, name=f"{epoch.name}/{record.name}", epoch=epoch)

    held = None if data.held_out is None else moved(data.held_out)
    return Data(tuple(moved(r) for r in data.fitted), held)


def _variants(effect: Effect) -> list[Effect]:
    """An effect in all records, and in those of one campaign alone."""
    return [effect, *(replace(effect, epoch=e, forms=_forms(effect, e)) for e in (BEFORE, AFTER))]


def _forms(effect: Effect, epoch: str) -> tuple[Form, ...]:
    at = Epoch(epoch, {}, frozenset())
    return tuple(
        replace(
            form,
            parameters=tuple(replace(p, name=at.own(p.name)) for p in form.parameters),
            settings={at.own(n): v for n, v in form.settings.items()},
        )
        for form in effect.forms
    )


def _chances(chances: Chances) -> Chances:
    """A channel of either campaign is as far off on a sound rig as that of one."""
    if chances.usual is None:
        return chances
    usual = {
        (f"{view}@{epoch}", signal): ratio
        for (view, signal), ratio in chances.usual.items()
        for epoch in (BEFORE, AFTER)
    }
    return replace(chances, usual=usual)


# ---- the answer


@dataclass(frozen=True, eq=False)
class ReplayedRecord:
    """A record replayed without effects and with the answer's, and the gap of both."""

    nominal: Replay
    augmented: Replay
    gap: Gap


def gap_on(found: Found, record: Record, rules: Rules) -> ReplayedRecord | None:
    """The gap of a record under the answer; None where the model stops or is not replayed."""
    plant, best = found.task.plant, found.decision.best
    own = [{}, values_on(best, record), *draws(best, record, unseen=found.unseen)]
    try:
        nominal, augmented, *others = replays(plant, record, own, found.task.cache)
    except RunError:
        return None
    if nominal is None or augmented is None:
        return None
    floor = floor_of(noise_levels(plant, record, rules))
    gap = gap_of(nominal, augmented, rules, record.period, floor=floor, others=others)
    return ReplayedRecord(nominal, augmented, gap)


def with_changes(found: Found, gaps: Sequence[Gap]) -> Found:
    """With what changed between the campaigns. gaps: of each one's record that no fit saw."""
    changes = replace(changes_of(found), gaps=tuple(gaps))
    return replace(found, diagnosis=replace(found.diagnosis, changes=changes))


@dataclass(frozen=True)
class _State:
    """In which of an effect's three places a hypothesis has it."""

    both: bool
    before: bool
    after: bool

    @property
    def word(self) -> str:
        if self.both or (self.before and self.after):
            return "changed" if self.before or self.after else "stayed"
        return "went" if self.before else "came" if self.after else "absent"


def changes_of(found: Found) -> Changes:
    """What came, went, stayed and changed, with probabilities and sizes, likeliest first."""
    variants: dict[str, dict[str, str]] = {}
    for key, effect in found.task.catalogue.items():
        variants.setdefault(replace(effect, epoch="").key, {})[effect.epoch] = key
    made = [_change(found, base, keys) for base, keys in variants.items()]
    told = [c for c in made if c is not None]
    return Changes(tuple(sorted(told, key=lambda c: c.probabilities["absent"])))


def _change(found: Found, base: str, keys: Mapping[str, str]) -> Change | None:
    """None where no hypothesis that is worth telling has the effect."""
    chances = dict.fromkeys(("came", "went", "stayed", "changed", "absent"), 0.0)
    for answer in found.decision.answers:
        chances[_state(answer, keys).word] += answer.probability
    if chances["absent"] > 1 - RARE:
        return None
    likeliest = max((w for w in chances if w != "absent"), key=lambda w: chances[w])
    best = found.decision.best.tempered(found.task.chances.temper)
    claimed = any(k in best.keys for k in keys.values())
    effect = found.task.catalogue[base]
    moved = _moved(found, best, keys) if claimed else {}
    return Change(effect.name, effect.axis, likeliest, chances, moved)


RARE = 0.005  # probability below which an effect is not told of


def _state(answer: Answer, keys: Mapping[str, str]) -> _State:
    return _State(*(keys[epoch] in answer.keys for epoch in ("", BEFORE, AFTER)))


def _moved(found: Found, fit: Fit, keys: Mapping[str, str]) -> dict[str, Moved]:
    """Values of an effect's parameters before and after, as a fit has them, and their change."""
    epoch = found.task.epoch
    assert epoch is not None
    first = {r.epoch.name: r for r in found.task.data.fitted if r.epoch is not None}
    at = {e: first[e].read(fit.values(first[e].name)) for e in (BEFORE, AFTER)}
    moved: dict[str, Moved] = {}
    for form in (f for e, f in fit.hypothesis.effects if e.key in keys.values()):
        for p in form.parameters:
            name = Epoch.bare(p.name)
            neutral, width = epoch.neutral.get(name, 0.0), NORMAL * _spread(fit, name)
            before, after = (at[e].get(name, neutral) for e in (BEFORE, AFTER))
            change = after - before
            ends = change - width, change + width
            moved[name] = Moved(before, after, change, *ends, p.unit)
    return moved


def _spread(fit: Fit, name: str) -> float:
    """Standard deviation of a parameter's change, of the coordinates that make it."""
    slope = np.zeros(len(fit.point.coordinates))
    for i, (c, theta) in enumerate(zip(fit.point.coordinates, fit.point.theta, strict=True)):
        if c.parameter != name and Epoch.bare(c.parameter) == name:
            sign = 1.0 if c.parameter.startswith(AFTER) else -1.0
            slope[i] = sign * (c.unit * c.value(theta) if c.logarithmic else c.unit)
    return float(np.sqrt(max(float(slope @ fit.covariance @ slope), 0.0)))
