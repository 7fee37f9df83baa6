"""A drawn model: its Modelica text, and beside it the same equations as functions.

Whatever draws a piece of a model writes both: text for the compiler, a function of the values by
name for the interpreter. An `Expr` is such a pair.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

Values = dict[str, float]  # values by name in the Modelica text; "time", s
Evaluate = Callable[[Values], float]
Action = Callable[[Values], Values]  # new values of what it assigns


class Expr(NamedTuple):
    text: str
    value: Evaluate
    jumps: bool = False  # with the states; a rate of that kind could chatter


class Tick(NamedTuple):
    """`when sample(start, interval)`."""

    start: float  # s
    interval: float  # s
    action: Action


class Crossing(NamedTuple):
    """A when-clause that fires as `guard` rises through 0."""

    guard: Evaluate
    action: Action


@dataclass
class Model:
    rng: random.Random
    classes: list[str] = field(default_factory=list)  # before the model
    declarations: list[str] = field(default_factory=list)
    equations: list[str] = field(default_factory=list)
    initial: list[str] = field(default_factory=list)
    algorithms: list[str] = field(default_factory=list)
    parameters: Values = field(default_factory=dict)
    states: Values = field(default_factory=dict)  # at the start
    discretes: Values = field(default_factory=dict)  # at the start
    algebra: list[Callable[[Values], None]] = field(default_factory=list)  # in order, in place
    rates: dict[str, Evaluate] = field(default_factory=dict)
    ticks: list[Tick] = field(default_factory=list)
    crossings: list[Crossing] = field(default_factory=list)
    compared: list[str] = field(default_factory=list)  # variables whose values must agree
    known: list[Expr] = field(default_factory=list)  # what later pieces may use
    features: list[str] = field(default_factory=list)
    count: int = 0

    def name(self, stem: str) -> str:
        self.count += 1
        return f"{stem}{self.count}"

    def number(self, low: float = -2.0, high: float = 2.0) -> float:
        return round(self.rng.uniform(low, high), 3)

    def text(self) -> str:
        """The whole Modelica text; declarations and equations in any order."""
        declarations, equations = list(self.declarations), list(self.equations)
        self.rng.shuffle(declarations)
        self.rng.shuffle(equations)
        lines = [*self.classes, "model M", *(f"  {d}" for d in declarations)]
        if self.initial:
            lines += ["initial equation", *(f"  {e}" for e in self.initial)]
        lines += ["equation", *(f"  {e}" for e in equations)]
        for algorithm in self.algorithms:
            lines += ["algorithm", algorithm]
        return "\n".join([*lines, "end M;", ""])

    def show(self, name: str, jumps: bool = False) -> Expr:
        """A variable that is compared and that later pieces may use."""
        expr = Expr(name, lambda v: v[name], jumps)
        self.compared.append(name)
        self.known.append(expr)
        return expr

    def define(self, name: str, value: Evaluate) -> None:
        """An algebraic variable of the interpreter."""

        def put(values: Values) -> None:
            values[name] = value(values)

        self.algebra.append(put)

    def state(self, name: str, start: float, rate: Evaluate) -> None:
        self.states[name] = start
        self.rates[name] = rate
        self.show(name)

    def parameter(self, name: str, value: float) -> Expr:
        self.parameters[name] = value
        expr = Expr(name, lambda v: v[name])
        self.known.append(expr)
        return expr


def literal(number: float) -> Expr:
    return Expr(f"({number!r})" if number < 0 else repr(number), lambda v: number)


def _divided(a: float, b: float) -> float:
    return a / (1.5 + abs(b))


def mod(x: float, y: float) -> float:
    return x - math.floor(x / y) * y


def div(x: float, y: float) -> float:
    return float(math.trunc(x / y))


def rem(x: float, y: float) -> float:
    return x - div(x, y) * y


def sign(x: float) -> float:
    return float(x > 0) - float(x < 0)


def semi_linear(x: float, a: float, b: float) -> float:
    return a * x if x >= 0 else b * x


UNARY: list[tuple[str, Callable[[float], float]]] = [
    ("sin({})", math.sin),
    ("cos({})", math.cos),
    ("tanh({})", math.tanh),
    ("atan({})", math.atan),
    ("abs({})", abs),
    ("exp(-abs({}))", lambda a: math.exp(-abs(a))),
    ("sqrt(1 + ({})^2)", lambda a: math.sqrt(1 + a * a)),
    ("log(2 + abs({}))", lambda a: math.log(2 + abs(a))),
    ("(-({}))", lambda a: -a),
    ("smooth(1, {})", lambda a: a),
    ("homotopy({}, 0)", lambda a: a),
    ("noEvent(max({}, 0.25))", lambda a: max(a, 0.25)),
    ("asin(0.9*sin({}))", lambda a: math.asin(0.9 * math.sin(a))),
    ("sinh(tanh({}))", lambda a: math.sinh(math.tanh(a))),
]
BINARY: list[tuple[str, Callable[[float, float], float]]] = [
    ("({} + {})", lambda a, b: a + b),
    ("({} - {})", lambda a, b: a - b),
    ("tanh({})*{}", lambda a, b: math.tanh(a) * b),
    ("{}/(1.5 + abs({}))", _divided),
    ("max({}, {})", max),
    ("min({}, {})", min),
    ("atan2({}, 2 + abs({}))", lambda a, b: math.atan2(a, 2 + abs(b))),
    (
        "semiLinear({}, 1.5, 0.5 + tanh({})^2)",
        lambda a, b: semi_linear(a, 1.5, 0.5 + math.tanh(b) ** 2),
    ),
]
IN_TIME: list[tuple[str, Callable[[float], float]]] = [  # events at instants that are known
    ("floor({})", lambda a: float(math.floor(a))),
    ("ceil({})", lambda a: float(math.ceil(a))),
    ("integer({})", lambda a: float(math.floor(a))),
    ("sign({} - 2)", lambda a: sign(a - 2)),
    ("mod({}, 0.7)", lambda a: mod(a, 0.7)),
    ("rem({}, 0.6)", lambda a: rem(a, 0.6)),
    ("div({}, 0.8)", lambda a: div(a, 0.8)),
    ("(if {} > 1.1 then 2 else -1)", lambda a: 2.0 if a > 1.1 else -1.0),
    ("(if {} < 0.9 or {} >= 2.3 then 1.5 else 0.2)", lambda a: 1.5 if a < 0.9 or a >= 2.3 else 0.2),
]


def drawn(model: Model, depth: int = 3, jumps: bool = False) -> Expr:
    """An expression of what is known so far; `jumps`: it may jump with a state."""
    rng = model.rng
    if depth == 0 or rng.random() < 0.15:
        usable = [e for e in model.known if jumps or not e.jumps]
        if usable and rng.random() < 0.75:
            return rng.choice(usable)
        return literal(model.number()) if rng.random() < 0.6 else Expr("time", lambda v: v["time"])
    kind = rng.randrange(10)
    if kind < 4:
        return _binary(model, depth, jumps)
    if kind < 7:
        text, function = rng.choice(UNARY)
        a = drawn(model, depth - 1, jumps)
        return Expr(text.format(a.text), lambda v: function(a.value(v)), a.jumps)
    if kind == 7:
        return _timed(model)
    return _conditional(model, depth, jumps)


def _binary(model: Model, depth: int, jumps: bool) -> Expr:
    text, function = model.rng.choice(BINARY)
    a, b = drawn(model, depth - 1, jumps), drawn(model, depth - 1, jumps)
    return Expr(
        text.format(a.text, b.text), lambda v: function(a.value(v), b.value(v)), a.jumps or b.jumps
    )


def _timed(model: Model) -> Expr:
    text, function = model.rng.choice(IN_TIME)
    slope = model.number(0.6, 2.4)
    argument = f"{slope!r}*time"
    return Expr("(" + text.replace("{}", argument) + ")", lambda v: function(slope * v["time"]))


def _conditional(model: Model, depth: int, jumps: bool) -> Expr:
    a, b = drawn(model, depth - 1, jumps), drawn(model, depth - 1, jumps)
    if not jumps:  # both branches meet where the condition changes
        c = drawn(model, depth - 1)
        return Expr(
            f"(if {c.text} > 0 then {a.text} + {c.text} else {a.text} - {c.text}/2)",
            lambda v: a.value(v) + (c.value(v) if c.value(v) > 0 else -c.value(v) / 2),
            a.jumps or c.jumps,
        )
    c, d = drawn(model, depth - 1, True), literal(model.number())
    return Expr(
        f"(if {c.text} > {d.text} then {a.text} else {b.text})",
        lambda v: a.value(v) if c.value(v) > d.value(v) else b.value(v),
        True,
    )
