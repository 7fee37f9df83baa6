"""Expressions of the flat model → CasADi SX.

A value is an SX scalar, a list of values for an array, or a dict for a record. `Scope` says what a
name means; `Translator` walks the expression. What belongs to hybrid semantics (relations that make
events, `pre`, `sample`, `delay`, `der`) is handed to the scope, so the same translator serves
equations, parameter bindings and function bodies.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca

from modelica_fmu import arrays, ir
from modelica_fmu.source import Source, undecided

Value = Any  # ca.SX | list["Value"] | dict[str, "Value"]
Node = Any  # a node of ir.py

UNARY: dict[str, Callable[[Any], Any]] = {
    "sqrt": ca.sqrt,
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "asin": ca.asin,
    "acos": ca.acos,
    "atan": ca.atan,
    "sinh": ca.sinh,
    "cosh": ca.cosh,
    "tanh": ca.tanh,
    "exp": ca.exp,
    "log": ca.log,
    "abs": ca.fabs,
    "sign": ca.sign,
    "log10": lambda v: ca.log(v) / ca.log(10),
    "Integer": lambda v: v,
}
BINARY: dict[str, Callable[[Any, Any], Any]] = {"atan2": ca.atan2, "min": ca.fmin, "max": ca.fmax}
OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "/": lambda a, b: a / b,
    "*": lambda a, b: a * b,
    "and": ca.logic_and,
    "or": ca.logic_or,
}
RELATIONS = ("<", "<=", ">", ">=")
MOST_CHOICES = 2000  # elements that a subscript known only while running may choose from


@dataclass(frozen=True)
class Given:
    """A function as a value, with the inputs that are bound."""

    function: str
    named: dict[str, Value]


class Scope(Protocol):
    """What names and hybrid operators mean where the expression stands."""

    def name(self, name: str, node: Node) -> Value: ...
    def relation(self, op: str, lhs: ca.SX, rhs: ca.SX, event: bool, node: Node) -> ca.SX: ...
    def rounded(self, value: ca.SX, event: bool, node: Node) -> ca.SX: ...
    def dimensions(self, node: Node) -> int | None: ...
    def operator(
        self, function: str, args: tuple[Node, ...], translate: Translator, node: Node
    ) -> Value | None: ...
    def call(self, node: ir.Call, translate: Translator, every: bool = False) -> Value: ...


def compare(op: str, lhs: ca.SX, rhs: ca.SX) -> ca.SX:
    """A relation as a plain 0/1 value."""
    return {"<": lhs < rhs, "<=": lhs <= rhs, ">": lhs > rhs, ">=": lhs >= rhs}[op]


class Translator:
    def __init__(self, source: Source, scope: Scope, events: bool = True) -> None:
        self.source, self.scope, self.events = source, scope, events

    def __call__(self, node: Node) -> Value:
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            said = f"not supported here: {type(node).__name__}"
            raise self.source.refuse(said, node)
        return method(node)

    def scalar(self, node: Node) -> ca.SX:
        value = self(node)
        if isinstance(value, list) and len(value) == 1:
            value = value[0]
        if isinstance(value, list):
            raise self.source.refuse("an array stands where a scalar is needed", node)
        if not isinstance(value, ca.SX):
            what = "a String in an equation" if isinstance(value, str) else "a record here"
            raise self.source.refuse(f"not supported: {what}", node)
        return value

    def without_events(self) -> Translator:
        return Translator(self.source, self.scope, events=False)

    def number(self, node: Node, what: str) -> int:
        """A whole number that is known while compiling."""
        value = self.scalar(node)
        if not value.is_constant() or not float(value).is_integer():
            told = self.source.refuse(f"not supported: {what} that is not constant", node)
            raise undecided(told, value)
        return int(float(value))

    # ---- names and values

    def _literal(self, node: ir.Literal) -> Value:
        return ca.SX(float(node.value))

    def _text(self, node: ir.Text) -> Value:
        return node.value

    def _name(self, node: ir.Name) -> Value:
        return self.subscripted(self.scope.name(node.name, node), node.subscripts, node)

    def _index(self, node: ir.Index) -> Value:
        value = self(node.base)
        if node.lenient and not isinstance(value, list):
            return value
        return self.subscripted(value, node.subscripts, node)

    def _field(self, node: ir.Field) -> Value:
        return self._field_of(self(node.base), node)

    def _field_of(self, value: Value, node: ir.Field) -> Value:
        if isinstance(value, list):
            return [self._field_of(item, node) for item in value]
        if not isinstance(value, dict) or node.name not in value:
            raise self.source.refuse(f"there is no field {node.name}", node)
        return value[node.name]

    def _record(self, node: ir.Record) -> Value:
        return {name: self(value) for name, value in node.fields}

    def _partial(self, node: ir.Partial) -> Value:
        return Given(node.function, {name: self(value) for name, value in node.named})

    def _array(self, node: ir.Array) -> Value:
        return [self(item) for item in node.items]

    def _range(self, node: ir.Range) -> Value:
        return [ca.SX(v) for v in self.range_values(node)]

    def range_values(self, node: ir.Range) -> list[float]:
        ends = [self.scalar(n) if n is not None else ca.SX(1) for n in (node.start, node.step)]
        ends.append(self.scalar(node.stop))
        if not all(end.is_constant() for end in ends):
            told = self.source.refuse(
                "not supported: a loop over a range that is not constant", node
            )
            raise undecided(told, *ends)
        start, step, stop = map(float, ends)
        if step == 0:
            raise self.source.refuse("a range needs a step that is not 0", node)
        count = math.floor((stop - start) / step + 1e-9) + 1
        return [start + k * step for k in range(max(0, min(count, 1_000_001)))]

    def _comprehension(self, node: ir.Comprehension) -> Value:
        values = getattr(self.scope, "values", None)
        if values is None:
            raise self.source.refuse("not supported: an open comprehension here", node)
        outer, (name, over) = node.iterators[:-1], node.iterators[-1]
        body: Node = ir.Comprehension(node.place, node.body, outer) if outer else node.body
        items, before = self.items(over), dict(values)
        found = []
        for item in items:
            values[name] = item
            found.append(self(body))
        values.clear()
        values.update(before)
        return found

    def items(self, node: Node) -> list[Value]:
        value = self(node)
        if not isinstance(value, list):
            raise self.source.refuse("a range or an array is needed", node)
        return value

    # ---- subscripts

    def subscripted(self, value: Value, subscripts: tuple[Node, ...], node: Node) -> Value:
        if not subscripts:
            return value
        if not isinstance(value, list):
            raise self.source.refuse(
                "a subscript stands behind a scalar", node, hint="leave it out"
            )
        first, rest = subscripts[0], subscripts[1:]
        if isinstance(first, ir.Slice):
            return [self.subscripted(item, rest, node) for item in value]
        index = self._with_last(first, len(value))
        if isinstance(index, list):
            return [self._element(value, i, rest, node) for i in index]
        return self._element(value, index, rest, node)

    def _with_last(self, subscript: Node, size: int) -> Value:
        return self(replaced_last(subscript, size))

    def _element(self, value: list[Value], at: Value, rest: tuple[Node, ...], node: Node) -> Value:
        if not isinstance(at, ca.SX):
            raise self.source.refuse("a subscript is no number", node)
        if at.is_constant():
            number = float(at)
            if not number.is_integer() or not 1 <= number <= len(value):
                name = getattr(node, "name", "")
                raise self.source.refuse(
                    f"subscript {number:g} does not fit the array {name}".rstrip()
                    + f": out of bounds of {len(value)}",
                    node,
                    hint="correct the subscript",
                )
            return self.subscripted(value[int(number) - 1], rest, node)
        if len(value) > MOST_CHOICES or not value:
            raise self.source.refuse(
                f"not supported: a subscript that varies, over {len(value)} elements", node
            )
        found = self.subscripted(value[-1], rest, node)
        for i in range(len(value) - 1, 0, -1):
            found = choose(at == i, self.subscripted(value[i - 1], rest, node), found)
        return found

    # ---- operators

    def _unary(self, node: ir.Unary) -> Value:
        value = self(node.operand)
        if node.op == "not":
            return elementwise(ca.logic_not, value)
        return elementwise(lambda v: -v, value)

    def _binary(self, node: ir.Binary) -> Value:
        op, plain = node.op, node.op.removeprefix(".")
        if op in RELATIONS:
            return self.scope.relation(
                op, self.scalar(node.left), self.scalar(node.right), self.events, node
            )
        lhs, rhs = self(node.left), self(node.right)
        if isinstance(lhs, str) or isinstance(rhs, str):
            return self._of_strings(op, lhs, rhs, node)
        if op in ("==", "<>"):
            return lhs == rhs if op == "==" else lhs != rhs
        if op == "*":
            if isinstance(lhs, list) and not lhs and self.scope.dimensions(node.left) == 2:
                return []  # a matrix without rows
            return self._product(lhs, rhs, node)
        if op == "^" and isinstance(lhs, list):
            return self._matrix_power(lhs, node)
        if plain == "^":
            return self.each(power, node, lhs, rhs)
        return self.each(OPERATORS[plain], node, lhs, rhs)

    def _of_strings(self, op: str, lhs: Value, rhs: Value, node: Node) -> Value:
        if op not in ("==", "<>") or not (isinstance(lhs, str) and isinstance(rhs, str)):
            raise self.source.refuse("not supported: a String in an equation", node)
        return ca.SX(float((lhs == rhs) == (op == "==")))

    def _product(self, lhs: Value, rhs: Value, node: Node) -> Value:
        try:
            return product(lhs, rhs)
        except (ValueError, IndexError, TypeError):
            raise self.source.refuse("dimension mismatch in a product", node) from None

    def _matrix_power(self, base: Value, node: ir.Binary) -> Value:
        exponent = self.number(node.right, "the power of a matrix")
        result = arrays.identity(len(base))
        for _ in range(exponent):
            result = product(result, base)
        return result

    def each(self, function: Any, node: Node, *values: Value) -> Value:
        try:
            return elementwise(function, *values)
        except (ValueError, TypeError, KeyError):
            raise self.source.refuse(
                "dimension mismatch: arrays of different sizes", node, hint="correct the sizes"
            ) from None

    def _choice(self, node: ir.Choice) -> Value:
        result: Value = None
        pending: list[tuple[ca.SX, Value]] = []
        for condition, value in node.branches:  # constant conditions choose at compile time
            test = self.scalar(condition)
            if test.is_constant():
                if not float(test):
                    continue
                result = self(value)
                break
            pending.append((test, self(value)))
        else:
            result = self(node.otherwise)
        for test, value in reversed(pending):
            result = self._chosen(test, value, result, node)
        return result

    def _chosen(self, test: ca.SX, yes: Value, no: Value, node: Node) -> Value:
        def one(a: ca.SX, b: ca.SX) -> ca.SX:
            return ca.if_else(test, a, b)

        return self.each(one, node, yes, no)

    # ---- calls

    def _call(self, node: ir.Call) -> Value:
        return self.scope.call(node, self)

    def _builtin(self, node: ir.Builtin) -> Value:
        function, args = node.function, node.args
        special = self.scope.operator(function, args, self, node)
        if special is not None:
            return special
        plain = PLAIN.get(function)
        if plain is not None:
            return plain(self, args)
        if function in UNARY and len(args) == 1:
            return elementwise(UNARY[function], self(args[0]))
        if function in BINARY and len(args) == 2:
            return self.each(BINARY[function], node, self(args[0]), self(args[1]))
        if function in ("floor", "ceil", "integer", "mod", "rem", "div"):
            return self._rounding(function, args, node)
        if function in arrays.FUNCTIONS:
            return self._of_arrays(function, args, node)
        raise self.source.refuse(f"not supported: the operator {function}()", node)

    def _of_arrays(self, function: str, args: tuple[Node, ...], node: Node) -> Value:
        values = [self(arg) for arg in args]
        try:
            return arrays.FUNCTIONS[function](*values)
        except (ValueError, IndexError, TypeError, AttributeError, RuntimeError) as error:
            said = f"{function}() of what has no such dimension" if function == "size" else ""
            why = (
                str(error).splitlines()[0][:80] if not isinstance(error, RuntimeError) else "sizes"
            )
            raise self.source.refuse(
                said or f"{function}() does not fit its arguments ({why})",
                node,
                hint="name an array and one of its dimensions"
                if function == "size"
                else "correct the arguments",
            ) from None

    def _rounding(self, function: str, args: tuple[Node, ...], node: Node) -> Value:
        values = [self(arg) for arg in args]

        def one(*numbers: ca.SX) -> ca.SX:
            return self._round(function, numbers, node)

        return self.each(one, node, *values)

    def _round(self, function: str, values: tuple[ca.SX, ...], node: Node) -> ca.SX:
        def floor(value: ca.SX) -> ca.SX:
            return self.scope.rounded(value, self.events, node)

        if function in ("floor", "integer"):
            return floor(values[0])
        if function == "ceil":
            return -floor(-values[0])
        if values[1].is_constant() and float(values[1]) == 0:
            raise self.source.refuse(f"{function}() with 0", node, hint="divide by another")
        quotient = values[0] / values[1]
        if function == "mod":
            return values[0] - floor(quotient) * values[1]
        up = self.scope.relation(">=", quotient, ca.SX(0), self.events, node)
        toward_zero = ca.if_else(up, floor(quotient), -floor(-quotient))
        return toward_zero if function == "div" else values[0] - toward_zero * values[1]


def _no_event(translate: Translator, args: tuple[Node, ...]) -> Value:
    return translate.without_events()(args[0])


def _smooth(translate: Translator, args: tuple[Node, ...]) -> Value:
    return translate.without_events()(args[1])


def _homotopy(translate: Translator, args: tuple[Node, ...]) -> Value:
    return translate(args[0])


def _semilinear(translate: Translator, args: tuple[Node, ...]) -> Value:
    plain = translate.without_events()
    x, up, down = (plain.scalar(arg) for arg in args)
    return ca.if_else(x >= 0, up * x, down * x)


PLAIN: dict[str, Any] = {
    "noEvent": _no_event,
    "smooth": _smooth,
    "homotopy": _homotopy,
    "semiLinear": _semilinear,
}


def replaced_last(node: Node, size: int) -> Node:
    """A subscript in which `end` is the size of its dimension."""
    if isinstance(node, ir.Last):
        return ir.Literal(node.place, size, "Integer")
    if isinstance(node, ir.Binary):
        return ir.Binary(
            node.place, node.op, replaced_last(node.left, size), replaced_last(node.right, size)
        )
    if isinstance(node, ir.Range):
        step = replaced_last(node.step, size) if node.step is not None else None
        return ir.Range(
            node.place, replaced_last(node.start, size), step, replaced_last(node.stop, size)
        )
    return node


def flatten(value: Value) -> list[ca.SX]:
    """All scalars of a value, row by row."""
    if isinstance(value, dict):
        value = list(value.values())
    return [v for item in value for v in flatten(item)] if isinstance(value, list) else [value]


def elementwise(function: Any, *values: Value) -> Value:
    """Applies `function` element by element; scalars are repeated. Raises ValueError where sizes
    differ.
    """
    records = [v for v in values if isinstance(v, dict)]
    if records:
        return {
            name: elementwise(function, *(v[name] if isinstance(v, dict) else v for v in values))
            for name in records[0]
        }
    lists = [v for v in values if isinstance(v, list)]
    if not lists:
        return function(*values)
    if any(len(v) != len(lists[0]) for v in lists):
        raise ValueError("arrays of different sizes")
    n = len(lists[0])
    return [
        elementwise(function, *(v[i] if isinstance(v, list) else v for v in values))
        for i in range(n)
    ]


def product(a: Value, b: Value) -> Value:
    """`*`: element by element with a scalar; else rows times columns, a vector being a row on the
    left and a column on the right.
    """
    if not (isinstance(a, list) and isinstance(b, list)):
        return elementwise(lambda x, y: x * y, a, b)
    if a and isinstance(a[0], list):
        return [product(row, b) for row in a]
    if b and isinstance(b[0], list):
        return [product(a, list(col)) for col in zip(*b, strict=True)]
    return sum((x * y for x, y in zip(a, b, strict=True)), start=ca.SX(0))


def choose(condition: ca.SX, yes: Value, no: Value) -> Value:
    return elementwise(lambda a, b: ca.if_else(condition, a, b), yes, no)


def power(base: ca.SX, exponent: ca.SX) -> ca.SX:
    if exponent.is_constant() and float(exponent) in (2.0, 3.0, 4.0):
        return base ** int(float(exponent))
    return base**exponent
