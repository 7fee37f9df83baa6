"""Modifications, merged from the outside inwards (section 7.2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from modelica_fmu.ir import Place
from modelica_fmu.modelica.syntax import ClassDef, Component, Expr, Modifier

if TYPE_CHECKING:
    from modelica_fmu.modelica.instances import Frame

Step = int | str  # an element of an array of components, or a field of a record


@dataclass(frozen=True, eq=False)
class Bound:
    """An expression, where its names are looked up, and which part of its value is meant."""

    expr: Expr
    frame: Frame
    steps: tuple[Step, ...] = ()

    def part(self, step: Step) -> Bound:
        return replace(self, steps=(*self.steps, step))


@dataclass(frozen=True, eq=False)
class Mod:
    """What modifiers say of one component or class."""

    place: Place
    value: Bound | None = None
    inner: Mapping[str, Mod] = field(default_factory=dict)
    each: bool = False
    final: bool = False
    redeclared: tuple[ClassDef | Component, Frame] | None = None
    depth: int = 0  # of components whose elements it has been given to

    def element(self, i: int) -> Mod:
        """Its share for element i of an array of components."""
        if self.each:
            return self
        value = self.value.part(i) if self.value is not None else None
        inner = {name: mod.element(i) for name, mod in self.inner.items()}
        return replace(self, value=value, inner=inner)


def merge(outer: Mod | None, inner: Mod | None) -> Mod | None:
    """The outer one's word counts where both say something."""
    if outer is None or inner is None:
        return outer or inner
    return replace(
        outer,
        value=outer.value or inner.value,
        inner=merge_all(outer.inner, inner.inner),
        final=outer.final or inner.final,
        redeclared=outer.redeclared or inner.redeclared,
    )


def merge_all(outer: Mapping[str, Mod], inner: Mapping[str, Mod]) -> dict[str, Mod]:
    merged = dict(inner)
    for name, mod in outer.items():
        both = merge(mod, merged.get(name))
        assert both is not None
        merged[name] = both
    return merged


def modifiers_of(found: tuple[Modifier, ...], frame: Frame) -> dict[str, Mod]:
    made: dict[str, Mod] = {}
    for modifier in found:
        for name, mod in [(modifier.name[0], _mod(modifier, modifier.name[1:], frame))]:
            both = merge(mod, made.get(name))
            assert both is not None
            made[name] = both
    return made


def _mod(modifier: Modifier, rest: tuple[str, ...], frame: Frame) -> Mod:
    if rest:
        inner = {rest[0]: _mod(modifier, rest[1:], frame)}
        return Mod(modifier.place, inner=inner, each=modifier.each)
    bound = Bound(modifier.value, frame) if modifier.value is not None else None
    return Mod(
        modifier.place,
        bound,
        modifiers_of(modifier.inner, frame),
        modifier.each,
        modifier.final,
        (modifier.redeclared, frame) if modifier.redeclared is not None else None,
    )
