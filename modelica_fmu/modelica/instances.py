"""Instances: components with their modifiers, arrays taken apart, down to predefined types
(section 5.6).

Everything is made when it is first asked for: a dimension may depend on a parameter declared later.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple, Union

from modelica_fmu.errors import InputError
from modelica_fmu.ir import Place
from modelica_fmu.modelica.modifiers import Bound, Mod, merge, merge_all, modifiers_of
from modelica_fmu.modelica.scope import Scope, refuse
from modelica_fmu.modelica.syntax import (
    Action,
    Call,
    ClassDef,
    Colon,
    Component,
    Expr,
    Ref,
)

if TYPE_CHECKING:
    from modelica_fmu.modelica.evaluation import Evaluator

MOST_ELEMENTS = 20_000  # of arrays of components
MOST_DEEP = 60  # components within components


@dataclass(frozen=True, eq=False)
class Frame:
    """Where an expression stands: the instance whose components it sees, and the class text."""

    instance: Instance | None
    scope: Scope
    iterators: dict[str, Any] = field(default_factory=dict)
    locals: frozenset[str] = frozenset()  # of a function

    def with_iterator(self, name: str, value: Any) -> Frame:
        return replace(self, iterators={**self.iterators, name: value})


@dataclass(eq=False)
class Leaf:
    """A component of predefined type, an array where it has dimensions."""

    name: str
    type: str  # Real, Integer, Boolean, String, or the enumeration's full name
    component: Component
    frame: Frame
    dims: tuple[int, ...]
    mods: dict[str, Mod]
    binding: Bound | None
    variability: str
    causality: str
    connection: str
    protected: bool
    final: bool
    description: str
    literals: tuple[tuple[str, str], ...] | None = None
    structural: bool = False  # a dimension, range or branch of the model depends on its value
    value: Any = None  # once evaluated
    evaluating: bool = False

    @property
    def place(self) -> Place:
        return self.component.place


Node = Union["Instance", Leaf, list[Any], None]


@dataclass(eq=False)
class Slot:
    """A component of an instance, made on demand."""

    component: Component
    frame: Frame  # of the declaration
    mod: Mod | None
    node: Node = None
    made: bool = False
    making: bool = False


@dataclass(eq=False)
class Inherited:
    """What inheritance hands down to the components of one instance."""

    variability: str = ""
    causality: str = ""
    protected: bool = False
    final: bool = False
    connection: str = ""
    value: Bound | None = None  # of the instance itself; its components' are parts of it


class Primitive(NamedTuple):
    """The predefined type or enumeration behind a type, None where there is none, with what was
    modified and dimensioned on the way.
    """

    type: Scope | None
    mods: dict[str, Mod]
    dims: tuple[Bound, ...]


class Instance:
    """One component of structured type (or the model itself, or a package with its constants)."""

    def __init__(
        self,
        name: str,
        scope: Scope,
        mods: dict[str, Mod],
        parent: Instance | None,
        evaluator: Evaluator,
        given: Inherited | None = None,
    ) -> None:
        self.name, self.scope, self.parent, self.evaluator = name, scope, parent, evaluator
        self.given = given or Inherited()
        self.slots: dict[str, Slot] = {}
        self.sections: list[tuple[ClassDef, Frame]] = []  # classes whose equations count
        self.depth: int = parent.depth + 1 if parent else 0
        if self.depth > MOST_DEEP:
            raise scope.refuse(f"{name} lies more than {MOST_DEEP} components deep")
        self._collect(scope, mods)

    def _collect(self, scope: Scope, mods: dict[str, Mod]) -> None:
        """Components and sections of a class, those of its bases first."""
        frame = Frame(self, scope)
        for extends, base in scope.bases():
            if not base.builtin:
                self._collect(base, merge_all(mods, modifiers_of(extends.modifiers, frame)))
        for element in scope.cls.elements:
            if isinstance(element, Component):
                self._add(element, frame, mods.get(element.name))
        self.sections.append((scope.cls, frame))

    def _add(self, component: Component, frame: Frame, mod: Mod | None) -> None:
        bound = Bound(component.value, frame) if component.value is not None else None
        inner = modifiers_of(component.modifiers, frame)
        own = Mod(component.place, bound, inner, final=component.final)
        self._place(component.name, Slot(component, frame, merge(mod, own)))

    def _place(self, name: str, slot: Slot) -> None:
        """A component inherited twice is one; a redeclaring one takes the other's place."""
        before = self.slots.get(name)
        if before is not None:
            slot = Slot(slot.component, slot.frame, merge(slot.mod, before.mod))
        self.slots[name] = slot

    def node(self, name: str) -> Node:
        """The component of that name: an instance, a leaf, a list of these, None if absent."""
        slot = self.slots[name]
        if not slot.made:
            if slot.making:
                raise refuse(f"{name} depends on itself", slot.component.place)
            slot.making = True
            try:
                slot.node = Maker(self, slot).make()
            finally:
                slot.making = False
            slot.made = True
        return slot.node

    def nodes(self) -> Iterator[tuple[str, Node]]:
        for name in list(self.slots):
            yield name, self.node(name)

    def actions(self, which: str) -> Iterator[tuple[Action, Frame]]:
        """Equations of one section of the class and all that it extends."""
        for cls, frame in self.sections:
            for action in getattr(cls, which):
                yield action, frame


class Maker:
    """Makes the node of one slot."""

    def __init__(self, owner: Instance, slot: Slot) -> None:
        self.owner, self.slot, self.evaluator = owner, slot, owner.evaluator
        self.component, self.frame, self.mod = slot.component, slot.frame, slot.mod

    def make(self) -> Node:
        component = self.component
        if "outer" in component.scope and "inner" not in component.scope:
            return self._outer()
        if component.condition is not None:
            held = self.evaluator.of(component.condition, self.frame)
            if held is False or held == 0:
                return None
        component = self._redeclared()
        target = self.frame.scope.find_class(component.type)
        changes = {
            name: self.frame.scope.inside(mod.redeclared[0])
            if mod.redeclared[1] is self.frame
            else mod.redeclared[1].scope.inside(mod.redeclared[0])
            for name, mod in (self.mod.inner if self.mod else {}).items()
            if mod.redeclared is not None and isinstance(mod.redeclared[0], ClassDef)
        }
        if changes:
            changed = {**target.redeclared, **changes}
            target = Scope(target.library, target.cls, target.parent, changed)
        return self._of_type(component, target)

    def _redeclared(self) -> Component:
        """The component, with the type that a modifier gives it in place of its own."""
        component = self.component
        while self.mod is not None and self.mod.redeclared is not None:
            made, frame = self.mod.redeclared
            if not isinstance(made, Component):
                break
            bound = Bound(made.value, frame) if made.value is not None else None
            inner = modifiers_of(made.modifiers, frame)
            given = Mod(made.place, bound, inner)
            self.mod = merge(
                replace(self.mod, redeclared=None), merge(given, self._kept(component))
            )
            self.frame = frame
            component = replace(
                made,
                variability=made.variability or component.variability,
                causality=made.causality or component.causality,
                dims=made.dims or component.dims,
                description=made.description or component.description,
                protected=component.protected,
            )
        return component

    def _kept(self, component: Component) -> Mod | None:
        """A redeclaration drops the modifiers of the declaration, but not its binding."""
        own = self.slot.mod
        return Mod(component.place, value=own.value) if own is not None else None

    def _outer(self) -> Node:
        name, above = self.component.name, self.owner.parent
        while above is not None:
            slot = above.slots.get(name)
            if slot is not None and "inner" in slot.component.scope:
                return above.node(name)
            above = above.parent
        raise refuse(
            f"the outer component {name} has no inner one around it",
            self.component.place,
            hint=f"declare `inner {self.component.type} {name}` in the model",
        )

    def _of_type(self, component: Component, target: Scope) -> Node:
        name = f"{self.owner.name}.{self.component.name}".lstrip(".")
        given = self.owner.given
        handed = Inherited(
            _stricter(given.variability, component.variability),
            given.causality or component.causality,
            given.protected or component.protected,
            given.final or component.final or bool(self.mod and self.mod.final),
            given.connection or component.connection,
        )
        primitive = self._primitive(target, handed)
        mod = self.mod
        if given.value is not None and self._takes(given.value, component, mod):
            part = given.value.part(self.component.name)
            mod = merge(Mod(component.place, part), mod)
        if primitive.type is not None:
            return self._leaf(name, component, primitive, handed, mod)
        if target.cls.kind == "type" and target.cls.literals is None and not target.bases():
            raise refuse(f"{target.cls.name} is no type of a component", component.place)
        if "partial" in target.cls.prefixes and not self._is_package():
            raise refuse(
                f"{name} is of the partial class {target.path}",
                component.place,
                hint="redeclare it with a class that is complete",
            )
        sizes = [self._size(d, component.place) for d in component.dims]
        return self._structured(name, target, sizes, mod, handed)

    def _takes(self, whole: Bound, component: Component, mod: Mod | None) -> bool:
        """Whether a field follows the value of its record: it does rather than its declaration,
        but for a constant that is no argument of a constructor.
        """
        if mod is None or mod.value is None:
            return True
        if mod.value.expr is not component.value or component.final:
            return False
        return component.variability != "constant" or isinstance(whole.expr, Call)

    def _is_package(self) -> bool:
        return self.owner.scope.cls.kind == "package"

    def _structured(
        self, name: str, target: Scope, sizes: list[int], mod: Mod | None, handed: Inherited
    ) -> Node:
        if sizes:
            if sizes[0] > MOST_ELEMENTS:
                raise refuse(
                    f"{name} has {sizes[0]} elements, at most {MOST_ELEMENTS} are compiled",
                    self.component.place,
                    hint="make it smaller",
                )
            return [
                self._structured(
                    _indexed(name, i),
                    target,
                    sizes[1:],
                    mod.element(i) if mod is not None else None,
                    handed,
                )
                for i in range(1, sizes[0] + 1)
            ]
        mods = dict(mod.inner) if mod is not None else {}
        value = mod.value if mod is not None else None
        given = replace(handed, value=value)
        return Instance(name, target, mods, self.owner, self.evaluator, given)

    def _size(self, dim: Expr, place: Place) -> int:
        if isinstance(dim, Colon):
            raise refuse(f"the size of {self.component.name} is open", place, hint="give it")
        return self.evaluator.size(dim, self.frame)

    def _primitive(self, target: Scope, handed: Inherited) -> Primitive:
        mods: dict[str, Mod] = {}
        dims: tuple[Bound, ...] = ()
        for _ in range(100):
            if target.builtin or target.cls.literals is not None:
                return Primitive(target, mods, dims)
            bases = target.bases()
            if len(bases) != 1:
                return Primitive(None, {}, ())
            extends, base = bases[0]
            frame = Frame(None, target)
            mods = merge_all(mods, modifiers_of(extends.modifiers, frame))
            alias = target.cls.alias
            if alias is not None:
                dims += tuple(Bound(d, Frame(None, target.parent or target)) for d in alias.dims)
                handed.causality = handed.causality or alias.causality
                handed.connection = handed.connection or alias.connection
            elif any(isinstance(e, Component) for e in target.cls.elements):
                return Primitive(None, {}, ())
            target = base
        raise refuse(f"the type {target.path} stands for itself", self.component.place)

    def _leaf(
        self,
        name: str,
        component: Component,
        primitive: Primitive,
        handed: Inherited,
        mod: Mod | None,
    ) -> Leaf:
        base = primitive.type
        assert base is not None
        inner = merge_all(mod.inner if mod is not None else {}, primitive.mods)
        binding = mod.value if mod is not None else None
        leaf = Leaf(
            name,
            base.builtin or base.path,
            component,
            self.frame,
            (),
            inner,
            binding,
            handed.variability,
            handed.causality,
            handed.connection,
            handed.protected,
            handed.final,
            component.description,
            base.cls.literals,
        )
        leaf.dims = self._dims(leaf, (*component.dims, *primitive.dims))
        return leaf

    def _dims(self, leaf: Leaf, dims: tuple[Expr | Bound, ...]) -> tuple[int, ...]:
        found: list[int] = []
        for k, dim in enumerate(dims):
            if isinstance(dim, Bound):
                found.append(self.evaluator.size(dim.expr, dim.frame))
            elif not isinstance(dim, Colon):
                found.append(self.evaluator.size(dim, self.frame))
            elif leaf.binding is None:
                raise refuse(
                    f"the size of {leaf.name} is open", leaf.place, hint="give it, or a value"
                )
            else:
                found.append(self.evaluator.length(leaf, k))
        return tuple(found)


def _stricter(a: str, b: str) -> str:
    order = ("constant", "parameter", "discrete", "")
    return order[min(order.index(a), order.index(b))]


def _indexed(name: str, i: int) -> str:
    """One more subscript: "b" → "b[2]" → "b[2,3]"."""
    return f"{name[:-1]},{i}]" if name.endswith("]") else f"{name}[{i}]"


def leaves(node: Node) -> Iterator[Leaf]:
    """All leaves of a component, in the order of their declarations."""
    if isinstance(node, Leaf):
        yield node
    elif isinstance(node, list):
        for item in node:
            yield from leaves(item)
    elif isinstance(node, Instance):
        for _, inner in node.nodes():
            yield from leaves(inner)


def package_of(scope: Scope, evaluator: Evaluator) -> Instance:
    """The constants of a package (or class) as an instance."""
    if scope.package is None:
        scope.package = Instance(scope.path, scope, {}, None, evaluator)
    return scope.package


__all__ = [
    "Frame",
    "InputError",
    "Instance",
    "Leaf",
    "Node",
    "Ref",
    "Slot",
    "leaves",
    "package_of",
]
