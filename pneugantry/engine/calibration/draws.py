"""Rigs drawn from a plant's own model, whose truth is known: what a calibration rests on.

A rig has the plant's tolerance, what differs from record to record, noise, and nothing else, one or
two effects of the catalogue, or a discrepancy that no catalogue holds: a random smooth function of
a random signal or of time, in a random input or a random sensor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from modelica_fmu.errors import RunError
from pneugantry.engine.answer.confirm import Replay, replays
from pneugantry.engine.hypotheses.catalogue import Effect, Form
from pneugantry.engine.hypotheses.hypothesis import effect_coordinate, nuisance_coordinate
from pneugantry.engine.plant import Array, Data, Nuisance, Plant, Record
from pneugantry.engine.signals.commands import outside
from pneugantry.engine.signals.converter import Grid
from pneugantry.engine.signals.sensors import neutral

__all__ = ["KINDS", "Drawn", "Source", "drawn"]

KINDS = {"none": 0.25, "one": 0.35, "two": 0.1, "unknown": 0.2, "both": 0.1}  # shares
EFFECTS = {"one": 1, "two": 2, "both": 1}  # of the catalogue
SIZES = (0.5, 2.0)  # of an effect, in usual sizes
STARTS = 0.2  # spread of the logarithm of a listed start
VISIBLE = (2.0, 40.0)  # RMS change of the most changed signal that a cause makes, in its sigma
NOISE = 0.1  # spread of the logarithm of a sensor's noise
TOLERANCE = 0.4  # spread of the logarithm of a rig's tolerance
WAVES = 3  # sines that make up a random function
ROUNDS = 3  # simulations after which a discrepancy follows from the signals that it makes
TRIES = 30  # draws of a cause until it shows


@dataclass(frozen=True, eq=False)
class Source:
    """What rigs are drawn from: the plant, its inputs in `data`, and what may be wrong with it."""

    plant: Plant
    data: Data
    catalogue: Mapping[str, Effect]
    defaults: Mapping[str, float]  # of the model's parameters
    cache: Path


@dataclass(frozen=True, eq=False)
class Drawn:
    """A rig's records and its truth."""

    data: Data
    kind: str  # one of KINDS
    effects: tuple[str, ...]  # of the catalogue
    what: str  # of the discrepancy that the catalogue lacks


@dataclass(frozen=True, eq=False)
class _Cause:
    """Values that an effect sets, and what a discrepancy adds to an input or a reading."""

    values: Mapping[str, float]
    odd: _Odd | None = None


@dataclass(frozen=True, eq=False)
class _Odd:
    """A smooth random function: of a signal or of time, into an input or a sensor."""

    into: str
    an_input: bool
    of: str  # signal, or "" for time
    size: float  # RMS, in the target's unit
    waves: Array  # (WAVES, 3): periods over the argument's range, phase, weight

    def __str__(self) -> str:
        return f"{self.into} errs by a function of {self.of or 'time'}"

    def added(self, argument: Array) -> Array:
        """(N,) from the argument (N,)."""
        ends = np.percentile(argument, [2, 98])
        at = (argument - ends[0]) / max(float(ends[1] - ends[0]), 1e-12)
        raw = sum(w * np.sin(2 * np.pi * n * np.clip(at, 0, 1) + p) for n, p, w in self.waves)
        raw = raw - np.mean(raw)
        return np.asarray(self.size * raw / max(float(np.std(raw)), 1e-12))


def drawn(source: Source, seed: int) -> Drawn:
    """The rig of a seed. Raises RunError where nothing that was drawn could be simulated."""
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    rig = _tolerance(source, rng)
    effects: list[Effect] = []
    causes: list[_Cause] = []
    for _ in range(EFFECTS.get(kind, 0)):
        effect, cause = _effect(source, rig, effects, rng)
        effects.append(effect)
        causes.append(cause)
    if kind in ("unknown", "both"):
        causes.append(_discrepancy(source, rig, rng))
    values = {k: v for c in causes for k, v in c.values.items()}
    odd = next((c.odd for c in causes if c.odd is not None), None)
    white = {s.name: s.white * float(np.exp(NOISE * rng.normal())) for s in source.plant.signals}
    records = [
        _measured(source, r, {**rig[r.name], **values}, odd, white, rng)
        for r in _records(source.data)
    ]
    held = records.pop() if source.data.held_out is not None else None
    said = str(odd) if odd else ""
    return Drawn(Data(tuple(records), held), kind, tuple(e.key for e in effects), said)


def _records(data: Data) -> list[Record]:
    return [*data.fitted, *([data.held_out] if data.held_out is not None else [])]


Rig = Mapping[str, Mapping[str, float]]  # by record


def _tolerance(source: Source, rng: np.random.Generator) -> Rig:
    """What a rig has somewhat off."""
    scale = float(np.exp(TOLERANCE * rng.normal()))
    rig: dict[str, dict[str, float]] = {r.name: {} for r in _records(source.data)}
    for n in source.plant.nuisances:
        shared = rng.normal()
        for record in _records(source.data):
            theta = (rng.normal() if n.per_record else shared) * (scale if n.scales else 1.0)
            rig[record.name][n.parameter] = _off(source, n, record, theta)
    return rig


def _off(source: Source, n: Nuisance, record: Record, theta: float) -> float:
    at = record.parameters.get(n.parameter, _nominal(source, n.parameter))
    return nuisance_coordinate(n, at, None).value(theta)


def _nominal(source: Source, name: str) -> float:
    if outside(name):
        return neutral(name)
    return source.plant.parameters.get(name, source.defaults.get(name, 0.0))


def _effect(
    source: Source, rig: Rig, others: Sequence[Effect], rng: np.random.Generator
) -> tuple[Effect, _Cause]:
    """An effect in one of its forms, of a size that shows: the plant's, or one of a sensor or an
    input, at evens.
    """
    rest = [e for e in source.catalogue.values() if e not in others]
    sensors = [e for e in rest if e.outside]
    own = [e for e in rest if e not in sensors]
    for _ in range(TRIES):
        among = own if own and (rng.random() < 0.5 or not sensors) else sensors
        effect = among[rng.integers(len(among))]
        form = effect.forms[rng.integers(len(effect.forms))]
        cause = _Cause({**form.settings, **_sizes(source, form, rng)})
        if VISIBLE[0] <= _shown(source, rig, cause) <= VISIBLE[1]:
            return effect, cause
    raise RunError("no effect of the catalogue shows in these logs at its usual size")


def _sizes(source: Source, form: Form, rng: np.random.Generator) -> dict[str, float]:
    found = {}
    for p in form.parameters:
        c = effect_coordinate(p, _nominal(source, p.name), 1.0)
        if p.starts:
            start = float(rng.choice(p.starts)) * float(np.exp(STARTS * rng.normal()))
            start *= abs(_nominal(source, p.name)) if p.relative else 1.0
            found[p.name] = c.value(c.theta(start))
        else:
            found[p.name] = c.value(float(rng.choice([-1, 1]) * rng.uniform(*SIZES)))
    return found


def _discrepancy(source: Source, rig: Rig, rng: np.random.Generator) -> _Cause:
    """A random function somewhere, of a size that shows; its signals are those that all records
    have.
    """
    inputs = [n for n in source.plant.inputs if _swing(source, n) > 0]
    known = [r.signals for r in _records(source.data)]
    signals = [s.name for s in source.plant.signals if all(s.name in own for own in known)]
    for _ in range(TRIES if inputs or signals else 0):
        an_input = bool(inputs) and (rng.random() < 0.7 or not signals)
        into = str(rng.choice(inputs if an_input else signals))
        of = str(rng.choice([*(s for s in signals if an_input or s != into), ""]))
        waves = np.column_stack(
            [rng.uniform(0.3, 2.5, WAVES), rng.uniform(0, 2 * np.pi, WAVES), rng.normal(size=WAVES)]
        )
        size = _swing(source, into) * float(np.exp(rng.uniform(np.log(0.003), np.log(0.3))))
        cause = _Cause({}, _Odd(into, an_input, of, size, waves))
        if VISIBLE[0] <= _shown(source, rig, cause) <= VISIBLE[1]:
            return cause
    raise RunError("no discrepancy that was drawn shows in these logs")


def _swing(source: Source, name: str) -> float:
    """RMS of an input or a signal about its mean, over all records."""
    values = [
        np.asarray(r.inputs.get(name, r.signals.get(name, np.zeros(1))))
        for r in _records(source.data)
    ]
    return float(np.sqrt(np.mean(np.concatenate([(v - v.mean()) ** 2 for v in values]))))


def _shown(source: Source, rig: Rig, cause: _Cause) -> float:
    """RMS change of the signal that a cause changes most, in its sigma; infinite where the model
    stops.
    """
    largest = 0.0
    for record in source.data.fitted:
        own = rig[record.name]
        plain = _run(source, record, own, None)
        changed = _run(source, record, {**own, **cause.values}, cause.odd)
        if plain is None or changed is None:
            return np.inf
        change = (changed.simulated - plain.simulated) / plain.sigma
        largest = max(largest, float(np.sqrt((change**2).mean(axis=0)).max()))
    return largest


def _run(
    source: Source, record: Record, values: Mapping[str, float], odd: _Odd | None
) -> Replay | None:
    """Readings without noise under a record's inputs; None where the model stops."""
    found = replays(source.plant, record, [values], source.cache)[0]
    if odd is None or found is None:
        return found
    for _ in range(ROUNDS if odd.an_input else 1):
        said = dict(zip(found.signals, found.simulated.T, strict=True))
        argument = np.arange(record.rows, dtype=np.float64) * record.period
        argument = np.asarray(said[odd.of] if odd.of else argument, dtype=np.float64)
        if not odd.an_input:
            column = found.signals.index(odd.into)
            simulated = found.simulated.copy()
            simulated[:, column] += odd.added(argument)
            return replace(found, simulated=simulated)
        driven = record.moved(odd.into, odd.added(argument))
        found = replays(source.plant, driven, [values], source.cache)[0]
        if found is None:
            return None
    return found


def _measured(
    source: Source,
    record: Record,
    values: Mapping[str, float],
    odd: _Odd | None,
    white: Mapping[str, float],
    rng: np.random.Generator,
) -> Record:
    """The record as the sensors of a rig with these values say it, under noise of these RMS and
    through their converters.
    """
    found = _run(source, record, values, odd)
    if found is None:
        raise RunError(f"{record.name}: the model stops under the values that were drawn")
    noise = rng.standard_normal(found.simulated.shape) * [white[n] for n in found.signals]
    said = found.simulated + noise
    signals = {n: said[:, i] for i, n in enumerate(found.signals)}
    for s in source.plant.signals:
        if s.step and s.name in signals:
            signals[s.name] = Grid(0.0, s.step).nearest(signals[s.name])
    return replace(record, signals={**record.signals, **signals}, judged=None)
