"""Syntax tree of Modelica 3.6: what the parser makes and the instantiation reads."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, TypeAlias

from modelica_fmu.ir import Place

# ---- expressions


@dataclass(frozen=True, eq=False, slots=True)
class Number:
    place: Place
    value: float
    integer: bool


@dataclass(frozen=True, eq=False, slots=True)
class Truth:
    place: Place
    value: bool


@dataclass(frozen=True, eq=False, slots=True)
class Text:
    place: Place
    value: str


@dataclass(frozen=True, eq=False, slots=True)
class Part:
    """One step of a component reference: name and subscripts."""

    name: str
    subscripts: tuple[Expr, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Ref:
    place: Place
    parts: tuple[Part, ...]
    absolute: bool = False  # written with a leading dot

    def __str__(self) -> str:
        return ".".join(part.name for part in self.parts)


@dataclass(frozen=True, eq=False, slots=True)
class Unary:
    place: Place
    op: str
    operand: Expr


@dataclass(frozen=True, eq=False, slots=True)
class Binary:
    place: Place
    op: str
    left: Expr
    right: Expr


@dataclass(frozen=True, eq=False, slots=True)
class IfExpr:
    place: Place
    branches: tuple[tuple[Expr, Expr], ...]  # condition, value
    otherwise: Expr


@dataclass(frozen=True, eq=False, slots=True)
class Iterator:
    name: str
    range: Expr | None  # None: deduced from the subscripts it stands in


@dataclass(frozen=True, eq=False, slots=True)
class Call:
    place: Place
    function: Ref
    args: tuple[Expr, ...]
    named: tuple[tuple[str, Expr], ...] = ()
    iterators: tuple[Iterator, ...] = ()  # of a reduction such as sum(... for i in ...)


@dataclass(frozen=True, eq=False, slots=True)
class Braces:
    place: Place
    items: tuple[Expr, ...]
    iterators: tuple[Iterator, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Brackets:
    place: Place
    rows: tuple[tuple[Expr, ...], ...]


@dataclass(frozen=True, eq=False, slots=True)
class Range:
    place: Place
    start: Expr
    step: Expr | None
    stop: Expr


@dataclass(frozen=True, eq=False, slots=True)
class Tuple:
    place: Place
    items: tuple[Expr | None, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Colon:
    place: Place


@dataclass(frozen=True, eq=False, slots=True)
class End:
    place: Place


# one of the classes above
Expr: TypeAlias = Any

# ---- modifications


@dataclass(frozen=True, eq=False, slots=True)
class Modifier:
    """One argument of a modification: `final each name(inner) = value`, or a redeclaration."""

    place: Place
    name: tuple[str, ...]
    inner: tuple[Modifier, ...] = ()
    value: Expr | None = None
    each: bool = False
    final: bool = False
    redeclared: ClassDef | Component | None = None


# ---- equations and statements


@dataclass(frozen=True, eq=False, slots=True)
class Equation:
    place: Place
    left: Expr
    right: Expr


@dataclass(frozen=True, eq=False, slots=True)
class Connect:
    place: Place
    first: Ref
    second: Ref


@dataclass(frozen=True, eq=False, slots=True)
class CallEquation:
    """assert, reinit, terminate and other calls without a result."""

    place: Place
    call: Call


@dataclass(frozen=True, eq=False, slots=True)
class For:
    place: Place
    iterators: tuple[Iterator, ...]
    body: tuple[Action, ...]


@dataclass(frozen=True, eq=False, slots=True)
class If:
    place: Place
    branches: tuple[tuple[Expr, tuple[Action, ...]], ...]
    otherwise: tuple[Action, ...]


@dataclass(frozen=True, eq=False, slots=True)
class When:
    place: Place
    branches: tuple[tuple[Expr, tuple[Action, ...]], ...]


@dataclass(frozen=True, eq=False, slots=True)
class While:
    place: Place
    condition: Expr
    body: tuple[Action, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Assign:
    place: Place
    target: Ref | Tuple
    value: Expr


@dataclass(frozen=True, eq=False, slots=True)
class Leave:
    """break or return."""

    place: Place
    word: str


# one of the classes above
Action: TypeAlias = Any

# ---- classes


@dataclass(frozen=True, eq=False, slots=True)
class Component:
    place: Place
    name: str
    type: Ref
    dims: tuple[Expr, ...] = ()
    modifiers: tuple[Modifier, ...] = ()
    value: Expr | None = None
    condition: Expr | None = None
    description: str = ""
    variability: str = ""  # constant, parameter, discrete
    causality: str = ""  # input, output
    connection: str = ""  # flow, stream
    scope: frozenset[str] = frozenset()  # inner, outer
    final: bool = False
    replaceable: bool = False
    protected: bool = False
    each: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class Extends:
    place: Place
    base: Ref
    modifiers: tuple[Modifier, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Import:
    place: Place
    path: tuple[str, ...]
    alias: str | None = None
    names: tuple[str, ...] = ()
    everything: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class External:
    place: Place
    language: str
    name: str
    target: Ref | None
    args: tuple[Expr, ...]


@dataclass(eq=False, slots=True)
class ClassDef:
    place: Place
    kind: str  # model, block, class, package, function, record, connector, type, operator
    name: str
    description: str = ""
    prefixes: frozenset[str] = frozenset()  # partial, encapsulated, replaceable, redeclare, ...
    elements: list[Component | Extends | Import | ClassDef] = field(default_factory=list)
    equations: list[Action] = field(default_factory=list)
    initial_equations: list[Action] = field(default_factory=list)
    algorithms: list[tuple[Action, ...]] = field(default_factory=list)
    initial_algorithms: list[tuple[Action, ...]] = field(default_factory=list)
    external: External | None = None
    alias: Component | None = None  # of `type A = B[n](...)`: base, dims, modifiers
    literals: tuple[tuple[str, str], ...] | None = None  # of an enumeration: name, description
    derivatives: tuple[Ref, tuple[str, ...]] | None = None  # of `function f = der(g, x)`
    annotation: tuple[Modifier, ...] = ()
    end_line: int = 0

    @property
    def classes(self) -> dict[str, ClassDef]:
        return {e.name: e for e in self.elements if isinstance(e, ClassDef)}
