"""A term as Modelica and as an effect of the catalogue."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pneugantry.engine.hypotheses.catalogue import Effect, Form, Parameter
from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.learn.equations.points import Point, written
from pneugantry.learn.equations.sources import Addition
from pneugantry.learn.screening.regressors import TIME, Regressor
from pneugantry.learn.terms.forms import FORMS, LINE, PERIODIC, FormLaw

__all__ = ["NAME", "Term", "with_term"]

NAME = "missing_term"
SWITCHED = (*FORMS, LINE, PERIODIC)  # of one text, `form` says which
LIMITS = "(min = -1e30, max = 1e30)"
WIDE = 1e6  # bounds of a size, in starting values
NARROW = 20.0  # bounds of a shape, as a factor


@dataclass(frozen=True)
class Term:
    """One addend: where, of what variable, in which form, from which values on."""

    point: Point
    regressor: Regressor
    law: FormLaw
    values: tuple[float, ...]  # p1, p2, ...: where its fit starts
    spreads: tuple[float, ...]  # usual sizes of the values; of a width, its relative error
    block: str  # of the answer
    places: Mapping[str, float] = field(default_factory=dict)  # of a wave that runs on between
    # records: the last of its values, by record

    @property
    def variable(self) -> str:
        """The regressor within its class."""
        return self.regressor.name

    @property
    def parameters(self) -> tuple[str, ...]:
        """Of the whole plant, but for what each record has of its own."""
        count = len(self.values) - bool(self.places)
        return tuple(f"{self._owner}p{k + 1}" for k in range(count))

    @property
    def own(self) -> str:
        """What each record has of its own, of the whole plant."""
        return f"{self._owner}p{len(self.values)}"

    @property
    def _owner(self) -> str:
        """What the names of its parameters begin with."""
        shared = self.point.shared is not None
        return f"common_{self.point.name}_" if shared else f"{self.point.variable}."

    @property
    def name(self) -> str:
        """As "signed square of v"."""
        return f"{self.law.name} of {self.regressor.label}"

    def units(self, known: Mapping[str, str]) -> tuple[str, str]:
        """Of its variable, and of its curve, which is what it adds but where another variable is a
        factor of it, and a share of what is inert; "" where that is not declared. known: by
        variable of the whole plant.
        """
        own, point = self.regressor, self.point
        named = own.name if own.fed else point.scope_prefix + own.name
        unit = "s" if own.name == TIME else known.get(named, "")
        if own.travelled:
            unit = unit.removesuffix("/s") if unit.endswith("/s") else ""
        if own.times:
            return unit, "1" if own.times == point.rate else ""
        return unit, known.get(point.prefix + point.equation.left.strip(), "")

    @property
    def _given(self) -> bool:
        """Whether the class around its component gives it what it is a function of."""
        return self.regressor.fed and not self.point.sensor

    @property
    def _shown(self) -> str:
        """The regressor in a formula."""
        named = "t" if self.variable == TIME else self._spelt
        return f"travel({named})" if self.regressor.travelled else named

    @property
    def _spelt(self) -> str:
        """The regressor, as the equation's class calls it, or the plant's."""
        return self.variable if self.regressor.outside else self.point.spelt(self.variable)

    def formula(self) -> str:
        """As a reader writes it, with the values in place."""
        own = self.regressor
        turned = f"*sign({self.point.spelt(own.speed)})" if own.speed else ""
        turned = f"*{self.point.spelt(own.times)}" if own.times else turned
        if self.law.tables:
            return f"curve of {self._shown}{' times' + turned.replace('*', ' ') if turned else ''}"
        text = self.law.memory.shown if self.law.memory else self.law.text
        for k, value in reversed([*enumerate(self.values, 1)]):
            shown = f"{value:.4g}" if k <= len(self.parameters) else "t0"
            text = text.replace(f"p{k}", f"({shown})" if k > 1 and value < 0 else shown)
        text = text.replace("3.141592653589793", "pi").replace("z", self._shown)
        return f"({text}){turned}" if turned else text

    def addition(self, neutral: bool, blank: bool = False) -> Addition:
        """What goes into the class. neutral: with a size of 0. blank: without any value of this
        term, and with a switch of all forms, so that all terms of a variable are one text; `effect`
        and `settings` then have the values.
        """
        if blank and not (self.law.tables or self.law.memory):
            return self._switched()
        name, kind = self.point.name, f"Residual_{self.point.equation.number}"
        neutral = neutral or blank
        values = [0.0 if neutral and self._is_size(k) else v for k, v in enumerate(self.values)]
        if blank:
            values = [0.0 if self._is_size(k) else 1.0 for k in range(len(values))]
        parameters = "".join(
            f"    parameter Real p{k}{LIMITS} = {float(v)!r};\n" for k, v in enumerate(values, 1)
        )
        for n, t in self.law.tables:
            told = np.ones(len(t)) if blank else t
            parameters += f"    parameter Real {n}{_size(told)} = {_literal(told)};\n"
        block = textwrap.indent(
            f'block {kind} "Missing term, learnt from logs: {self.law.name} of {self.variable}"\n'
            f"{parameters}"
            f"{self._read()}    y = noEvent({self.law.text});\nend {kind};",
            "  ",
        )
        bound = self._bound(values)
        return Addition(f"{block}\n  {kind} {name};", self._added(), self._fed(), bound)

    def _bound(self, values: Sequence[float]) -> tuple[tuple[int, str], ...]:
        """What is bound outside of the component: by the plant's own class parameters that all
        members have, declared there; by the class around it a variable that it gives to it.
        """
        shared, own = self.point.shared, [f"{self._owner}p{k + 1}" for k in range(len(values))]
        if self._given and self.point.declared is not None:
            given = f"{self.point.name}(z = {self.point.given(self.variable)})"
            return (self.point.declared.with_modifier(given),)
        if shared is None:
            return ()
        declared = "".join(
            f"parameter Real {n}{LIMITS} = {float(v)!r};\n  "
            for n, v in zip(own, values, strict=True)
        )
        given = ", ".join(f"p{k} = {n}" for k, n in enumerate(own, 1))
        modified = [d.with_modifier(f"{self.point.name}({given})") for d in shared.declared]
        return ((shared.section, f"public\n  {declared}"), *modified)

    def _read(self) -> str:
        """Inside of the block: z, what the term is a function of, and the equation of it."""
        memory = self.law.memory
        if memory is not None:
            return (
                f"    input Real z;\n    output Real y;\n    Real s;\n{memory.states}"
                f"  initial equation\n    s = z;\n  equation\n{memory.rates}"
            )
        if not self.regressor.travelled:
            unbound = " = 0" if self._given else ""  # in other components of the class
            return f"    input Real z{unbound};\n    output Real y;\n  equation\n"
        return (
            "    input Real speed;\n    output Real y;\n    Real z(start = 0, fixed = true);\n"
            "  equation\n    der(z) = noEvent(abs(speed));\n"
        )

    def _fed(self) -> str:
        """What the block is fed within its class."""
        if self._given:
            return ""
        own = "speed" if self.regressor.travelled else "z"
        return f"    {self.point.name}.{own} = {self._spelt};"

    def _added(self) -> str:
        """What stands in the equation."""
        speed, width, times = self.regressor.speed, self.regressor.width, self.regressor.times
        factor = f"*tanh({self.point.spelt(speed)}/{width!r})" if speed else ""
        factor = f"*{self.point.spelt(times)}" if times else factor
        return f"{self.point.name}.y{factor}"

    def _switched(self) -> Addition:
        """The block with all forms: `form` says which."""
        name, kind = self.point.name, f"Residual_{self.point.equation.number}"
        count = max(len(f.shapes) for f in SWITCHED) + 1
        forms = enumerate(SWITCHED[:-1])
        chosen = "".join(f"if form < {k}.5 then {f.text} else" for k, f in forms)
        sizes = "".join(f"    parameter Real p{k}{LIMITS} = 1;\n" for k in range(2, count + 1))
        return Addition(
            f"  block {kind}\n    parameter Real form = 0;\n    parameter Real p1{LIMITS} = 0;\n"
            f"{sizes}{self._read()}"
            f"    y = noEvent({chosen} {SWITCHED[-1].text});\n  end {kind};\n  {kind} {name};",
            self._added(),
            self._fed(),
            self._bound([0.0, *(1.0 for _ in range(count - 1))]),
        )

    @property
    def tables(self) -> dict[str, float]:
        """Parameters of the whole plant that are not fitted."""
        return {
            f"{member.variable}.{n}" + (f"[{k}]" if len(t) > 1 else ""): float(v)
            for member in self.point.members
            for n, t in self.law.tables
            for k, v in enumerate(t, 1)
        }

    @property
    def settings(self) -> dict[str, float]:
        """All that a blank text needs and that is not fitted."""
        names = [f.name for f in SWITCHED]
        if self.law.name not in names:
            return self.tables
        form = float(names.index(self.law.name))
        return {f"{member.variable}.form": form for member in self.point.members}

    def _is_size(self, k: int) -> bool:
        return k == 0 or self.law.shapes[k - 1] == "size"

    @property
    def effect(self) -> Effect:
        """As an effect: neutral at a size of 0."""
        made = []
        for k, (name, value, spread) in enumerate(
            zip(self.parameters, self.values, self.spreads, strict=False)
        ):
            if self._is_size(k):
                bound = WIDE * max(abs(value), spread)
                made.append(Parameter(name, 0.0, spread, -bound, bound, starts=(value,)))
            elif self.law.shapes[k - 1] == "width":
                low, high = value / NARROW, value * NARROW
                made.append(Parameter(name, value, value, low, high, positive=True))
            else:
                made.append(
                    Parameter(name, value, spread, value - NARROW * spread, value + NARROW * spread)
                )
        summary = f"learnt: {self.name}"
        form = Form(self.law.name, tuple(made), self.settings)
        return Effect(NAME, "", self.block, summary, (form,))

    @property
    def neutral(self) -> dict[str, float]:
        """Its parameters, of a size of 0."""
        return {n: 0.0 if self._is_size(k) else v for k, (n, v) in enumerate(self.starts.items())}

    @property
    def starts(self) -> dict[str, float]:
        return dict(zip(self.parameters, self.values, strict=False))

    def at(self, values: Sequence[float], places: Mapping[str, float] | None = None) -> Term:
        """The same with other values of its parameters, and of what each record has."""
        whole = (*values, *self.values[len(values) :])
        return replace(self, values=whole, places=self.places if places is None else places)

    def within(self, record: Record) -> Record:
        """A record with what it has of its own, where that is known."""
        if record.name not in self.places:
            return record
        own = {self.own: self.places[record.name]}
        return replace(record, parameters={**record.parameters, **own})


def _size(value: Array) -> str:
    return f"[{len(value)}]" if len(value) > 1 else ""


def _literal(value: Array) -> str:
    told = ", ".join(repr(float(v)) for v in value)
    return f"{{{told}}}" if len(value) > 1 else told


def with_term(plant: Plant, term: Term, folder: Path, blank: bool = False) -> Plant:
    """The plant with the term in its equation, of a size of 0. blank: see `Term.addition`."""
    model = written(plant, {term.point.equation: term.addition(True, blank)}, folder)
    return replace(plant, model=model)
