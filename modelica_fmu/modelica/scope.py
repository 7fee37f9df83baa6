"""Classes in their lexical context: what a name means where it stands (section 5)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from modelica_fmu.errors import InputError
from modelica_fmu.ir import Place
from modelica_fmu.modelica.library import Library
from modelica_fmu.modelica.syntax import ClassDef, Component, Extends, Import, Modifier, Part, Ref

BUILTIN_TYPES = ("Real", "Integer", "Boolean", "String", "Clock", "ExternalObject")
NOWHERE = Place(__import__("pathlib").Path("Modelica"), 0)


def refuse(
    message: str, place: Place | None, hint: str = "rewrite it in supported Modelica"
) -> InputError:
    """One line with file and line."""
    where = f"{place.file}:{place.line}" if place and place.line else place.file if place else None
    return InputError(message, file=where, hint=hint)


def _builtin(name: str) -> ClassDef:
    return ClassDef(NOWHERE, "type", name)


def _enumeration(name: str, *literals: str) -> ClassDef:
    return ClassDef(NOWHERE, "type", name, literals=tuple((item, "") for item in literals))


BUILTINS = {name: _builtin(name) for name in BUILTIN_TYPES} | {
    "StateSelect": _enumeration("StateSelect", "never", "avoid", "default", "prefer", "always"),
    "AssertionLevel": _enumeration("AssertionLevel", "warning", "error"),
}


@dataclass(eq=False)
class Scope:
    """A class and what surrounds it.

    redeclared: classes that a modifier puts in place of its replaceable ones.
    """

    library: Library
    cls: ClassDef
    parent: Scope | None
    redeclared: dict[str, Scope] = field(default_factory=dict)
    _bases: list[tuple[Extends, Scope]] | None = None
    _known: dict[str, Any] = field(default_factory=dict)
    package: Any = None  # its constants, once they are asked for (instances.py)

    @property
    def path(self) -> str:
        above = self.parent.path if self.parent and self.parent.cls.name else ""
        return f"{above}.{self.cls.name}" if above else self.cls.name

    @property
    def builtin(self) -> str:
        """The name of a predefined type, "" of any other class."""
        return self.cls.name if BUILTINS.get(self.cls.name) is self.cls else ""

    def refuse(self, message: str, place: Place | None = None, **hint: str) -> InputError:
        return refuse(message, place or self.cls.place, **hint)

    def inside(self, cls: ClassDef) -> Scope:
        return Scope(self.library, cls, self)

    # ---- inheritance

    def bases(self) -> list[tuple[Extends, Scope]]:
        """What the class extends, redeclarations put in; of a short class, what it stands for."""
        if self._bases is None:
            self._bases = []
            for extends in extensions(self.cls):
                self._bases.append((extends, self._base(extends)))
        return self._bases

    def _base(self, extends: Extends) -> Scope:
        if "class extends" in self.cls.prefixes and len(extends.base.parts) == 1:
            found = self._replaced(extends)
        else:
            start = self.parent if self.cls.alias is not None and self.parent else self
            found = start.find_class(extends.base, inherited=False)
        if found.cls is self.cls:
            raise self.refuse(f"{self.cls.name} extends itself", extends.place)
        changed = dict(found.redeclared)
        changed |= self.class_modifiers(extends.modifiers)
        changed |= {
            e.name: self.inside(e)
            for e in self.cls.elements
            if isinstance(e, ClassDef) and "redeclare" in e.prefixes
        }
        changed |= self.redeclared
        return Scope(found.library, found.cls, found.parent, changed) if changed else found

    def _replaced(self, extends: Extends) -> Scope:
        """`redeclare model extends M`: the M of what the surrounding class extends."""
        name = extends.base.parts[0].name
        for _, base in self.parent.bases() if self.parent else []:
            found = base.own_class(name, ignore_redeclared=True)
            if found is not None:
                return found
        raise self.refuse(f"`{name}` does not exist in a base class", extends.place)

    def class_modifiers(self, modifiers: tuple[Modifier, ...]) -> dict[str, Scope]:
        """Redeclared classes among modifiers that stand in this scope."""
        return {
            m.redeclared.name: self.inside(m.redeclared)
            for m in modifiers
            if isinstance(m.redeclared, ClassDef)
        }

    # ---- names

    def own_class(
        self, name: str, inherited: bool = True, ignore_redeclared: bool = False
    ) -> Scope | None:
        """A class that is declared in this one or that it inherits."""
        if name in self.redeclared and not ignore_redeclared:
            return self.redeclared[name]
        key = f"{name} {inherited} {ignore_redeclared}"
        if key not in self._known:
            self._known[key] = self._own_class(name, inherited)
        return self._known[key]

    def _own_class(self, name: str, inherited: bool) -> Scope | None:
        made = self.library.child(self.cls, name)
        if made is not None:
            return self.inside(made)
        if inherited:
            for _, base in self.bases():
                found = base.own_class(name)
                if found is not None:
                    return found
        return None

    def own_component(self, name: str) -> bool:
        """Whether a component of that name is declared here or inherited."""
        key = f"component {name}"
        if key not in self._known:
            own = any(isinstance(e, Component) and e.name == name for e in self.cls.elements)
            self._known[key] = own or any(base.own_component(name) for _, base in self.bases())
        return bool(self._known[key])

    def imported(self, name: str) -> Scope | tuple[Scope, str] | None:
        """What an import clause means by a name: a class, or a package and its constant."""
        for element in self.cls.elements:
            if not isinstance(element, Import):
                continue
            path = element.path
            if element.everything or name in element.names:
                found = self.absolute(path, element.place)
                if found.own_class(name) is None and not found.own_component(name):
                    continue
                path = (*path, name)
            elif name != (element.alias or path[-1]) or element.names:
                continue
            return self.absolute_member(path, element.place)
        return None

    def absolute(self, path: tuple[str, ...], place: Place) -> Scope:
        found = self.absolute_member(path, place)
        if isinstance(found, tuple):
            raise self.refuse(f"{'.'.join(path)} is no class", place)
        return found

    def absolute_member(self, path: tuple[str, ...], place: Place) -> Scope | tuple[Scope, str]:
        root = self.root
        found = root.top_class(path[0])
        for i, name in enumerate(path[1:], 1):
            if found is None:
                break
            inner = found.own_class(name)
            if inner is None and i == len(path) - 1 and found.own_component(name):
                return found, name
            found = inner
        if found is None:
            raise self.refuse(
                f"unresolved import: `{'.'.join(path)}` does not exist",
                place,
                hint="give its library with --library",
            )
        return found

    @property
    def root(self) -> Scope:
        scope = self
        while scope.parent is not None:
            scope = scope.parent
        return scope

    def top_class(self, name: str) -> Scope | None:
        root = self.root
        if name not in root._known:
            made = self.library.top(name) or BUILTINS.get(name)
            root._known[name] = root.inside(made) if made else None
        return root._known[name]

    def first_class(self, name: str, inherited: bool = True) -> Scope | None:
        """The class that a simple name means, looked for from here outwards."""
        scope: Scope | None = self
        while scope is not None and scope.parent is not None:
            found = scope.own_class(name, inherited=inherited or scope is not self)
            if found is None:
                by_import = scope.imported(name)
                found = by_import if isinstance(by_import, Scope) else None
            if found is not None:
                return found
            if "encapsulated" in scope.cls.prefixes:
                return self.root.top_class(name) if name in BUILTINS else None
            scope = scope.parent
        return self.root.top_class(name)

    def find_class(self, ref: Ref, inherited: bool = True) -> Scope:
        """The class that a dotted name means; refused where there is none."""
        found: Scope | None
        if ref.absolute:
            return self.absolute(tuple(p.name for p in ref.parts), ref.place)
        found = self.first_class(ref.parts[0].name, inherited)
        for part in ref.parts[1:]:
            if found is None:
                break
            found = found.own_class(part.name)
        if found is None:
            raise self.refuse(
                f"unresolved type reference: '{ref}'; `{ref}` does not exist",
                ref.place,
                hint="declare it, or give its library with --library",
            )
        return found


def extensions(cls: ClassDef) -> list[Extends]:
    if cls.alias is not None:
        return [Extends(cls.alias.place, cls.alias.type, cls.alias.modifiers)]
    return [e for e in cls.elements if isinstance(e, Extends)]


def root_scope(library: Library) -> Scope:
    return Scope(library, ClassDef(NOWHERE, "package", ""), None)


def reference(name: str, place: Place) -> Ref:
    return Ref(place, tuple(Part(part, ()) for part in name.split(".")))
