"""Views of a plant: one for each measured signal, cut at the others."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from modelica_fmu.batch import Part
from modelica_fmu.compiled import Structure
from modelica_fmu.errors import InputError
from pneugantry.engine.plant import Plant, Signal
from pneugantry.engine.rules import Rules
from pneugantry.engine.signals.readings import Filtered
from pneugantry.engine.threads import on_threads
from pneugantry.engine.views.model_parts import part_of, structure_of
from pneugantry.engine.views.subsystem import RATE, SubsystemView

__all__ = ["Measured", "build_views", "view_beside"]


@dataclass(frozen=True, eq=False)
class Measured:
    """What records hold of the signals, beside their names. coarse: signals that a signal's view
    does not take as known, for they are measured too coarsely. held: signals of each record; those
    share no view that some record holds one of without the other.
    """

    coarse: Mapping[str, frozenset[str]] = field(default_factory=dict)
    held: Sequence[Collection[str]] = ()


@dataclass(frozen=True, eq=False)
class _Sight:
    """What is measured of a plant, and how that hangs together."""

    plant: Plant
    shape: Structure
    signals: Mapping[str, Signal]  # measured, by name
    cache: Path
    coarse: Mapping[str, frozenset[str]] = field(default_factory=dict)  # see `Measured`
    readings: Filtered = field(default_factory=Filtered)

    def root(self, signal: str) -> str:
        return self.shape.roots[self.signals[signal].variable]

    @property
    def pairs(self) -> dict[str, str]:
        """Position -> its speed, where both are measured."""
        return {
            a: b
            for a in self.signals
            for b in self.signals
            if self.root(a) in self.shape.states
            and self.shape.rates.get(self.root(a)) == self.root(b)
        }


def build_views(
    plant: Plant,
    measured: Sequence[str],
    cache: Path,
    period: float,
    rules: Rules,
    known: Measured | None = None,
) -> list[SubsystemView]:
    """One view for each measured signal; signals that the same part computes share one.

    period: s, between a record's rows. Raises InputError for a signal whose variable the model
    lacks.
    """
    known = known or Measured()
    shape = structure_of(plant, cache)
    signals = {s.name: s for s in plant.signals if s.name in measured}
    for signal in signals.values():
        if signal.variable not in shape.roots:
            raise InputError(
                f"{plant.class_name} has no variable of that name that changes with time",
                file=plant.model,
                field=signal.variable,
                hint=f"correct the variable of the signal {signal.name}",
            )
    sight = _Sight(plant, shape, signals, cache, known.coarse)
    decimation = max(1, round(1 / (rules.band * period)))
    grouped: dict[tuple[object, ...], list[str]] = {}
    for name, own in zip(signals, on_threads(lambda n: _cut(sight, [n]), signals), strict=True):
        where = tuple(name in held for held in known.held)
        grouped.setdefault((where, _same(*own)), []).append(name)
    return on_threads(lambda n: _view(sight, n, decimation, rules.observer), grouped.values())


def view_beside(plant: Plant, signal: str, cache: Path, like: SubsystemView) -> SubsystemView:
    """The view of one more signal, cut at all others of the plant, with another view's timing."""
    sight = _Sight(plant, structure_of(plant, cache), {s.name: s for s in plant.signals}, cache)
    return _view(sight, [signal], like.decimation, like.observer)


def _view(sight: _Sight, names: Sequence[str], decimation: int, observer: float) -> SubsystemView:
    """The view of signals that one part computes."""
    part, sources, corrected = _cut(sight, names)
    return SubsystemView(
        name=sight.root(names[0]),
        signals=tuple(names),
        blocks=tuple(_block(sight.plant, sight.root(n)) for n in names),
        sigmas=tuple(sight.signals[n].averaged(decimation) for n in names),
        decimation=decimation,
        plant=sight.plant,
        part=part,
        sources=sources,
        corrected=corrected,
        pairs=sight.pairs,
        observer=observer,
        cut_at=tuple(sorted(_known(sight, names))),
        readings=sight.readings,
    )


def _known(sight: _Sight, own: Sequence[str]) -> dict[str, str]:
    """Variables known to a view of the signals `own`: other signals, and rates of those that are
    states; but no state whose rate is one of `own`: it follows from it.
    """
    rates, roots = sight.shape.rates, {sight.root(o) for o in own}
    coarse = frozenset().union(*(sight.coarse.get(o, frozenset()) for o in own))
    known = {
        sight.root(other): other
        for other in sight.signals
        if other not in own and other not in coarse and rates.get(sight.root(other)) not in roots
    }
    for other in list(known.values()):
        rate = rates.get(sight.root(other))
        if rate is not None and rate not in known and rate not in roots:
            known[rate] = RATE + other
    return known


def _cut(sight: _Sight, own: Sequence[str]) -> tuple[Part, dict[str, str], dict[str, str]]:
    """The part that computes some signals; where its inputs come from; states that are measured,
    where some of them switch.
    """
    known = _known(sight, own)
    outputs = [sight.signals[n].variable for n in own]
    part = part_of(sight.plant, outputs, sorted(known), sight.cache)
    sources = {n: known.get(n, n) for n in part.of("input")}
    coarse = frozenset().union(*(sight.coarse.get(o, frozenset()) for o in own))
    signal = {sight.root(n): n for n in sight.signals if n not in coarse}
    corrected = {s: signal[s] for s in part.of("state") if s in signal}
    return part, sources, corrected if part.switching & set(corrected) else {}


def _same(
    part: Part, sources: Mapping[str, str], corrected: Mapping[str, str]
) -> tuple[object, ...]:
    """Equal for parts that one simulation computes."""
    if not part.of("state"):
        return tuple(sorted(part.of("parameter")))
    states = tuple(sorted(part.of("state")))
    return states, tuple(sorted(sources.items())), tuple(sorted(corrected.items()))


def _block(plant: Plant, variable: str) -> str:
    """Block of a variable: that of the longest component path it lies in that has one; else its
    component, or itself in a model without components.
    """
    paths = [p for p in plant.blocks if variable == p or variable.startswith(p + ".")]
    if paths:
        return plant.blocks[max(paths, key=len)]
    return variable.rpartition(".")[0] or variable
