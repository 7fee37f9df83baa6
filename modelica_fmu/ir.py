"""What the front end hands to the back end: a flat model, in types of its own.

Names are whole ("valve_x.tau", "b[2].u"); arrays of numbers stay arrays, arrays of components are
taken apart; loops over equations are unrolled; packages, inheritance, modifiers and connections are
resolved. Every node knows its place in the text.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias


class Place(NamedTuple):
    """Where something stands: file, and line from 1."""

    file: Path
    line: int


# ---- expressions


@dataclass(frozen=True, eq=False, slots=True)
class Literal:
    """A number; of an Integer, Boolean or enumeration its value (false 0, true 1, from 1)."""

    place: Place
    value: float
    type: str = "Real"  # Real, Integer, Boolean or the enumeration's full name


@dataclass(frozen=True, eq=False, slots=True)
class Text:
    place: Place
    value: str


@dataclass(frozen=True, eq=False, slots=True)
class Name:
    """A variable, or an array's element or part; a subscript may be a Slice."""

    place: Place
    name: str
    subscripts: tuple[Expr, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Slice:
    """The subscript `:`."""

    place: Place


@dataclass(frozen=True, eq=False, slots=True)
class Last:
    """`end` within a subscript."""

    place: Place


@dataclass(frozen=True, eq=False, slots=True)
class Unary:
    place: Place
    op: str  # -, not
    operand: Expr


@dataclass(frozen=True, eq=False, slots=True)
class Binary:
    place: Place
    op: str  # + - * / ^, the same with a dot for element by element, < <= > >= == <>, and, or
    left: Expr
    right: Expr


@dataclass(frozen=True, eq=False, slots=True)
class Choice:
    place: Place
    branches: tuple[tuple[Expr, Expr], ...]  # condition, value
    otherwise: Expr


@dataclass(frozen=True, eq=False, slots=True)
class Builtin:
    """An operator of the language: sin, der, pre, delay, size, ..."""

    place: Place
    function: str
    args: tuple[Expr, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Call:
    """A function of the model."""

    place: Place
    function: str
    args: tuple[Expr, ...]
    named: tuple[tuple[str, Expr], ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Partial:
    """A function given to a function, some of its inputs bound."""

    place: Place
    function: str
    named: tuple[tuple[str, Expr], ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Array:
    place: Place
    items: tuple[Expr, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Range:
    place: Place
    start: Expr
    step: Expr | None
    stop: Expr


@dataclass(frozen=True, eq=False, slots=True)
class Comprehension:
    """{body for name in range, ...}; the first iterator runs fastest."""

    place: Place
    body: Expr
    iterators: tuple[tuple[str, Expr], ...]


@dataclass(frozen=True, eq=False, slots=True)
class Index:
    """Element of a value that is not a variable."""

    place: Place
    base: Expr
    subscripts: tuple[Expr, ...]
    lenient: bool = False  # a scalar stands for all elements: a modifier of an array of components


@dataclass(frozen=True, eq=False, slots=True)
class Record:
    place: Place
    type: str
    fields: tuple[tuple[str, Expr], ...]


@dataclass(frozen=True, eq=False, slots=True)
class Field:
    place: Place
    base: Expr
    name: str


@dataclass(frozen=True, eq=False, slots=True)
class Several:
    """The results of a function with several outputs; None where one is not wanted."""

    place: Place
    items: tuple[Expr | None, ...]


# one of the classes above
Expr: TypeAlias = Any

# ---- equations


@dataclass(frozen=True, eq=False, slots=True)
class Equation:
    place: Place
    left: Expr
    right: Expr


@dataclass(frozen=True, eq=False, slots=True)
class IfEquation:
    """Branches with as many equations each."""

    place: Place
    branches: tuple[tuple[Expr, tuple[Equation | IfEquation, ...]], ...]
    otherwise: tuple[Equation | IfEquation, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Assertion:
    place: Place
    condition: Expr
    message: str
    warning: bool


@dataclass(frozen=True, eq=False, slots=True)
class Reinit:
    place: Place
    state: Name
    value: Expr


@dataclass(frozen=True, eq=False, slots=True)
class Terminate:
    place: Place
    message: str


@dataclass(frozen=True, eq=False, slots=True)
class When:
    """Branches in the order of their priority."""

    place: Place
    branches: tuple[tuple[Expr, tuple[WhenAction, ...]], ...]


# one of the classes above
WhenAction: TypeAlias = Any

# ---- algorithms and functions


@dataclass(frozen=True, eq=False, slots=True)
class Assign:
    """One target, or several for a function with several outputs (None: not wanted)."""

    place: Place
    targets: tuple[Name | Field | None, ...]
    value: Expr


@dataclass(frozen=True, eq=False, slots=True)
class ForLoop:
    place: Place
    name: str
    range: Expr
    body: tuple[Statement, ...]


@dataclass(frozen=True, eq=False, slots=True)
class WhileLoop:
    place: Place
    condition: Expr
    body: tuple[Statement, ...]


@dataclass(frozen=True, eq=False, slots=True)
class IfStatement:
    place: Place
    branches: tuple[tuple[Expr, tuple[Statement, ...]], ...]
    otherwise: tuple[Statement, ...]


@dataclass(frozen=True, eq=False, slots=True)
class WhenStatement:
    place: Place
    branches: tuple[tuple[Expr, tuple[Statement, ...]], ...]


@dataclass(frozen=True, eq=False, slots=True)
class Leave:
    place: Place
    word: str  # break, return


# one of the classes above
Statement: TypeAlias = Any


@dataclass(frozen=True, eq=False, slots=True)
class Algorithm:
    place: Place
    body: tuple[Statement, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Local:
    """An input, output or inner variable of a function; dims are None where they are open."""

    place: Place
    name: str
    type: str
    dims: tuple[Expr | None, ...]
    default: Expr | None
    fields: tuple[Local, ...] = ()  # of a record


@dataclass(frozen=True, eq=False, slots=True)
class Function:
    place: Place
    name: str
    inputs: tuple[Local, ...]
    outputs: tuple[Local, ...]
    locals: tuple[Local, ...]
    body: tuple[Statement, ...]
    external: bool = False


# ---- the model


@dataclass(frozen=True, eq=False)
class FlatVariable:
    """One variable; an array where it has dimensions. Attributes are expressions."""

    name: str
    type: str  # Real, Integer, Boolean, String or the enumeration's full name
    variability: str  # Constant, Parameter, Discrete, Continuous
    causality: str  # input, output, ""
    dims: tuple[int, ...]
    binding: Expr | None = None
    start: Expr | None = None
    fixed: Expr | None = None
    min: Expr | None = None
    max: Expr | None = None
    nominal: Expr | None = None
    unit: str | None = None
    description: str | None = None
    protected: bool = False
    final: bool = False
    place: Place | None = None
    prefer: int = 0  # stateSelect: never -2, avoid -1, default 0, prefer 1, always 2


@dataclass(frozen=True, eq=False)
class FlatModel:
    name: str
    description: str
    file: Path
    variables: dict[str, FlatVariable]
    equations: list[Equation | IfEquation] = field(default_factory=list)
    initial_equations: list[Equation | IfEquation] = field(default_factory=list)
    algorithms: list[Algorithm] = field(default_factory=list)
    initial_algorithms: list[Algorithm] = field(default_factory=list)
    whens: list[When] = field(default_factory=list)
    assertions: list[Assertion] = field(default_factory=list)
    functions: dict[str, Function] = field(default_factory=dict)
    enumerations: dict[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)
    stop_time: float | None = None  # s, of the experiment annotation
    place: Place | None = None  # of the class
    files: tuple[Path, ...] = ()  # all that were read

    def scalars(self) -> Iterator[tuple[str, FlatVariable, tuple[int, ...]]]:
        """Every scalar: its FMI name ("A[2]"), its variable, its 1-based subscripts."""
        for variable in self.variables.values():
            for subscripts in subscripts_of(variable.dims):
                yield scalar_name(variable.name, subscripts), variable, subscripts


def scalar_name(name: str, subscripts: tuple[int, ...]) -> str:
    return f"{name}[{','.join(map(str, subscripts))}]" if subscripts else name


def subscripts_of(dims: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    if not dims:
        yield ()
        return
    for i in range(1, dims[0] + 1):
        for rest in subscripts_of(dims[1:]):
            yield (i, *rest)


def nodes(root: Any) -> Iterator[Any]:
    """A node of the flat model and all below it."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        if isinstance(node, tuple | list):
            waiting += reversed(node)
        elif hasattr(type(node), "__slots__") and hasattr(node, "place"):
            yield node
            waiting += [getattr(node, s) for s in reversed(type(node).__slots__) if s != "place"]
