"""A class of a Modelica file as a flat model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from modelica_fmu import ir
from modelica_fmu.errors import InputError
from modelica_fmu.modelica.check import check
from modelica_fmu.modelica.equations import Sections
from modelica_fmu.modelica.evaluation import Evaluator, NotConstant
from modelica_fmu.modelica.instances import Instance, Leaf, Node
from modelica_fmu.modelica.library import TABLES, Library
from modelica_fmu.modelica.modifiers import Mod
from modelica_fmu.modelica.resolve import Resolver
from modelica_fmu.modelica.scope import Scope, refuse, root_scope
from modelica_fmu.modelica.syntax import ClassDef, Number

MODELS = ("model", "block", "class")
STATE_SELECT = {1: -2, 2: -1, 3: 0, 4: 1, 5: 2}
PLAIN_ATTRIBUTES = ("start", "fixed", "min", "max", "nominal")


def flat_model(
    model: Path | None,
    class_name: str,
    libraries: Sequence[Path] = (),
    fixed: frozenset[str] = frozenset(),
) -> ir.FlatModel:
    """Flattens `class_name` of the file `model` and the libraries; parameters that are `fixed`
    become constants.

    Raises InputError with file and line for what is no Modelica or not supported.
    """
    library = Library(libraries, model)
    scope = _class(library, class_name, model)
    if scope.cls.kind not in MODELS:
        raise scope.refuse(
            f"{class_name} is a {scope.cls.kind}", hint="name a model or block of the file"
        )
    if "partial" in scope.cls.prefixes:
        raise scope.refuse(f"{class_name} is partial", hint="name a model that extends it")
    evaluator = Evaluator()
    resolver = Resolver(evaluator)
    instance = Instance("", scope, {}, None, evaluator)
    try:
        return Flattening(resolver, instance, class_name).model(library, fixed)
    except NotConstant as unknown:
        raise refuse(
            f"{unknown.what} must be known while compiling", unknown.place or scope.cls.place
        ) from None


def _class(library: Library, class_name: str, model: Path | None) -> Scope:
    path = class_name.split(".")
    found = root_scope(library).top_class(path[0])
    for name in path[1:]:
        found = found.own_class(name) if found is not None else None
    if found is None or found.builtin:
        known = [".".join(names) for names in library.model_classes]
        inner = [f"{names}.{e.name}" for names in known for e in _inner(library, names)]
        what = f"it holds {', '.join([*known, *inner][:8])}" if known else "give its library"
        where = "in this file" if model is not None else "in the libraries"
        raise InputError(f"no class {class_name} {where}", file=model, hint=what)
    return found


def _inner(library: Library, name: str) -> list[ClassDef]:
    made = library.top(name)
    return list(made.classes.values()) if made is not None else []


class Flattening:
    def __init__(self, resolver: Resolver, instance: Instance, name: str) -> None:
        self.resolver, self.instance, self.name = resolver, instance, name
        self.variables: dict[str, ir.FlatVariable] = {}

    def model(self, library: Library, fixed: frozenset[str]) -> ir.FlatModel:
        self._variables(self.instance, top=True)
        for name in sorted(fixed):
            place = self.resolver.evaluator.leaves[name].place
            self.resolver.evaluator.value_or_refuse(ir.Name(place, name), place)
        sections = Sections(self.resolver)
        sections.collect(self.instance)
        sections.equations += sections.connections.equations(self.instance)
        # what decided the structure can no longer change: it is a constant from here on
        for name, variable in self.variables.items():
            leaf = self.resolver.evaluator.leaves.get(name)
            if leaf is not None and leaf.structural and variable.variability == "Parameter":
                self.variables[name] = _constant(variable, leaf)
        made = ir.FlatModel(
            self.name,
            self.instance.scope.cls.description,
            self.instance.scope.cls.place.file,
            self.variables,
            sections.equations,
            sections.initial,
            sections.algorithms,
            sections.initial_algorithms,
            sections.whens,
            sections.assertions,
            self.resolver.functions.made,
            self.resolver.enumerations,
            stop_time(self.instance.scope.cls),
            self.instance.scope.cls.place,
            tuple(library.files),
        )
        check(made)
        return made

    def _variables(self, node: Node, top: bool = False, outer: bool = False) -> None:
        if isinstance(node, list):
            for item in node:
                self._variables(item)
        elif isinstance(node, Leaf):
            self.resolver.evaluator.leaves[node.name] = node
            self.variables[node.name] = self._variable(node, top)
        elif isinstance(node, Instance):
            for name, inner in node.nodes():
                scope = node.slots[name].component.scope
                if "outer" not in scope or "inner" in scope:
                    self._variables(inner, top and isinstance(inner, Leaf))

    def _variable(self, leaf: Leaf, top: bool) -> ir.FlatVariable:
        if leaf.type in ("Clock", "ExternalObject"):
            raise refuse(f"not supported: a {leaf.type} ({leaf.name})", leaf.place)
        binding = self.resolver.bound(leaf.binding) if leaf.binding is not None else None
        if leaf.type == "String" and binding is not None and not leaf.dims:
            binding = self._string(leaf, binding)
        unknown = [
            n
            for n in leaf.mods
            if n not in (*PLAIN_ATTRIBUTES, "unit", "displayUnit", "quantity", "stateSelect")
            and n != "unbounded"
        ]
        if unknown:
            raise refuse(f"{leaf.name} has no attribute {unknown[0]}", leaf.mods[unknown[0]].place)
        bound = {name: self._attribute(leaf, name) for name in PLAIN_ATTRIBUTES}
        unit = self._text(leaf, "unit")
        variability = {"constant": "Constant", "parameter": "Parameter", "discrete": "Discrete"}
        if leaf.literals is not None:
            self.resolver.enumerations[leaf.type] = leaf.literals
        return ir.FlatVariable(
            leaf.name,
            leaf.type,
            variability.get(leaf.variability, "Continuous"),
            leaf.causality if top else "",
            leaf.dims,
            binding,
            unit=unit,
            description=leaf.description or None,
            protected=leaf.protected,
            final=leaf.final,
            place=leaf.place,
            prefer=self._prefer(leaf),
            **bound,
        )

    def _string(self, leaf: Leaf, binding: ir.Expr) -> ir.Expr:
        """A text where it is known; the parameters behind it can then change no more."""
        try:
            value = self.resolver.evaluator.value(binding)
        except (NotConstant, ValueError, ZeroDivisionError, IndexError, TypeError):
            value = None
        if leaf.place.file == TABLES and leaf.name.endswith(".fileName") and value != "NoName":
            hint = "write its rows into the model"
            raise refuse(f"not supported: the table {leaf.name} of a file", leaf.place, hint=hint)
        return ir.Text(leaf.place, value) if isinstance(value, str) else binding

    def _attribute(self, leaf: Leaf, name: str) -> ir.Expr | None:
        mod: Mod | None = leaf.mods.get(name)
        return self.resolver.bound(mod.value) if mod is not None and mod.value else None

    def _text(self, leaf: Leaf, name: str) -> str | None:
        found = self._attribute(leaf, name)
        if found is None:
            return None
        while isinstance(found, ir.Array) and found.items:
            found = found.items[0]
        value = self.resolver.evaluator.look(found)
        return value if isinstance(value, str) and value else None

    def _prefer(self, leaf: Leaf) -> int:
        found = self._attribute(leaf, "stateSelect")
        value = self.resolver.evaluator.look(found) if found is not None else None
        return STATE_SELECT.get(value, 0) if isinstance(value, int) else 0


def _constant(variable: ir.FlatVariable, leaf: Leaf) -> ir.FlatVariable:
    from dataclasses import replace

    from modelica_fmu.modelica.resolve import literal

    if leaf.value is None or isinstance(leaf.value, str):
        return variable
    binding = literal(leaf.value, leaf.place, leaf.type)
    return replace(variable, variability="Constant", binding=binding)


def stop_time(cls: ClassDef) -> float | None:
    """StopTime of the experiment annotation."""
    for modifier in cls.annotation:
        if modifier.name == ("experiment",):
            for inner in modifier.inner:
                if inner.name == ("StopTime",) and isinstance(inner.value, Number):
                    return inner.value.value
    return None


__all__ = ["flat_model"]
